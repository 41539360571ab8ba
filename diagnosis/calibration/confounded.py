"""Effects that look like other gains: which gains explain most of what an effect does to a log."""

from collections.abc import Iterator, Sequence

import numpy as np

from backends.effect import UNITS, Effect
from backends.effects import (
    command_delay,
    coulomb_friction,
    kd_scale,
    kp_scale,
    link_mass,
    rotor_inertia,
    series_elasticity,
    torque_limit,
    viscous_friction,
)
from backends.spec import Spec
from backends.state import Array
from diagnosis.calibration.gains import Compared
from diagnosis.motion.batch import Simulate, replay
from diagnosis.motion.recordings import Recording
from files.plugins import name_of

SHARE = 0.9
"""An effect is confounded with gains if they explain more than this share of its trace."""
STEP = 0.05
"""Relative change of a gain for its trace."""


def confusions(
    simulate: Simulate,
    world: Spec,
    motions: Sequence[Recording],
    compared: Compared,
    joints: Sequence[int],
) -> dict[int, tuple[str, ...]]:
    """The effects on each of some joints that this log cannot tell from other gains, in words."""
    effects = {j: _effects(world, j) for j in joints}
    worlds = [effect.on_spec(world) for of_joint in effects.values() for effect in of_joint]
    shown = compared.angles(replay(simulate, [world, *worlds], motions))
    moved = iter(shown[1:] - shown[0])
    found = {}
    for j, of_joint in effects.items():
        kp, kd, *traces = (next(moved)[compared.used[:, j], j] for _ in of_joint)
        columns = np.stack([kp, kd], axis=1) / STEP
        pairs = zip(of_joint[2:], traces, strict=True)
        found[j] = tuple(text for one, path in pairs for text in _confused(one, path, columns))
    return found


def _effects(world: Spec, j: int) -> list[Effect]:
    """Both gains, then effects on joint `j` of sizes that are usual for a real drive."""
    drive, joint = world.drives[j], world.hand.joint_names[j]
    sizes: list[tuple[type[Effect], float]] = [
        (kp_scale.Effect, STEP),
        (kd_scale.Effect, STEP),
        (viscous_friction.Effect, 0.1 * drive.kd_nms_rad),
        (coulomb_friction.Effect, 0.01 * drive.torque_limit_nm),
        (rotor_inertia.Effect, 0.2 * drive.rotor_inertia_kgm2),
        (link_mass.Effect, 0.2),
        (command_delay.Effect, 2e-3),
        (series_elasticity.Effect, 0.2),
        (torque_limit.Effect, -0.2),
    ]
    return [kind(magnitude=size, joint=joint) for kind, size in sizes]


def _confused(effect: Effect, path: Array, columns: Array) -> Iterator[str]:
    """What to say of an effect whose trace (T,) changes of the gains (T, 2) make up."""
    x, *_ = np.linalg.lstsq(columns, path)
    total = float(path @ path)
    share = 1 - float(np.sum((path - columns @ x) ** 2)) / total if total > 0 else 0.0
    if share > SHARE:
        kp, kd = 100 * x
        yield (
            f"{name_of(type(effect).__module__)}: "
            f"{effect.magnitude / UNITS[effect.unit][1]:g} {effect.unit} "
            f"would look like kp {kp:+.1f} %, kd {kd:+.1f} % ({100 * share:.1f} % of it)"
        )
