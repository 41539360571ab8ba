"""Sizes of effects as they are said: in the units of a hinge or a slide, and in other words."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from backends.effect import UNITS, Effect
from backends.spec import Spec


def sized(
    kind: type[Effect] | None, sizes: Sequence[float], slides: bool = False, count: float = 0.0
) -> dict[str, Any]:
    """A value and the ends of its interval [SI] as a `Cause` has them.

    Without a kind as they are. `slides` and `count`: see `Evidence.place`.
    """
    unit = kind.unit_of(sizes[0], slides) if kind else ""
    value, low, high = (float(size) / (UNITS[unit][1] if unit else 1.0) for size in sizes)
    also = in_other_words(kind, float(sizes[0]), unit, count) if kind else ""
    return {"value": value, "low": low, "high": high, "unit": unit, "also": also}


def in_other_words(kind: type[Effect], size: float, unit: str, count: float = 0.0) -> str:
    """A size [SI] said in a unit: from side to side, radians beside degrees, counts; or nothing."""
    size *= kind.whole
    found = []
    if kind.whole != 1.0:
        found.append(f"whole {size / UNITS[unit][1]:.3g} {unit}")
    if kind.dimension == "angle" and unit in kind.units():
        other = "mrad" if unit == "deg" else "deg"
        found.append(f"{size / UNITS[other][1]:.3g} {other}")
    if kind.dimension == "angle" and count > 0.0:
        found.append(f"{size / count:.3g} counts")
    return ", ".join(found)


def distance(size: float, spec: Spec) -> str:
    """A distance of a world's positions [rad, of slides m] in words."""
    slides = {body.joint.slides for body in spec.hand.driven}
    if slides == {True}:
        return f"{1e3 * size:.3g} mm"
    turned = f"{1e3 * size:.3g} mrad ({np.degrees(size):.2g} deg"
    return f"{turned}; of slides mm)" if True in slides else f"{turned})"
