"""What a few rows at rest say of a joint, in words."""

from collections.abc import Iterator

import numpy as np

from diagnosis.logs._columns import SHOWN
from diagnosis.logs._meta import NOMINAL_UNCERTAINTY
from diagnosis.tables.joints import Rows
from diagnosis.tables.terms import Term

MEANS = {
    "zero": "the zero of the sensor, or that of the model",
    "scale": "the scale of the sensor or of the unit",
    "sag": "the gain of the drive, or a soft gear",
    "band": "dry friction, a dead zone or play; rows at rest do not tell them apart",
    "play": "play, or a gear that gives way under load",
}


def words(one: Rows, term: Term, carried: bool) -> str:
    """A term that shows, or the sag that does not though a gain is known; else nothing.

    `carried`: whether the drives are said to carry the weight beside their law.
    """
    if not term.shows:
        return _no_sag(one, term, carried) if term.term == "sag" else ""
    size, unit, _ = SHOWN[one.slides]
    value, low, high = (abs(x) for x in (term.value, term.low, term.high))
    low, high = sorted((low, high))
    if term.term == "scale":
        ends = f"{100 * low:.2g} to {100 * high:.2g}"
        more = "more" if term.value > 0 else "less"
        said = f"readings are {100 * value:.2g} % ({ends}) {more} than targets"
    elif term.term == "sag":
        said = "; ".join(_sag(one, term, carried))
    else:
        whole = 1.0 if term.term == "zero" else 2.0
        ends = f"{whole * size * low:.2g} to {whole * size * high:.2g}"
        amount = f"{np.copysign(whole * size * value, term.value):.2g} {unit} ({ends})"
        said = {
            "zero": f"readings are off by {amount}",
            "band": f"it rests {amount} apart, by the side that it comes from",
            "play": f"it rests {amount} apart, by the side that the load presses on",
        }[term.term]
    others = f"; {' or '.join(term.alike)} would say as much" if term.alike else ""
    return f"{said}: {MEANS[term.term]}{others}"


def _sag(one: Rows, term: Term, carried: bool) -> Iterator[str]:
    """The gain that a sag means, beside what is known of it."""
    unit = "N/m" if one.slides else "Nm/rad"
    gain, least, most = 1 / term.value, 1 / term.high, 1 / max(term.low, 1e-9)
    yield f"it sags under load like a gain of {gain:.3g} {unit} ({least:.3g} to {most:.3g})"
    if carried:
        yield "so its weight is not carried, and gravity compensation is missing"
    if one.drive.kp:
        wide = 2 * one.drive.uncertainty.get("kp", NOMINAL_UNCERTAINTY)
        apart = not least / (1 + wide) < one.drive.kp < most * (1 + wide)
        yield f"its drive says {one.drive.kp:.3g}" + (", which is another" if apart else "")


def _no_sag(one: Rows, term: Term, carried: bool) -> str:
    """What it means that a joint does not sag where its gain says it must."""
    if not one.drive.kp or term.high > 0.5 / one.drive.kp or carried:
        return ""
    return (
        f"it does not sag, and with its gain of {one.drive.kp:.3g} it would: its drive has an "
        "integral, or carries the weight; rows at rest do not tell which"
    )
