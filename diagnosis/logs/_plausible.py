"""Check whether the numbers of a log are plausible for their names.

Command and position of a joint have about the same size and direction, and the position follows
soon. If they do not, a unit, a column or a clock is wrong. The bounds are far beyond what the
effects of the catalogue can cause.
"""

import numpy as np
import pandas as pd

from diagnosis.logs._columns import PULL, name_of
from diagnosis.logs._meta import LogError, LogMeta
from diagnosis.logs.signals import CLEAR, UNCLEAR, centred, line, unit

Signal = list[np.ndarray]
"""A column, by episode."""

RANGE_RATIO = 100.0
"""From this ratio of position range to command range, the units cannot be the same."""
SURELY = 0.1
"""By how much the correlation at another lag must exceed the correlation at the allowed lags."""
SCALE_RANGE = (0.5, 1.5)
"""Range of the ratio of position to command that gives no warning."""
LATEST_S, EARLIEST_S, EARLIEST_SAMPLES = 1.0, 0.05, 3
"""Largest delay of the position; it may lead by the larger of the other two."""
SEARCH_S = (-0.5, 3.0)
SPEED_S = 0.05
"""Speeds are differences over this time [s], so that sensor noise does not hide them."""
_LAGS = 141
HELD = ("grasp", "pull", "policy")
"""Protocols in which a joint need not follow its command, because the stick holds or moves it."""
TURNS_RAD = 4 * np.pi
STILL = 1e-9
STRONGEST_N = 1000.0
"""Largest plausible pull; no hand holds a stick against more."""


def check(meta: LogMeta, samples: pd.DataFrame, joints: tuple[str, ...]) -> list[str]:
    """Warnings about the joints; raises LogError for what is certainly wrong."""
    protocols = {e.episode: e.protocol for e in meta.episodes}
    warnings, pairs, named = [], {}, {}
    for joint in joints:
        linear = name_of("command", joint, linear=True) in samples
        names = named[joint] = [name_of(kind, joint, linear) for kind in ("command", "position")]
        pairs[joint] = _by_episode(samples, names[0]), _by_episode(samples, names[1])
        warnings += scale_is_plausible(names[1], *pairs[joint], linear)
        largest = np.abs(samples[names[1]]).max()
        if not linear and largest > TURNS_RAD:
            warnings.append(f"'{names[1]}' reaches {largest:.0f} rad; is it in degrees?")
    channels_are_not_swapped(pairs)
    if PULL in samples:
        pull_is_plausible(samples[PULL].to_numpy())
    for number, part in samples.groupby("episode", sort=False):
        if protocols[int(str(number))] == "push":
            pushes_are_logged(int(str(number)), part)
        for joint in joints if protocols[int(str(number))] not in HELD else ():
            position_follows(int(str(number)), part, named[joint])
    return warnings


def scale_is_plausible(name: str, command: Signal, position: Signal, linear: bool) -> list[str]:
    """Refuse different units of command and position; warn of an unusual scale."""
    found, si = line(command, position), "m" if linear else "rad"
    moves, moved = (np.ptp(np.concatenate(list(centred(v)))) for v in (position, command))
    if moved > STILL and moves > RANGE_RATIO * moved:
        raise LogError(
            f"'{name}' moves {moves / moved:.0f} times as far as the command; both must be in "
            f"{si}; convert counts, degrees, volts or millimetres first"
        )
    if found.correlation < CLEAR or SCALE_RANGE[0] < found.slope < SCALE_RANGE[1]:
        return []
    far = f"'{name}' moves {found.slope:.2f} times as far as the command"
    if other := unit(found.slope, linear):
        side, its = other
        raise LogError(f"{far}: the {side} is in {its}; convert it to {si}")
    return [f"{far}; is it scaled?"]


