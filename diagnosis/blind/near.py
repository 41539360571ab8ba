"""Names that a mechanic would accept for a fault outside the catalogue, fixed before the draw.

A fault outside the catalogue is *seen* if the verdict is `unknown`. If an effect is named instead,
it is *near* if a mechanic who knows the true fault would accept the name, on its joint.

Some names of the catalogue mean the same for a robot: a delay is a delay, whether on the way to the
drive or back. Without a logged torque, the damping of a servo and of oil is one number.
"""

from collections.abc import Collection, Mapping

NEAR: Mapping[str, frozenset[str]] = {
    "hard-stop": frozenset(),
    "thermal-fade": frozenset({"torque-limit", "kp-scale"}),
    "magnet-slip": frozenset({"encoder-bias"}),
    "cogging": frozenset({"coulomb-friction", "stiction"}),
    "one-sided-friction": frozenset({"coulomb-friction", "stiction", "load-friction"}),
    "backlash": frozenset({"series-elasticity"}),
    "series-elasticity": frozenset({"backlash"}),
    "self-lock": frozenset({"coulomb-friction", "stiction", "load-friction"}),
    "coulomb-friction": frozenset({"stiction", "load-friction", "self-lock"}),
    "stiction": frozenset({"coulomb-friction", "load-friction"}),
    "load-friction": frozenset({"coulomb-friction", "stiction", "self-lock"}),
    "viscous-friction": frozenset({"kd-scale"}),
    "kd-scale": frozenset({"viscous-friction"}),
    "command-delay": frozenset({"sensor-delay", "command-rate-limit"}),
    "sensor-delay": frozenset({"command-delay"}),
    "command-rate-limit": frozenset({"command-delay"}),
}
"""By true fault: lost motion for lost motion, dry friction for dry friction, late for late; a motor
that fades is a weak one, a magnet that slips is a bias, a motor that cogs is rough."""


SAME = {"sensor-delay": "command-delay"}
"""Names that say the same of a robot."""
SAME_BLIND = {**SAME, "viscous-friction": "kd-scale"}
"""The same where no torque was logged."""


def plain_names(names: Collection[str], channels: Collection[str]) -> list[str]:
    """Names in order, one for all that say the same of a robot with these channels."""
    same = SAME if "torque" in channels else SAME_BLIND
    return sorted(same.get(name, name) for name in names)


def is_near(fault: str, named: Collection[str]) -> bool:
    """Whether all names given instead of a fault are near it; False if none is given."""
    return bool(named) and set(named) <= NEAR.get(fault, frozenset())
