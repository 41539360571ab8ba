"""How sure a magnitude is: where its profile cost has risen by what a 90 % interval allows.

All else follows to first order: nominal parameters within their uncertainty, other magnitudes. Both
ends are found by themselves, so what is sure to one side only is said so.
"""

from collections.abc import Callable

import numpy as np
from scipy.stats import chi2

from backends.effect import Effect
from backends.effects import backlash, command_delay, gear_damping, sensor_delay
from backends.state import Array
from diagnosis.attribution.candidates import RUB, is_modelled
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.fit import CALM, Fitter
from diagnosis.attribution.profile import Fit, Profile, grown
from diagnosis.attribution.whiten import alike, dispersion

RISE = float(chi2.ppf(0.9, 1)) / 2
"""Nats above the best at the ends of a 90 % interval."""
FIRST, WIDEST = 1e-3, 100.0
"""Logarithm of the first factor tried, and the largest factor."""
CLOSE = 0.05
"""The rise at an end is right within this share."""
TRIES = 14
Z90 = 1.645
"""Half width of a 90 % interval in standard deviations."""
OTHER_LAW = 0.08
"""Numbers of two laws for one thing agree within this share, standard deviation."""
SHIFT = 0.2
"""No model of a loop knows when it acts but to this share of a drive period, standard deviation."""
LATE = (command_delay.Effect, sensor_delay.Effect)
"""What such a time is late in."""
RESTLESS = 10.0
"""Weight of the squared chaos: it is of a change that is smaller than any interval."""
LEAST = 0.25
"""Dispersion is taken as no smaller: no log shows that a model has no error at all."""
ROUGH, FAR = 0.5, 3.0
"""A profile that rises by less than this share of a parabola at so many half widths is rough."""
COARSE = 2.0
"""Variance of block means, over that of white innovations, from which a fit is coarse."""


def settled(fitter: Fitter, fit: Fit) -> tuple[Fitter, Fit]:
    """A fit and its fitter; where it leaves more than the model allows, both with errors as large.

    Intervals then come from how much what is left resembles its neighbours. A chaotic fit is left
    as it is: nothing follows such a log for long.
    """
    new = fitter.innovations(fit.effects, fit.deviations)
    if alike(new) < COARSE or fitter.unrest(fit) > CALM:
        return fitter, fit
    wider = fitter.allowing_for(fit)
    return wider, wider.refit(wider.at(fit.effects, fit.deviations))


def intervals(
    fitter: Fitter, fit: Fit, evidence: Evidence, other_law: bool = False
) -> list[tuple[float, float]]:
    """Ends of the 90 % interval of every magnitude of a fit, smaller size first.

    No model knows better than `_own_error` where an effect ends and the mechanism begins, by the
    floor of the evidence, nor what a little play adds to it. All of that, and the rise of the cost,
    is as large as the model's error is in this log: the dispersion (McCullagh and Nelder, 1989) of
    the block means of innovations. Not so what a loop of another rate does, which fits take up
    whole: see `_by_little_time` and `_own_time`. The cost rises by more where the candidate is
    chaotic: then residuals say less. `other_law`: what is left says that laws are others here, so
    numbers of those that are models mean nearly the same at best.
    """
    profile, new = Profile(fitter, fit), fitter.innovations(fit.effects, fit.deviations)
    shifts = _by_little_play(profile, fitter, fit, evidence)
    late = _by_little_time(profile, fitter, fit, evidence)
    spread = max(dispersion(new), LEAST)
    rise = RISE * spread * (1 + RESTLESS * fitter.unrest(fit) ** 2)
    found = []
    for index, effect in enumerate(fit.effects):
        size = abs(effect.magnitude)
        own = np.hypot(_own_error(effect, evidence), shifts[index] * size)
        law = OTHER_LAW * size * (other_law and is_modelled(effect))
        timed = max(late[index] * size, _own_time(effect, evidence))
        blur = Z90 * float(np.linalg.norm([min(1.0, spread) ** 0.5 * own, timed, law]))
        ends = [_end(profile, fit, index, rise, way) for way in (-1.0, 1.0)]
        pairs = zip(ends, (-1.0, 1.0), strict=True)
        found.append(tuple(_widened(effect, end, blur, way) for end, way in pairs))
    return [(low, high) for low, high in found]


def _widened(effect: Effect, end: float, blur: float, way: float) -> float:
    """An end of an interval with another error beside, within the effect's bounds and sign."""
    apart = np.hypot(end - effect.magnitude, blur)
    far = effect.magnitude + float(np.copysign(apart, way * effect.magnitude))
    low, high = sorted((0.0, max(effect.bounds, key=lambda bound: bound * effect.magnitude)))
    return float(np.clip(far, low, high))


