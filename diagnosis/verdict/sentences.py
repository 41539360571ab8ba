"""The sentences about a limb: causes with their shares, what is left, and what would help."""

from collections.abc import Iterator

from diagnosis.verdict.ordinary import ABSURD, SHARE
from diagnosis.verdict.result import NONE, UNKNOWN, Cause, LimbResult

BORDER = 0.7
"""A gap of more than this share of an ordinary one is called near the limit."""
FAR, HALF = 35.0, 0.5
"""Where so many floors are left, and effects take less than this share, the file is far off."""
FAINT = 0.01
"""Leading causes that take less of the gap are not worth a sentence."""
FROM = {
    "robot": "healthy robots leave up to",
    "simulator": "a simulator with this drive law leaves up to",
    "healthy logs": "the healthy logs of this robot leave up to",
}


def sentences(result: LimbResult) -> Iterator[str]:
    """What is said of a limb."""
    limit = f"{FROM[result.ordinary_from]} {result.ordinary:.1f}"
    strained = (
        f"together they are then {result.strain:.1f} standard deviations further off than those of "
        "a healthy robot"
    )
    if result.verdict == (NONE,) and result.left > result.ordinary:
        yield (
            "No fault was found beside the lost packets: the nominal world, refitted, leaves "
            f"{_floors(result.left)} with them; {limit}."
        )
    elif result.verdict == (NONE,):
        subject = "The motion" if result.sensors else "This log"
        left = _floors(result.left)
        yield f"{subject} shows no fault: the nominal world, refitted, leaves {left}; {limit}."
        if result.strain:
            yield (
                f"But {strained}: they hide something, or are less certain than the log says "
                "(nominal_uncertainty)."
            )
        elif result.gap_before > result.ordinary:
            yield (
                f"As they stand, the nominal numbers leave {_floors(result.gap_before)}: no fault "
                "is needed only if they are as uncertain as the log says (nominal_uncertainty)."
            )
            if result.leading and result.leading[0].share >= SHARE:
                yield f"If they are better known, {_cause(result.leading[0])} is likely instead."
        if result.left > BORDER * result.ordinary:
            yield "That is near the limit; healthy logs of this robot would make it more certain."
    elif result.verdict == (UNKNOWN,):
        gap = _floors(result.gap_nominal)
        yield f"The gap is {gap}, and no effect explains it; {limit}."
        if result.law:
            yield (
                f"With {result.law}, {_floors(result.left)} would be left: if that is there, write "
                "it in log.yaml."
            )
        elif result.gap_nominal > ABSURD or (result.left > FAR and result.share < HALF):
            yield (
                "So large a gap often means that the mechanism's file is off: check its units, "
                "zeros, gains and limits."
            )
        for cause in (one for one in result.leading if one.share >= FAINT):
            yield f"{_cause(cause)} would explain {100 * cause.share:.0f} % of the gap."
    else:
        if result.strain:
            left = _floors(result.gap_nominal)
            yield f"Refitted, the nominal numbers leave {left}, but {strained}."
        beside = (result.law,) if result.law else ()
        yield f"{' and '.join((*map(named, result.causes), *beside))} {_takes(result, limit)}."
        if result.law:
            yield "Of these, what drives do is no fault: if it is there, write it in log.yaml."
    for cause in result.sensors:
        yield f"In addition, this log shows {_cause(cause)}."
    if result.tied:
        everywhere = {name: f"{name} on all joints" for name in result.verdict}
        sets = ([everywhere.get(k, k.replace("@", " on ")) for k in names] for names in result.tied)
        others = " or ".join(map(" with ".join, sets))
        it = "it" if len(result.causes) == 1 else "them"
        yield f"This log cannot distinguish {it} from {others}; to do so, {result.experiment}."


def _takes(result: LimbResult, limit: str) -> str:
    """What the causes explain, and whether the rest is ordinary."""
    verb = "explains" if len(result.causes) == 1 and not result.law else "explain"
    gap = "that" if result.strain else "the gap that the nominal numbers leave"
    took = f"{verb} {100 * result.share:.0f} % of {gap}"
    if result.left <= result.ordinary:
        return f"{took}; the rest, {_floors(result.left)}, is ordinary"
    return f"{took}; {_floors(result.left)} is left, but {limit}"


def _floors(gap: float) -> str:
    return f"{gap:.1f} times the noise floor"


def named(cause: Cause) -> str:
    """A cause with the 90 % interval of its size, and what shapes its law beside it."""
    said = _cause(cause, f"{cause.low:.3g} to {cause.high:.3g}")
    return " with ".join((said, *cause.shape))


def _cause(cause: Cause, interval: str = "") -> str:
    where = f" on {cause.joint}" if cause.joint else ""
    return f"{cause.effect} of {size(cause, interval)}{where}"


def size(cause: Cause, interval: str = "") -> str:
    """A size with its interval, and in other words."""
    more = "; ".join(part for part in (interval, cause.also) if part)
    return f"{cause.value:.3g} {cause.unit}{f' ({more})' if more else ''}"
