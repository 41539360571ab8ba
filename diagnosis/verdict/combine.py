"""From limbs to the mechanism: what is wrong with all joints is one cause."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from backends.effect import UNITS
from diagnosis.verdict.result import NONE, UNKNOWN, Cause, LimbResult, Result


def combine(limbs: Sequence[LimbResult], cpu_s: float, notes: Sequence[str] = ()) -> Result:
    """What is said of a log, of what is said of its limbs."""
    joints = tuple(chain.from_iterable(limb.joints for limb in limbs))
    said = [c for limb in limbs for c in (*limb.causes, *limb.sensors)]
    named = _together([c for c in said if c.effect != UNKNOWN], joints)
    unknown = UNKNOWN in [*(c.effect for c in said), *(v for limb in limbs for v in limb.verdict)]
    effects = tuple(dict.fromkeys(c.effect for c in named))
    decisive = [limb for limb in limbs if limb.verdict != (NONE,)] or list(limbs)
    worst = max(decisive, key=lambda limb: limb.gap_nominal / limb.ordinary)
    strange = [limb for limb in limbs if limb.verdict == (UNKNOWN,)]
    return Result(
        verdict=(UNKNOWN,) if unknown else effects or (NONE,),
        joints=tuple(dict.fromkeys(chain.from_iterable(c.joints for c in named))),
        causes=tuple(named),
        share=worst.share,
        left=max(limb.left for limb in limbs),
        ordinary=worst.ordinary,
        ordinary_from=worst.ordinary_from,
        probability=float(np.prod([limb.probability for limb in strange or decisive])),
        gap_before=_rms([limb.gap_before for limb in limbs]),
        gap_nominal=max(limb.gap_nominal for limb in limbs),
        gap_after=max(limb.gap_after for limb in limbs),
        limbs=tuple(limbs),
        notes=tuple(notes),
        cpu_s=cpu_s,
    )


def _rms(gaps: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(gaps))))


def _together(causes: Sequence[Cause], joints: Sequence[str]) -> list[Cause]:
    """Causes by effect; one that every joint has alike, or that has no joint, is one."""
    found: list[Cause] = []
    for effect in dict.fromkeys(c.effect for c in causes):
        same = [c for c in causes if c.effect == effect]
        covered = list(chain.from_iterable(c.joints for c in same))
        if len(same) > 1 and sorted(covered) == sorted(joints) and _is_alike(same):
            middle = sorted(same, key=lambda c: c.value * _si(c))[len(same) // 2]
            found.append(replace(middle, joint=None, joints=tuple(joints)))
        else:
            found.extend(same)
    return found


def _is_alike(causes: Sequence[Cause]) -> bool:
    """Whether one size is within the intervals of all, on slides or on hinges."""
    one_kind = len({UNITS[c.unit][0] for c in causes}) == 1
    return one_kind and max(c.low * _si(c) for c in causes) <= min(c.high * _si(c) for c in causes)


def _si(cause: Cause) -> float:
    return UNITS[cause.unit][1]