def _own_error(effect: Effect, evidence: Evidence) -> float:
    """The model's own error as a magnitude of this effect: a little play or friction."""
    if not effect.per_joint or effect.dimension not in ("angle", "torque"):
        return 0.0
    drives = zip(evidence.joints, evidence.nominal.drives, evidence.floor[0, 0], strict=True)
    errors = [
        floor if effect.dimension == "angle" else RUB / 2 * drive.torque_limit_nm
        for joint, drive, floor in drives
        if effect.joint in (None, joint)
    ]
    return float(min(errors))


def _by_little_play(profile: Profile, fitter: Fitter, fit: Fit, evidence: Evidence) -> Array:
    """By which share a play like the model's own error, on any joint, moves each magnitude."""
    base, squares = fitter.innovations(fit.effects, fit.deviations), np.zeros(len(fit.effects))
    drives = evidence.world(fit.effects).drives
    for joint, drive, size in zip(evidence.joints, drives, evidence.floor[0, 0], strict=True):
        if drive.play_rad == 0:
            little = backlash.Effect(magnitude=float(size), joint=joint)
            played = fitter.innovations((*fit.effects, little), fit.deviations)
            squares += profile.pulled(played - base) ** 2
    return np.sqrt(squares)


def _by_little_time(profile: Profile, fitter: Fitter, fit: Fit, evidence: Evidence) -> Array:
    """By which share times like the model's own error, on any joint, move each magnitude."""
    base, squares = fitter.innovations(fit.effects, fit.deviations), np.zeros(len(fit.effects))
    time = SHIFT * evidence.nominal.timing.drive_s
    for kind in LATE:
        for joint in evidence.joints:
            late = (*fit.effects, kind(magnitude=time, joint=joint))
            squares += profile.pulled(fitter.innovations(late, fit.deviations) - base) ** 2
    return np.sqrt(squares)


def _own_time(effect: Effect, evidence: Evidence) -> float:
    """The model's own error of time as a magnitude of this effect: of a delay, or of teeth.

    A loop that holds the torque of the teeth's spring k for a time t is late by t / 2, and gives
    k t / 2 of their damping back.
    """
    time = SHIFT * evidence.nominal.timing.drive_s
    if effect.dimension == "time":
        return time
    if not isinstance(effect, gear_damping.Effect):
        return 0.0
    drives = zip(evidence.joints, evidence.nominal.drives, strict=True)
    shares = [
        time / 2 * drive.gear_stiffness_nm_rad / drive.gear_damping_nms_rad
        for joint, drive in drives
        if effect.joint in (None, joint) and drive.gear_damping_nms_rad > 0
    ]
    return float(min(shares, default=0.0))


def _end(profile: Profile, fit: Fit, index: int, rise: float, way: float) -> float:
    """The magnitude to one side at which the profile cost is `rise` above the best.

    The farthest one, where that is not refuted: a lock that holds all loads may be any stronger.
    Where a joint rattles, magnitudes that are next to the best cost more by chance, and the profile
    is a parabola only from afar: its end follows from there.
    """
    best = profile.at(fit.effects, index).cost

    def moved(step: float) -> Effect:
        return grown(fit.effects[index], np.exp(way * step))

    def risen(step: float) -> float:
        effects = (*fit.effects[:index], moved(step), *fit.effects[index + 1 :])
        return profile.at(effects, index).cost - best

    widest = float(np.log(WIDEST))
    most = risen(widest)
    if most < rise:
        return moved(widest).magnitude
    step = _crossing(risen, rise)
    if most > FAR**2 * rise and risen(FAR * step) < ROUGH * FAR**2 * rise:
        step = max(step, _crossing(risen, FAR**2 * rise, FAR * step) / FAR)
    return moved(step).magnitude


def _crossing(risen: Callable[[float], float], rise: float, step: float = FIRST) -> float:
    """The step at which the cost has risen by so much, searched from one on."""
    inside, outside = 0.0, np.inf
    for _ in range(TRIES):
        cost = risen(step)
        if abs(cost - rise) < CLOSE * rise:
            break
        inside, outside = (step, outside) if cost < rise else (inside, step)
        # A parabola through the best is right where the cost is one; else halve or go on.
        guess = step * np.sqrt(rise / cost) if cost > 0 else 3 * step
        if outside < np.inf:
            fits = inside < guess < outside
            step = guess if fits else (inside + outside) / 2
        else:
            step = min(max(guess, 1.5 * step), 3 * step, float(np.log(WIDEST)))
    return step
