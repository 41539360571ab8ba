"""`bench diagnose --static`, `--locked`, `--moved`: what a table says of each joint, in words."""

from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from benchmark.errors import UsageError
from benchmark.gap import _rests
from benchmark.gap.asked import Source
from benchmark.gap.robot_log import asked_of
from diagnosis.logs._columns import SHOWN
from diagnosis.logs.log import LogError
from diagnosis.logs.two_files import Asked
from diagnosis.tables.joints import Rows, benches
from diagnosis.tables.locked import hysteresis
from diagnosis.tables.moved import friction
from diagnosis.tables.rests import regressed, rests
from diagnosis.tables.terms import Term

Answers = Iterator[tuple[str, list[Term], list[str]]]
"""By joint: its terms, and its lines."""


def run(source: Source, kind: str, table: Path) -> tuple[dict, RenderableType]:
    """The result of a table and its lines; raises UsageError for one that cannot be used.

    `source`: the robot, and what is said of it. `kind`: a key of `KINDS`.
    """
    if source.folder or source.tables:
        raise UsageError(f"--{kind} is a table by itself; leave LOG and --log out")
    try:
        said, answers = KINDS[kind](table, source.robot, asked_of(source))
        every = list(answers)
    except LogError as error:
        raise UsageError(str(error)) from error
    lines = [*said, *(f"{joint}: {text}" for joint, _, words in every for text in words)]
    rows = [asdict(term) for _, terms, _ in every for term in terms]
    joints = [joint for joint, _, _ in every]
    result = {"status": "done", "joints": joints, "terms": rows, "said": lines}
    return result, Group(*map(Text, lines))


def _at_rest(table: Path, robot: Path | None, asked: Asked) -> tuple[list[str], Answers]:
    found, said = rests(table, robot, asked)
    words = partial(_rests.words, carried=asked.gravity_compensation)
    return said, (_answer(one.joint, partial(words, one), *regressed(one)) for one in found)


def _moved(table: Path, robot: Path | None, asked: Asked) -> tuple[list[str], Answers]:
    found, said = benches(table, robot, asked)
    return said, (_answer(one.joint, partial(_friction, one), *friction(one)) for one in found)


def _locked(table: Path, robot: Path | None, asked: Asked) -> tuple[list[str], Answers]:
    found, said = benches(table, robot, asked)
    return said, map(_curve, found)


def _answer(
    joint: str, words: Callable[[Term], str], terms: list[Term], lacking: list[str]
) -> tuple[str, list[Term], list[str]]:
    """What shows in words, and what does not."""
    lines = [text for term in terms if (text := words(term))] or ["nothing shows"]
    return joint, terms, [*lines, *(f"the table does not show {text}" for text in lacking)]


def _friction(one: Rows, term: Term) -> str:
    """A term of a joint that is moved, if it shows."""
    _, _, torque = SHOWN[one.slides]
    unit = {"viscous": f"{torque} s/{'m' if one.slides else 'rad'}", "weight": "%"}
    size = np.copysign(100 if term.term == "weight" else 1, term.value)
    low, high = sorted((size * term.low, size * term.high))
    amount = f"{size * term.value:.3g} {unit.get(term.term, torque)} ({low:.3g} to {high:.3g})"
    side, than = ("forward", "more") if term.value > 0 else ("back", "less")
    others = f"; {' or '.join(term.alike)} would say as much" if term.alike else ""
    said = {
        "offset": f"{amount} press it {side}: a spring, or the sensor's zero",
        "coulomb": f"Coulomb friction of {amount}",
        "viscous": f"viscous friction of {amount}",
        "weight": f"it weighs {amount} {than} than the model",
    }
    return said[term.term] + others if term.shows else ""


def _curve(one: Rows) -> tuple[str, list[Term], list[str]]:
    """The hysteresis curve of a joint whose output is locked."""
    terms, at = hysteresis(one)
    size, unit, torque = SHOWN[one.slides]
    scales = {"lost motion": (size, unit), "friction": (1.0, torque)}
    scales["stiffness"] = (1 / size, f"{torque}/{unit}")
    more, by = dict.fromkeys(scales, ""), {term.term: term for term in terms}
    more["lost motion"] = f" at {at:.2g} {torque} to either side"
    if {"stiffness", "lost motion"} <= by.keys():
        gives, lost = 2 * at / by["stiffness"].value, by["lost motion"].value
        moved = f"±{at:.2g} {torque} move the gear {size * gives:.2g} {unit}"
        more["stiffness"] = f" beyond; by it {moved}{': no play shows' if gives > lost else ''}"
    if "friction" in by and at < by["friction"].value:
        more["friction"] = ", more than presses there: press harder in the smallest sweep"
    lines = []
    for term in terms:
        scale, of = scales[term.term]
        low, high = scale * term.low, scale * term.high
        amount = f"{scale * term.value:.3g} {of} ({low:.3g} to {high:.3g})"
        lines.append(f"{term.term} of {amount}{more[term.term]}")
    lines.append("the table does not show whether the gear gives way, or what locks its output")
    return one.joint, terms, lines


KINDS = {"static": _at_rest, "locked": _locked, "moved": _moved}
"""Readers of tables by the option that names them."""
