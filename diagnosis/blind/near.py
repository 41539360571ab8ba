"""Names that a mechanic would give a fault which no catalogue has: fixed before any case is drawn.

A fault outside of the catalogue is *seen* where the verdict is `unknown`. Where something is named
instead, it is *near* if a mechanic who knows the true fault would let the name pass, on its joint.

Some names of the catalogue say the same of a robot: late is late, whether on the way to the drive
or back; and without a logged torque, what a servo damps and what oil damps is one number.
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
    """Whether all names that were given instead of a fault are near it; of none, they are not."""
    return bool(named) and set(named) <= NEAR.get(fault, frozenset())
