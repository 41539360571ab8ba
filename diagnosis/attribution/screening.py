"""Which candidates are worth a search: each at the best of a few levels, to first order."""

from collections.abc import Sequence

from diagnosis.attribution.candidates import Candidate
from diagnosis.attribution.profile import Fit, Profile

NAMESAKES = 2
"""How many finalists may be one effect on different joints."""
SHRINKS = 2
"""How often a third of the smallest level is tried where that one is the best."""


def coarse(
    profile: Profile, around: Fit, fresh: Sequence[Candidate]
) -> list[tuple[Candidate, Fit]]:
    """Every candidate at the best of its levels, to first order in all else.

    An effect on all joints is tried at the levels that are best on single ones.
    """
    best: dict[str, set[float]] = {}
    found = []
    for one in sorted(fresh, key=lambda c: c.joint is None):
        alone = best.setdefault(one.name, set())
        levels = alone if one.joint is None and alone else set(one.levels)
        fits = [_alone(profile, around, one, m) for m in sorted(levels, key=abs)]
        fits += _smaller(profile, around, one, fits)
        found.append((one, min(fits, key=lambda fit: fit.cost)))
        alone.add(found[-1][1].effects[-1].magnitude)
    return found


def with_everywhere(
    tried: Sequence[tuple[Candidate, Fit]], count: int
) -> list[tuple[Candidate, Fit]]:
    """The first ones, and their effects on all joints.

    There no nominal parameter takes a part of what a level that is tried first is off by.
    """
    first = list(tried[:count])
    names = {c.name for c, _ in first}
    return first + [(c, f) for c, f in tried[count:] if c.joint is None and c.name in names]


def everywhere(candidate: Candidate, name: str) -> bool:
    """Whether a candidate is this effect on all joints."""
    return candidate.name == name and candidate.joint is None


def _alone(profile: Profile, around: Fit, candidate: Candidate, magnitude: float) -> Fit:
    effect = candidate.kind(magnitude=magnitude, joint=candidate.joint)
    return profile.at((*around.effects, effect))


def _smaller(profile: Profile, around: Fit, candidate: Candidate, fits: Sequence[Fit]) -> list[Fit]:
    """Ever smaller magnitudes to either side, where the smallest one tried is the best there."""
    found = []
    for sign in (-1.0, 1.0):
        side = [fit for fit in fits if sign * fit.effects[-1].magnitude > 0]
        for _ in range(SHRINKS):
            if not side or min(side, key=lambda fit: fit.cost) is not side[0]:
                break
            size = side[0].effects[-1].magnitude / 3
            side.insert(0, _alone(profile, around, candidate, size))
            found.append(side[0])
    return found


def various(tried: Sequence[tuple[Candidate, Fit]], count: int) -> list[tuple[Candidate, Fit]]:
    """The first ones, few of them of one effect."""
    kept: list[tuple[Candidate, Fit]] = []
    for one in tried:
        if sum(c.name == one[0].name for c, _ in kept) < NAMESAKES:
            kept.append(one)
    return kept[:count]


def there(candidate: Candidate, fit: Fit) -> bool:
    """Whether a fit has the candidate's effect on the same joints, or on some of them."""
    same = [e.joint for e in fit.effects if type(e) is candidate.kind]
    return any(joint == candidate.joint or None in (joint, candidate.joint) for joint in same)
