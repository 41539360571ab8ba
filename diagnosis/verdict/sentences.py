"""What is said of a limb in words: causes with their shares, what is left, and what would help."""

from collections.abc import Iterator
from dataclasses import replace

from diagnosis.verdict.result import NONE, UNKNOWN, Cause, LimbResult

BORDER = 0.7
"""A gap of more than this share of an ordinary one is near the border."""
FROM = {
    "robot": "where sound robots leave up to",
    "simulator": "where this simulator leaves up to",
    "healthy logs": "where its own healthy logs leave up to",
}


def sentences(result: LimbResult) -> LimbResult:
    """The result with its sentences."""
    return replace(result, sentences=tuple(_sentences(result)))


def _sentences(result: LimbResult) -> Iterator[str]:
    limit = f"{FROM[result.ordinary_from]} {result.ordinary:.1f}"
    if result.verdict == (NONE,):
        yield f"Nothing is wrong that this log shows: {result.gap_after:.1f} floors, {limit}."
        if result.gap_after > BORDER * result.ordinary:
            yield "That is near the border; healthy logs of this robot would say more."
    elif result.verdict == (UNKNOWN,):
        yield f"{result.gap_nominal:.1f} floors, {limit}: no effect explains it."
        for cause in result.leading:
            yield f"{_cause(cause)} would take {100 * cause.share:.0f} % of the gap."
    else:
        yield f"{' and '.join(map(_cause, result.causes))} {_takes(result, limit)}."
    for cause in result.sensors:
        yield f"Beside it: {_cause(cause)}."
    if result.tied:
        others = ", ".join("+".join(names) for names in result.tied)
        yield f"This log cannot tell it from {others}; {result.experiment} to tell them apart."


def _takes(result: LimbResult, limit: str) -> str:
    """What causes take, and whether what is left is ordinary."""
    verb = "takes" if len(result.causes) == 1 else "take"
    took = f"{verb} {100 * result.share:.0f} % of the gap"
    if result.left <= result.ordinary:
        return f"{took}; what is left ({result.left:.1f} floors) is ordinary"
    kept = f"{100 * (1 - result.share):.0f} % is left, {result.left:.1f} floors, {limit}"
    return f"{took}; {kept}"


def _cause(cause: Cause) -> str:
    where = f" on {cause.joint}" if cause.joint else ""
    return f"{cause.effect} of {cause.value:.3g} {cause.unit}{where}"
