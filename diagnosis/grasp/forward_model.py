"""What a log of grasps shows of a stick: a world put through its commands on the nominal engine.

A stick has a radius, contacts a softness; friction and mass show where it slips or moves. All
follow from a replay: how tips and stick touch, how the stick moves, and how hard it is pressed.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from backends.spec import Spec
from backends.state import Array, InitialState, quat_z_axis
from diagnosis.motion.batch import Simulate, states, together
from diagnosis.motion.held import Held
from diagnosis.motion.recordings import white_noise

RADIUS, SOFTNESS = "stick.radius_m", "contact.compliance_m_n"
FRICTION, MASS = "stick.friction", "stick.mass_kg"
"""Numbers of a stick and its contacts."""
GONE_M = 0.1
"""Where all sticks have fallen by this, nothing follows: they stay where they are [m]."""
SETTLED_S = 0.3
"""Gaps and forces are taken after this."""
ENGINES = (2e-3, 4e-3, 12e-3)
"""Nominal worlds on Bullet and SAPIEN differ by this from their replay on MuJoCo [m, rad, Nm]."""


def motion_gap(part: Held, shown: Held, length_m: float) -> float:
    """How a replay moves otherwise than a log: the mean square of the gaps over `ENGINES`."""
    pairs = (
        (ends_m(shown.stick, length_m), ends_m(part.stick, length_m)),
        (shown.joint_rad, part.joint_rad),
        (shown.torque_nm, part.torque_nm),
    )
    ratios = []
    for (model, real), far in zip(pairs, ENGINES, strict=True):
        if np.isfinite(real).all():
            square = np.mean(np.nan_to_num(model - real, nan=1e3) ** 2)
            noise = float(np.mean(white_noise(real) ** 2))
            ratios.append(max(square - noise, 0.0) / far**2)
    return float(np.mean(ratios))


def ends_m(stick: Array, length_m: float) -> Array:
    """Lower and upper end of a stick in the poses (..., 7) [m], shape (..., 6)."""
    half = length_m / 2 * quat_z_axis(stick[..., 3:])
    return np.concatenate([stick[..., :3] - half, stick[..., :3] + half], axis=-1)


def settled(part: Held, values: Array) -> Array:
    """Medians over an episode once the grip has settled."""
    return np.median(values[part.time_s >= SETTLED_S], axis=0)


def simulate_grasps(
    simulate: Simulate, worlds: Sequence[Spec], parts: Sequence[Held]
) -> list[list[Held]]:
    """What every world shows in every episode: a list per world of one per episode.

    Joints and stick start where the log has them; all episodes have one rate. A world that is asked
    for more than once is simulated once.
    """
    dt_s = float(np.median(np.diff(parts[0].time_s)))
    unlike = dict.fromkeys(worlds)
    timed = [replace(w, timing=replace(w.timing, policy_s=dt_s)) for w in unlike]
    every = list(parts) * len(timed)
    stick = np.stack([part.stick[0] for part in every])
    start = InitialState(
        joint_rad=np.stack([part.joint_rad[0] for part in every]),
        stick_pos_m=stick[:, :3],
        stick_quat_wxyz=stick[:, 3:],
    )
    target, load, pull = (
        together([getattr(part, name) for part in every])
        for name in ("command_rad", "push_nm", "pull_n")
    )
    rows = list[dict[str, Array]]()
    engine = simulate([world for world in timed for _ in parts])
    for state in states(engine, start, target, load, pull):
        now = {
            "joint_rad": state.joint_rad.copy(),
            "torque_nm": state.drive_torque_nm.copy(),
            "stick": np.hstack([state.stick_pos_m, state.stick_quat_wxyz]),
            "force_n": np.linalg.norm(state.contact_force_n, axis=-1),
        }
        rows.append(now)
        if (now["stick"][:, 2] < stick[:, 2] - GONE_M).all():
            break
    rows += rows[-1:] * (len(target) - len(rows))
    taken = {name: np.stack([row[name] for row in rows], axis=1) for name in rows[0]}
    shown = []
    for n, part in enumerate(every):
        own = {name: values[n, : len(part.time_s)] for name, values in taken.items()}
        shown.append(replace(part, touch=None, **own))
    count = len(parts)
    by_world = {world: shown[k * count : (k + 1) * count] for k, world in enumerate(unlike)}
    return [by_world[world] for world in worlds]
