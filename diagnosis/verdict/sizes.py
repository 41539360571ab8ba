"""Sizes of effects as they are said: in the units of a hinge or a slide, and in other words."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from backends.effect import UNITS, Effect
from backends.spec import Spec


@dataclass(frozen=True, kw_only=True)
class Place:
    """What sizes on some joints are said by."""

    slides: bool = False
    """Whether all of them slide."""
    count: float = 0.0
    """A count of their encoders [rad or m]; 0: unknown."""
    mass_kg: float = 0.0
    """Mass of the link of a single one [kg]; 0: of several."""
    ends: tuple[float, float] | None = None
    """Range of a single one [rad or m]; None: of several."""
    stiffness: float = 0.0
    """Stiffness of the gear of a single one [Nm/rad or N/m]; 0: of several."""
    geared: bool = True
    """Whether the nominal world has that gear; else it is what a share is of."""

    @property
    def firm(self) -> str:
        """Unit of a stiffness."""
        return "N/m" if self.slides else "Nm/rad"


ANYWHERE = Place()


def sized(
    kind: type[Effect] | None, sizes: Sequence[float], place: Place = ANYWHERE
) -> dict[str, Any]:
    """A value and the ends of its interval [SI] as a `Cause` has them; without a kind as it is."""
    unit = kind.unit_of(sizes[0], place.slides) if kind else ""
    value, low, high = (float(size) / (UNITS[unit][1] if unit else 1.0) for size in sizes)
    also = in_other_words(kind, float(sizes[0]), unit, place) if kind else ""
    return {"value": value, "low": low, "high": high, "unit": unit, "also": also}


def in_other_words(kind: type[Effect], size: float, unit: str, place: Place = ANYWHERE) -> str:
    """A size [SI] said in a unit: from side to side, beside degrees, counts, kg, where; or none."""
    if kind.coordinate == "reach" and place.ends is not None:
        at = (place.ends[1] if size > 0.0 else place.ends[0]) - size
        return f"at {at / UNITS[unit][1]:.3g} {unit}"
    size *= kind.whole
    found = []
    if kind.whole != 1.0:
        found.append(f"whole {size / UNITS[unit][1]:.3g} {unit}")
    if kind.dimension == "angle" and unit in kind.units():
        other = "mrad" if unit == "deg" else "deg"
        found.append(f"{size / UNITS[other][1]:.3g} {other}")
    if kind.dimension == "angle" and place.count > 0.0:
        found.append(f"{size / place.count:.3g} counts")
    if kind.is_of("body") and place.mass_kg > 0.0:
        found.append(f"{size * place.mass_kg:.3g} kg")
    if kind.coordinate == "compliance" and place.stiffness > 0.0:
        found.append(f"stiffness {place.stiffness / (place.geared + size):.3g} {place.firm}")
    return ", ".join(found)


def distance(size: float, spec: Spec) -> str:
    """A distance of a world's positions [rad, of slides m] in words."""
    slides = {body.joint.slides for body in spec.hand.driven}
    if slides == {True}:
        return f"{1e3 * size:.3g} mm"
    turned = f"{1e3 * size:.3g} mrad ({np.degrees(size):.2g} deg"
    return f"{turned}; of slides mm)" if True in slides else f"{turned})"
