"""Episodes with the stick in the hand, as geometry: where tips and stick are, sample by sample."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from backends.kinematics import tip_frames
from backends.spec import Spec
from backends.state import Array, State, quat_to_matrix
from backends.touch import Skin, stick_shape
from diagnosis.logs.log import Log
from diagnosis.motion.columns import table
from diagnosis.motion.limb import unread
from diagnosis.motion.recordings import white_noise
from tasks.initial_states import distances_m

PROTOCOLS = ("grasp", "policy")
"""Protocols with the stick in the hand, and staying there."""
LOST_M, LEAST_S = 5e-3, 1.0
"""A stick further from all tips is lost; what was before is used if it is as long as this."""
AWAY_M = 1e-3
"""Largest distance from a skin that is computed."""
SMOOTH, CUBIC = 21, 3
"""Samples and degree of the cubics that noise is smoothed by."""
CALMER = float(np.sqrt(savgol_coeffs(SMOOTH, CUBIC)[SMOOTH // 2]))
"""Noise that they leave [1]."""
FLOOR_M = 2.5e-5
"""Nominal worlds on Bullet and SAPIEN differ from rigid contacts by 0.010 mm."""
STEP_RAD = 1e-4
"""Turn of a joint for the arm it moves a tip by."""


@dataclass(frozen=True, kw_only=True)
class Held:
    """One episode with the stick's pose, as logged or simulated."""

    time_s: Array
    """Since the start, shape (T,)."""
    joint_rad: Array
    """Joint angles by the nominal sensors, shape (T, J)."""
    stick: Array
    """Pose x y z [m], qw qx qy qz, shape (T, 7)."""
    command_rad: Array
    """Targets from each sample on, shape (T, J)."""
    push_nm: Array
    """Known torques on the joints from each sample on, shape (T, J)."""
    pull_n: Array
    """Known force on the stick along its axis, towards its lower end, shape (T,)."""
    torque_nm: Array
    """PD torques, shape (T, J); NaN where none were logged."""
    force_n: Array
    """Normal force on every tip [N], shape (T, F), of a simulation; NaN of a log."""
    touch: Array | None
    """Readings of the taxels, shape (T, F, K)."""

    @property
    def taxels(self) -> tuple[int, int]:
        """Fingers and taxels of each."""
        return (0, 0) if self.touch is None else (self.touch.shape[1], self.touch.shape[2])

    def every(self, rows: Array) -> "Held":
        """Some samples of it."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return replace(self, **{k: v[rows] for k, v in values.items() if v is not None})


def held(log: Log, nominal: Spec, protocols: Sequence[str] = PROTOCOLS) -> list[Held]:
    """The episodes of a log in which the stick is held and its pose was logged."""
    if any(name not in log.joints for name in nominal.hand.joint_names):
        return []
    kept = []
    for meta in log.episodes:
        stick = log.stick(meta.episode) if meta.protocol in protocols else None
        if stick is not None:
            part = _held(log, nominal, meta.episode, stick)
            lost = gaps_m(nominal, part).min(axis=1) > LOST_M
            kept.append(part.every(np.arange(np.argmax(lost))) if lost.any() else part)
    return [part for part in kept if len(part.time_s) and part.time_s[-1] >= LEAST_S]


def _held(log: Log, nominal: Spec, episode: int, stick: Array) -> Held:
    names, pull = nominal.hand.joint_names, log.pull(episode)
    time_s = log.episode(episode)["t_s"].to_numpy(float)
    position, command, push, torque = (
        log.signal(kind, episode, names) for kind in ("position", "command", "push", "torque")
    )
    same = log.fingers == tuple(tip.finger for tip in nominal.hand.fingertips)
    return Held(
        time_s=time_s - time_s[0],
        joint_rad=unread(position, table(nominal, rigid=True)),
        stick=stick,
        command_rad=command,
        push_nm=np.nan_to_num(push),
        pull_n=np.zeros(len(time_s)) if pull is None else pull,
        torque_nm=torque,
        force_n=np.full((len(time_s), len(nominal.hand.fingertips)), np.nan),
        touch=log.touch(episode) if same else None,
    )


def pressed_m(spec: Spec, part: Held) -> Array:
    """Depth [m] to which every taxel is pressed where its finger is touched, shape (T, F, K).

    Negative is the distance to what would press it, up to `AWAY_M`.
    """
    count, tips = len(part.time_s), len(spec.hand.fingertips)
    reach_m = spec.hand.taxels.reach_m + AWAY_M
    faults = "drift_m_s", "dead_share", "halo_m", "gain_spread", "hysteresis"
    none: dict[str, Any] = dict.fromkeys(faults, 0.0)
    taxels = replace(spec.hand.taxels, reach_m=reach_m, **none)
    bare = replace(spec, hand=replace(spec.hand, taxels=taxels))
    state = State.allocate(count, len(spec.hand.joint_names), tips)
    state.joint_rad[:] = part.joint_rad
    state.stick_pos_m[:], state.stick_quat_wxyz[:] = part.stick[:, :3], part.stick[:, 3:]
    state.contact_force_n[:] = 1.0
    return Skin([bare] * count).feel(state).reading_m - AWAY_M


def gaps_m(spec: Spec, part: Held) -> Array:
    """`tip_gaps_m` of an episode, shape (T, F)."""
    return tip_gaps_m(spec, part.joint_rad, part.stick)


def tip_gaps_m(spec: Spec, joint_rad: Array, stick: Array) -> Array:
    """Distance [m] between every tip's surface and the stick's, negative inside, shape (T, F).

    Of joints (T, J) and poses (T, 7).
    """
    shapes = np.array([stick_shape(spec.stick)] * len(stick))
    return distances_m(spec, joint_rad, shapes, stick[:, :3], quat_to_matrix(stick[:, 3:]))


def blur_m(spec: Spec, part: Held) -> tuple[float, float]:
    """How uncertain noise of joints and stick, and steps of encoders, make their distance [m]."""
    middle = np.median(part.joint_rad, axis=0)
    turned = np.concatenate([middle[None], middle + STEP_RAD * np.eye(len(middle))])
    origin, _ = tip_frames(spec.hand, turned)
    arm_m = np.linalg.norm(origin[1:] - origin[0], axis=-1) / STEP_RAD
    steps = np.array([b.joint.encoder.resolution_rad for b in spec.hand.driven]) / np.sqrt(12)
    stepped = np.sqrt(((arm_m * steps[:, None]) ** 2).sum(axis=0).max())
    return float(white_noise(gaps_m(spec, part)).max()), float(stepped)


def smoothed(part: Held) -> Held:
    """With joints and stick as cubics through `SMOOTH` samples around each: less noise, no lag."""
    window = min(SMOOTH, len(part.time_s) - 1 + len(part.time_s) % 2)
    joints, stick = (savgol_filter(v, window, CUBIC, axis=0) for v in (part.joint_rad, part.stick))
    stick[:, 3:] /= np.linalg.norm(stick[:, 3:], axis=1, keepdims=True)
    return replace(part, joint_rad=joints, stick=stick)
