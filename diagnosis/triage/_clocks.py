"""Clock faults of a log: positions that lead, lag or drift, and time stamps of a wrong rate."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from backends.state import Array
from diagnosis.triage._signals import CLEAR, line, rms
from diagnosis.triage._tracks import BETTER, Fault, Track

FINE = 0.01
"""Misfit below which no clock can be wrong, because the motion is that of the nominal world."""
EARLY_S, EARLY_SAMPLES = 0.005, 1.5
"""A position that leads its command by more than the larger of these has a wrong time stamp."""
LATE_S = 0.5
"""Largest delay of a position against the nominal world that delays and rate limits can cause."""
LEAST_DRIFT = 0.005
"""Clocks count as drifting if they differ by this share, and by `DRIFT_S` over an episode."""
DRIFT_S = 0.05
PACES = (0.1, 0.5, 2.0, 10.0)
"""True over stamped time for common mistakes of a sample period."""
EXACT = 0.02
"""Another pace counts only if it brings the misfit below this share of the motion."""
RIVAL = 2.0
"""Another pace must fit better by this factor than a delay or other damping, which look alike."""
SEARCH_S = (-1.0, 3.0)
COARSE = 161
"""Number of lags that are tried first; then the best near one is sought."""
COARSE_S = 0.02
"""Distance of the samples that are used for the first lags [s]."""
WINDOWS, WINDOW_LAGS = 5, 101
ONE_CLOCK = "stamp command and position with the same clock"


def faults(every: Sequence[Track]) -> tuple[Fault, ...]:
    """The clock faults that joints show with certainty, as one finding.

    A wrong sample period counts only if at least half of the moving joints show it.
    """
    moving = [track for track in every if track.travel > 0.0]
    odd = [track for track in moving if track.misfit >= FINE]
    found = {t.name: said for t in odd if (said := _drifting(t) or _shifted(t))}
    paced = {t.name: said for t in odd if t.name not in found and (said := _paced(t))}
    if 2 * len(paced) >= len(moving):
        found |= paced
    if not found:
        return ()
    evidence, remedy = next(iter(found.values()))
    return (Fault(kind="clock", joints=tuple(found), evidence=evidence, remedy=remedy),)


def _shifted(track: Track) -> tuple[str, str] | None:
    """A position that leads its command, or that follows later than any mechanism does."""
    ahead_s = -_lag_s(track, track.command)
    if ahead_s > max(EARLY_S, EARLY_SAMPLES * track.limb.period_s):
        return (
            f"the position is {1e3 * ahead_s:.0f} ms ahead of its command",
            f"{ONE_CLOCK}; a row holds the command that acts from its time on",
        )
    late_s = _lag_s(track, track.shown)
    if late_s > LATE_S and _misfit(track, late_s) * BETTER < track.misfit:
        return (
            f"the position follows {late_s:.2f} s later than in the nominal world; "
            f"allowed: {LATE_S:g} s",
            ONE_CLOCK,
        )
    return None


def _drifting(track: Track) -> tuple[str, str] | None:
    """A lag that grows with time: command and position have different clocks."""
    longest = max(range(len(track.time_s)), key=lambda k: float(track.time_s[k][-1]))
    t, shown, position = (s[longest] for s in (track.time_s, track.shown, track.position))
    edges, lags = np.linspace(0, len(t), WINDOWS + 1).astype(int), np.linspace(-1, 1, WINDOW_LAGS)
    middle, found = [], []
    for part in (slice(*ends) for ends in zip(edges[:-1], edges[1:], strict=True)):
        moved = (np.interp(t[part] - LATE_S * lag, t, shown) for lag in lags)
        fits = [line([one], [position[part]]).correlation for one in moved]
        if max(fits) >= CLEAR:
            middle.append(t[part].mean())
            found.append(LATE_S * lags[int(np.argmax(fits))])
    if len(found) < 3:
        return None
    rate, offset_s = np.polyfit(middle, found, 1)
    if abs(rate) < LEAST_DRIFT or abs(rate) * t[-1] < DRIFT_S:
        return None
    drifted, constant, as_it_is = (
        rms(position - np.interp(t - late_s, t, shown))
        for late_s in (offset_s + rate * t, np.median(found), 0.0)
    )
    if drifted * BETTER > min(as_it_is, constant):
        return None
    return (
        f"the clock of the position is {100 * abs(rate):.2g} % too "
        f"{'slow' if rate > 0 else 'fast'}: it is off by {1e3 * abs(rate) * t[-1]:.0f} ms after "
        f"{t[-1]:.1f} s",
        ONE_CLOCK,
    )


def _paced(track: Track) -> tuple[str, str] | None:
    """Time stamps of a wrong rate: the motion is that of the nominal world at another pace."""
    tried = {pace: track.varied(paced=pace).misfit for pace in PACES}
    pace = min(tried, key=lambda p: tried[p])
    if not tried[pace] * BETTER < track.misfit or tried[pace] > EXACT:
        return None
    delayed = _misfit(track, _lag_s(track, track.shown))
    if tried[pace] * RIVAL > min(delayed, track.varied(damped=1 / pace).misfit):
        return None
    factor, how = (pace, "short") if pace > 1 else (1 / pace, "long")
    return (
        f"the nominal world moves as logged if all times are multiplied by {pace:g} "
        f"(misfit {tried[pace]:.2g} of the motion, {track.misfit:.2g} with the times as they are)",
        f"check the sample period: the time stamps seem to be {factor:g} times too {how}",
    )


def _lag_s(track: Track, cause: list[Array]) -> float:
    """Delay of the position against `cause` [s]; 0 if they are not the same motion."""
    coarse, every = np.linspace(*SEARCH_S, COARSE), max(1, round(COARSE_S / track.limb.period_s))
    best = coarse[np.argmax([_alike(track, cause, lag_s, every) for lag_s in coarse])]
    ends = best + np.array([-1.0, 1.0]) * (coarse[1] - coarse[0])
    near = minimize_scalar(lambda x: -_alike(track, cause, x), bounds=ends, method="bounded")
    return float(near.x) if -near.fun >= CLEAR else 0.0


def _alike(track: Track, cause: list[Array], lag_s: float, every: int = 1) -> float:
    """Correlation of the position with a delayed cause, on every `every`-th sample.

    Episodes of which it leaves no more than half do not count.
    """
    moved, position = list[Array](), list[Array]()
    for t, c, p in zip(track.time_s, cause, track.position, strict=True):
        late = t[::every] - lag_s
        inside = (late >= t[0]) & (late <= t[-1])
        if 2 * inside.sum() > len(late):
            moved.append(np.interp(late[inside], t, c))
            position.append(p[::every][inside])
    return line(moved, position).correlation if moved else 0.0


def _misfit(track: Track, lag_s: float) -> float:
    """`Track.misfit` against a delayed nominal world."""
    pairs = zip(track.time_s, track.shown, strict=True)
    return dataclasses.replace(track, shown=[np.interp(t - lag_s, t, s) for t, s in pairs]).misfit
