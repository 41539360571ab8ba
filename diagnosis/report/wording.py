"""The sentences of a diagnosis, the same on the terminal and in the report."""

from collections.abc import Iterable, Iterator

from diagnosis.answer import Diagnosis
from diagnosis.shrinkage import Share
from diagnosis.verdict.result import NONE, UNKNOWN, Cause, Nominal

SURE = 99.5
"""No verdict is certain: a larger probability is not written as 100 [%]."""


def probability(found: Diagnosis) -> str:
    """How sure the verdict is."""
    share = 100 * found.probability
    return f"{share:.0f} %" if share < SURE else "over 99 %"


def gaps(found: Diagnosis) -> str:
    """How far the gap shrinks, in a sentence."""
    before, nominal, after = (
        spread(one) for one in (found.gaps.before, found.gaps.nominal, found.gaps.after)
    )
    text = (
        f"On seconds that the fits have not seen, the gap of the worst joint is {before} times the "
        f"noise floor; the nominal numbers, refitted within their uncertainty, leave {nominal}"
    )
    if found.verdict == (NONE,) or found.gaps.after == found.gaps.nominal:
        return f"{text}."
    what = "the leading causes" if UNKNOWN in found.verdict else "the causes named"
    return (
        f"{text}, {what} leave {after}. The causes take {percent(found.shrinkage)} of the squared "
        f"gap beyond one floor; the nominal numbers alone take {percent(found.shrinkage_nominal)}."
    )


def next_steps(found: Diagnosis) -> Iterator[str]:
    """What would make the verdict surer."""
    if found.verdict == (UNKNOWN,):
        yield (
            "Look at the joint and the phase where the gap lies, and give healthy logs of this "
            "robot (--healthy): they say which part of the gap was there before"
        )
        if any(limb.leading for limb in found.limbs):
            yield (
                "If a leading cause is plausible, state it with --known-effects and diagnose what "
                "is left"
            )


def place(cause: Cause) -> str:
    """A cause and its joint, such as 'backlash on J3'."""
    where = cause.joint or (listed(cause.joints) if cause.joints else "")
    return f"{cause.effect} on {where}" if where else cause.effect


def moved(one: Nominal) -> str:
    """A nominal number that took part of the gap, with its standard deviation."""
    if one.effect == "soft-friction":
        return "dry friction that yields under load, as a simulator's"
    where = f" on {one.joint}" if one.joint else ""
    return f"{one.effect}{where} {one.value:+.3g} ± {one.sd:.2g} {one.unit}"


def spread(share: Share) -> str:
    """A value with its interval."""
    value, low, high = (
        f"{v:.2f}" if abs(v) < 10 else f"{v:.3g}" for v in (share.value, *share.interval)
    )
    return f"{value} ({low} to {high})"


def percent(share: Share) -> str:
    """A share with its interval in percent."""
    return "{:.1f} % ({:.1f} to {:.1f})".format(*(100 * v for v in (share.value, *share.interval)))


def listed(items: Iterable[str]) -> str:
    """Words as a list: 'a, b and c'."""
    words = list(items)
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
