"""`bench diagnose --static`: what a few rows at rest say of each joint, in words."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from benchmark.errors import UsageError
from benchmark.gap.asked import Source
from benchmark.gap.robot_log import asked_of
from diagnosis.logs._meta import NOMINAL_UNCERTAINTY
from diagnosis.logs.log import LogError
from diagnosis.static import Rests, Term, regress, rests

MEANS = {
    "zero": "the zero of the sensor, or that of the model",
    "scale": "the scale of the sensor or of the unit",
    "sag": "the gain of the drive, or a soft gear",
    "band": "dry friction, a dead zone or play; rows at rest do not tell them apart",
    "play": "play, or a gear that gives way under load",
}


def run(source: Source, table: Path) -> tuple[dict, RenderableType]:
    """The result of a table and its lines; raises UsageError for one that cannot be used.

    `source`: the robot, and what is said of it.
    """
    if source.folder or source.tables:
        raise UsageError("--static is a table by itself; leave LOG and --log out")
    try:
        found, said = rests(table, source.robot, asked_of(source))
        answers = [(one, *regress(one)) for one in found]
    except LogError as error:
        raise UsageError(str(error)) from error
    lines, rows = list(said), list[dict]()
    for one, terms, lacking in answers:
        words = [text for term in terms if (text := _words(one, term))]
        lines += [f"{one.joint}: {text}" for text in words or ["nothing shows"]]
        lines += [f"{one.joint}: the table does not show {text}" for text in lacking]
        rows += [asdict(term) for term in terms]
    joints = [one.joint for one, _, _ in answers]
    result = {"status": "done", "joints": joints, "terms": rows, "said": lines}
    return result, Group(*map(Text, lines))


def _words(one: Rests, term: Term) -> str:
    """A term that shows, or the sag that does not though a gain is known; else nothing."""
    if not term.shows:
        return _no_sag(one, term) if term.term == "sag" else ""
    size, unit = (1e3, "mm") if one.slides else (180 / np.pi, "deg")
    value, low, high = (abs(x) for x in (term.value, term.low, term.high))
    low, high = sorted((low, high))
    if term.term == "scale":
        ends = f"{100 * low:.2g} to {100 * high:.2g}"
        more = "more" if term.value > 0 else "less"
        said = f"readings are {100 * value:.2g} % ({ends}) {more} than targets"
    elif term.term == "sag":
        said = "; ".join(_sag(one, term))
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


def _sag(one: Rests, term: Term) -> Iterator[str]:
    """The gain that a sag means, beside what is known of it."""
    unit = "N/m" if one.slides else "Nm/rad"
    gain, least, most = 1 / term.value, 1 / term.high, 1 / max(term.low, 1e-9)
    yield f"it sags under load like a gain of {gain:.3g} {unit} ({least:.3g} to {most:.3g})"
    if one.carried:
        yield "so its weight is not carried, and gravity compensation is missing"
    if one.drive.kp:
        wide = 2 * one.drive.uncertainty.get("kp", NOMINAL_UNCERTAINTY)
        apart = not least / (1 + wide) < one.drive.kp < most * (1 + wide)
        yield f"its drive says {one.drive.kp:.3g}" + (", which is another" if apart else "")


def _no_sag(one: Rests, term: Term) -> str:
    """What it means that a joint does not sag where its gain says it must."""
    if not one.drive.kp or term.high > 0.5 / one.drive.kp or one.carried:
        return ""
    return (
        f"it does not sag, and with its gain of {one.drive.kp:.3g} it would: its drive has an "
        "integral, or carries the weight; rows at rest do not tell which"
    )
