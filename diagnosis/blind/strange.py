"""The largest faults that a drawn robot can have, inside and outside the catalogue."""

import numpy as np

from backends.catalogue import catalogue
from backends.spec import Spec
from diagnosis.blind import faults

REACH = 2.0
"""Largest magnitudes over the large level of the catalogue's sizes."""
LEAST_SHARE = -0.85
"""Largest magnitude that is relative to a number."""
COMPLIANCE = 0.6
"""Largest compliance of a gear over 1 / kp."""
STRANGE = {
    "magnet-slip": 0.1,
}
"""Largest magnitudes of `plant.STRANGE`."""
EITHER = ("magnet-slip",)
"""Of these what goes to either side."""


def largest(name: str, joint: str | None, spec: Spec, rng: np.random.Generator) -> float:
    """The largest magnitude of a fault, to one of its sides at random."""
    bodies = [b for b in spec.hand.driven if joint in (None, b.joint.name)]
    if name in STRANGE:
        most = STRANGE[name]
        return float(most * (rng.choice([-1.0, 1.0]) if name in EITHER else 1.0))
    drives = [b.joint.drive for b in bodies if b.joint.drive is not None]
    kind = catalogue()[name]
    if kind.coordinate == "compliance":
        return COMPLIANCE * min(d.gear_stiffness_nm_rad / d.kp_nm_rad for d in drives)
    if kind.coordinate == "reach":
        room = min(np.ptp(b.joint.range_rad) for b in bodies) / 2
        return float(np.sign(faults.side(kind, rng)[-1]) * room)
    amount = REACH * faults.side(kind, rng)[-1]
    return max(amount, LEAST_SHARE) * faults.natural(kind, joint, spec)