def pull_is_plausible(pull_n: np.ndarray) -> None:
    """Refuse a pull that pushes the stick into the hand, or that is too large for any hand."""
    low, high = np.nanmin(pull_n, initial=0.0), np.nanmax(pull_n, initial=0.0)
    if high > STRONGEST_N:
        raise LogError(
            f"'{PULL}' reaches {high:.4g} N; allowed: up to {STRONGEST_N:g} N; convert mN, grams "
            "or counts first"
        )
    if low < -0.1 * high - STILL:
        raise LogError(
            f"'{PULL}' goes down to {low:.4g} N; forces towards the stick's lower end, out of the "
            "hand, must be positive; change the sign"
        )


def pushes_are_logged(number: int, part: pd.DataFrame) -> None:
    """Refuse an episode with an unknown push: it could look like any effect."""
    pushes = part[[name for name in part if str(name).startswith("push_")]]
    if not pushes.notna().to_numpy().any():
        raise LogError(
            f"episode {number} is of protocol 'push' and has no channel 'push', so the push is "
            "unknown; log it, for example as 'push_nm.JOINT', or leave the episode out"
        )


def channels_are_not_swapped(pairs: dict[str, tuple[Signal, Signal]]) -> None:
    """Refuse a position that follows another joint's command, or its own with the wrong sign."""
    for joint, (command, position) in pairs.items():
        own = line(command, position).correlation
        if own < -CLEAR:
            raise LogError(
                f"the position of {joint} moves against its command; change the sign of one of them"
            )
        for other, (foreign, _) in pairs.items() if own < UNCLEAR else ():
            apart = abs(line(command, foreign).correlation) < CLEAR
            if apart and line(foreign, position).correlation > CLEAR:
                raise LogError(
                    f"the position of {joint} follows the command of {other}: their columns are "
                    "swapped; correct the names"
                )


def position_follows(number: int, part: pd.DataFrame, names: list[str]) -> None:
    """Refuse an episode whose position certainly follows far too late, or leads the command."""
    dt = float(np.median(np.diff(part["t_s"])))
    step = max(1, round(SPEED_S / dt))
    if len(part) < step + 2:
        return  # too short to tell a speed
    command, position = (v[step:] - v[:-step] for v in (part[n].to_numpy() for n in names))
    half = len(command) // 2
    first, last = (max(-half, min(s / dt, half)) for s in SEARCH_S)
    lags = np.unique(np.linspace(first, last, _LAGS).round().astype(int))
    early = -max(EARLIEST_S / dt, EARLIEST_SAMPLES)
    fine = (lags >= early) & (lags <= LATEST_S / dt)
    allowed = max(_at_lag(command, position, lag)[0] for lag in lags[fine])
    if allowed > 1 - SURELY:
        return  # no other correlation is so much larger
    found = np.array([_at_lag(command, position, lag) for lag in lags])
    best = int(np.argmax(found[:, 0]))
    clear = found[best, 0] > CLEAR and found[best, 1] > UNCLEAR
    if fine[best] or not clear or found[best, 0] < allowed + SURELY:
        return
    late_s = lags[best] * dt
    way = "follows" if late_s > 0 else "leads"
    raise LogError(
        f"'{names[1]}' {way} its command by {abs(late_s):.2f} s in episode {number}; "
        f"allowed: a delay of up to {LATEST_S:g} s; stamp both with the same clock"
    )


def _at_lag(command: np.ndarray, position: np.ndarray, lag: int) -> tuple[float, float]:
    """Correlation and scale of the speeds when the position is `lag` samples late."""
    n = len(command) - abs(lag)
    c = command[max(-lag, 0) :][:n]
    p = position[max(lag, 0) :][:n]
    if np.ptp(c) < STILL or np.ptp(p) < STILL:
        return 0.0, 0.0
    c, p = c - c.mean(), p - p.mean()
    both, own = np.dot(c, p), np.dot(c, c)
    return both / np.sqrt(own * np.dot(p, p)), both / own


def _by_episode(samples: pd.DataFrame, column: str) -> Signal:
    return [part.to_numpy(float) for _, part in samples.groupby("episode", sort=False)[column]]
