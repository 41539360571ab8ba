"""Episodes with the stick in the hand, as geometry: where tips and stick are, sample by sample."""

from dataclasses import dataclass, replace

import numba
import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from backends.kinematics import tip_frames
from backends.spec import Spec
from backends.state import Array, State, quat_to_matrix
from backends.touch import Skin, stick_shape, surface_distance
from diagnosis.log import Log

PROTOCOLS = ("grasp", "policy")
"""Protocols with the stick in the hand."""
POINTS = 64
"""Points on a tip's axis of which the nearest to the stick is sought: 0.2 mm apart, which is
0.0002 mm in the distance."""

SMOOTH, CUBIC = 21, 3
"""Samples and degree of the cubics that noise is smoothed by."""
CALMER = float(np.sqrt(savgol_coeffs(SMOOTH, CUBIC)[SMOOTH // 2]))
"""Noise that they leave [1]."""
STEP_RAD = 1e-4
"""Turn of a joint for the arm it moves a tip by."""


@dataclass(frozen=True, kw_only=True)
class Held:
    """One episode with the stick's pose."""

    episode: int
    protocol: str
    time_s: Array
    """Since the start, shape (T,)."""
    joint_rad: Array
    """Joint angles by the nominal sensors, shape (T, J)."""
    stick: Array
    """Pose x y z [m], qw qx qy qz, shape (T, 7)."""
    touch: Array | None
    """Readings of the taxels, shape (T, F, K)."""

    @property
    def taxels(self) -> tuple[int, int]:
        """Fingers and taxels of each."""
        return (0, 0) if self.touch is None else (self.touch.shape[1], self.touch.shape[2])

    def every(self, rows: Array) -> "Held":
        """Some samples of it."""
        kept = {k: getattr(self, k)[rows] for k in ("time_s", "joint_rad", "stick")}
        return replace(self, **kept, touch=None if self.touch is None else self.touch[rows])


def held(log: Log, nominal: Spec) -> list[Held]:
    """The episodes of a log in which the stick is held and its pose was logged."""
    joints = list(nominal.hand.joint_names)
    if any(name not in log.joints for name in joints):
        return []
    column = [log.joints.index(name) for name in joints]
    encoders = [body.joint.encoder for body in nominal.hand.driven]
    bias = np.array([e.bias_rad for e in encoders])
    scale = 1 + np.array([e.scale_error for e in encoders])
    found = []
    for meta in log.episodes:
        stick = log.stick(meta.episode)
        if meta.protocol not in PROTOCOLS or stick is None:
            continue
        time_s = log.episode(meta.episode)["t_s"].to_numpy(float)
        position = log.signal("position", meta.episode)[:, column]
        touch = log.touch(meta.episode)
        fits = touch is not None and log.fingers == tuple(t.finger for t in nominal.hand.fingertips)
        found.append(
            Held(
                episode=meta.episode,
                protocol=meta.protocol,
                time_s=time_s - time_s[0],
                joint_rad=(position - bias) / scale,
                stick=stick,
                touch=touch if fits else None,
            )
        )
    return found


def pressed_m(spec: Spec, part: Held) -> Array:
    """Depth [m] to which every taxel is pressed where its finger is touched, shape (T, F, K)."""
    count, tips = len(part.time_s), len(spec.hand.fingertips)
    taxels = replace(spec.hand.taxels, drift_m_s=0.0, dead_share=0.0, halo_m=0.0)
    bare = replace(spec, hand=replace(spec.hand, taxels=taxels))
    state = State.allocate(count, len(spec.hand.joint_names), tips)
    state.joint_rad[:] = part.joint_rad
    state.stick_pos_m[:], state.stick_quat_wxyz[:] = part.stick[:, :3], part.stick[:, 3:]
    state.contact_force_n[:] = 1.0
    return Skin([bare] * count).feel(state).reading_m


def gaps_m(spec: Spec, part: Held) -> Array:
    """Distance [m] between every tip's surface and the stick's, negative inside, shape (T, F)."""
    origin, rotation = tip_frames(spec.hand, part.joint_rad)
    tips = np.array([(tip.length_m, tip.radius_m) for tip in spec.hand.fingertips])
    forward = np.ascontiguousarray(rotation[..., 0])
    stick = quat_to_matrix(part.stick[:, 3:])
    return _gaps(origin, forward, tips, stick_shape(spec.stick), part.stick[:, :3], stick)


def blur_m(spec: Spec, part: Held) -> float:
    """How uncertain white noise of joints and stick makes a distance between them [m]."""
    middle = np.median(part.joint_rad, axis=0)
    turned = np.concatenate([middle[None], middle + STEP_RAD * np.eye(len(middle))])
    origin, _ = tip_frames(spec.hand, turned)
    arm_m = np.linalg.norm(origin[1:] - origin[0], axis=-1) / STEP_RAD
    joints, stick = (
        np.median(np.abs(np.diff(v, n=3, axis=0)), axis=0) / 0.6745 / np.sqrt(20)
        for v in (part.joint_rad, part.stick[:, :3])
    )
    return float(np.sqrt(((arm_m * joints[:, None]) ** 2).sum(axis=0).max() + (stick**2).max()))


def smoothed(part: Held) -> Held:
    """With joints and stick as cubics through `SMOOTH` samples around each: less noise, no lag."""
    window = min(SMOOTH, len(part.time_s) - 1 + len(part.time_s) % 2)
    joints, stick = (savgol_filter(v, window, CUBIC, axis=0) for v in (part.joint_rad, part.stick))
    stick[:, 3:] /= np.linalg.norm(stick[:, 3:], axis=1, keepdims=True)
    return replace(part, joint_rad=joints, stick=stick)


@numba.njit(cache=True)
def _gaps(origin, forward, tips, shape, position, rotation):
    out = np.full(origin.shape[:2], np.inf)
    p = np.zeros(3)
    for n in range(out.shape[0]):
        for f in range(out.shape[1]):
            for s in range(POINTS):
                back = tips[f, 0] * s / (POINTS - 1.0)
                p[:] = 0.0
                for i in range(3):
                    for k in range(3):
                        at = origin[n, f, k] - back * forward[n, f, k] - position[n, k]
                        p[i] += rotation[n, k, i] * at
                near = surface_distance(p[0], p[1], p[2], shape) - tips[f, 1]
                out[n, f] = min(out[n, f], near)
    return out
