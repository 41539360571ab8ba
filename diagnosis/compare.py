"""What differs from healthy logs of the same motion, where there is no model of the mechanism.

Healthy logs say what is ordinary: how far each of some statistics of a joint spreads over them. A
statistic of today's log beyond that is a difference, and which ones differ says the group:

    statistic       what it is                                            where it is beyond
    delay, gain,    the signature that takes most of the difference in    delay, gain,
    offset, drag      position (`SIGNATURES`), and its size                 sensor, friction
    effort          effort along the motion                               friction
    hunting         motion that no repetition shares                      play, or friction
    ripple          effort at one place that all repetitions share        local defect
    noise           the same at rest, from one sample to the next         sensor

A mechanism with play is looser and hunts; dry friction is asked for in both directions, and sticks
and slips; a damaged place asks for effort there, each time, and does not hunt.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.signal import savgol_filter
from scipy.stats import t as student

from backends.state import Array
from diagnosis.logs.log import Log, LogError
from diagnosis.verdict.result import NONE, UNKNOWN

MORE, LESS = "more friction", "less friction"
PLAY, LOCAL, DELAY, GAIN, SENSOR = "play", "local defect", "delay or clock", "gain", "sensor"
SIGNATURES = ("delay", "gain", "drag", "offset")
LEAST = 0.25
"""Spreads of signatures are at least this share of what healthy logs differ by among themselves."""
LEVELS = ("hunting", "ripple", "noise")
"""Statistics that are logarithms of a root mean square."""
PULLED = 0.1
"""A joint that differs by less than this share of another may only be pulled by that one."""
LEAST_LOGS = 4
"""Fewer healthy logs do not say how far they spread."""
FALSE = 0.02
"""A healthy log is accused so often, at most."""
SHARE = 0.7
"""A signature is taken for the cause where it takes so much of the squared difference."""
CALM = 0.1
"""It hardly accelerates where it does so by less than this share of its largest acceleration."""
LAW = 0.3
"""Dry friction that changed leaves this share of itself as ripple, for it is a law."""
MOVING = 0.05
"""A joint moves where it is faster than this share of its largest speed."""
STEADY = 0.5
"""It is past its starts and stops beyond this share."""
ALIKE = 0.01
"""Commands that differ by less than this share of their range are of the same motion."""
SLOW = 0.1
"""What changes more slowly than over this share of an episode is no hunting."""
WHITE = 0.01
"""Hunting that is hidden in noise has this share of the variance, at most."""
FLOOR = 1e-9


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A statistic of one joint, beside what healthy logs have."""

    name: str
    value: float
    healthy: float
    """Mean over healthy logs."""
    spread: float
    """Their standard deviation."""
    score: float
    """How many of these it is off, with what the mean is unsure by."""
    odd: float
    """The size of the score; to hunt less than healthy logs, or with less noise, is no fault."""
    beyond: bool


@dataclass(frozen=True, kw_only=True)
class Compared:
    """One joint."""

    joint: str
    group: str
    """One of those above, or none, or unknown."""
    confidence: float
    """That it differs at all; of none, how often healthy logs have a statistic that is as odd."""
    place: float | None
    """Where a local defect is [rad, m]."""
    differences: tuple[Difference, ...]
    pulled: bool = False
    """Whether it differs so much less than another joint that it may only be pulled by that."""

    @property
    def oddest(self) -> float:
        """The largest score."""
        return max(one.odd for one in self.differences)


@dataclass(frozen=True)
class _Motion:
    """One commanded motion of a joint: a row per repetition, on one time base, (R, T)."""

    command: Array
    position: Array
    effort: Array
    """NaN where it was not logged."""


def compare(log: Log, healthy: Sequence[Log]) -> tuple[Compared, ...]:
    """Every joint of a log beside healthy logs of the same motion.

    Raises LogError for fewer than `LEAST_LOGS`, or where a motion or a joint is another.
    """
    if len(healthy) < LEAST_LOGS:
        raise LogError(
            f"this log names no model, and without one {LEAST_LOGS} healthy logs or more say what "
            f"is ordinary; given: {len(healthy)}; add --healthy for each, or write the MJCF into "
            "log.yaml, or give a table with --robot and --log"
        )
    for one in healthy:
        if one.joints != log.joints:
            raise LogError(
                f"a healthy log has the joints {', '.join(one.joints)}, this one "
                f"{', '.join(log.joints)}; give logs of the same mechanism"
            )
    found = [_joint(joint, log, healthy) for joint in log.joints]
    most = max(one.oddest for one in found)
    return tuple(
        replace(one, pulled=one.group != NONE and one.oddest < PULLED * most) for one in found
    )


def _joint(joint: str, log: Log, healthy: Sequence[Log]) -> Compared:
    like = _motions(joint, healthy[0])
    today, *sound = (_motions(joint, one, like) for one in (log, *healthy))
    others = ([other for other in sound if other is not one] for one in sound)
    about = pd.DataFrame([_statistics(_beside(*pair)) for pair in zip(sound, others, strict=True)])
    table = _beside(today, sound)
    found = pd.Series(_statistics(table)).drop("gap")
    gap = float(np.sqrt(np.mean(about["gap"] ** 2)))
    about = about[list(found.index)]
    least = [LEAST * gap if name in SIGNATURES else FLOOR for name in found.index]
    known = pd.DataFrame({"value": found, "healthy": about.mean()})
    known["spread"] = np.maximum(about.std(), least)
    known["score"] = (found - known["healthy"]) / known["spread"] / np.sqrt(1 + 1 / len(sound))
    known["odd"] = known["score"].where(known.index.isin(LEVELS), known["score"].abs())
    chances, free = len(found) * len(log.joints), len(sound) - 1
    known["beyond"] = known["odd"] > student.isf(FALSE / chances / 2, free)
    differences = {n: Difference(name=n, **row) for n, row in known.to_dict("index").items()}
    group, odd = _group(table, differences), known["odd"].max()
    chance = min(1.0, 2 * float(student.sf(odd, free)) * chances)
    place = None
    if group == LOCAL:  # where the effort differs most from its mean
        steady = table[table["speed"].abs() > STEADY * table["speed"].abs().max()]
        mean = np.mean(steady["along"] * steady["effort"])
        worst = (steady["effort"] - mean * steady["along"]).abs().idxmax()
        place = float(steady["place"][worst])
    return Compared(
        joint=joint,
        group=group,
        confidence=chance if group == NONE else 1.0 - chance,
        place=place,
        differences=tuple(differences.values()),
    )


def _motions(joint: str, log: Log, like: Sequence[_Motion] = ()) -> list[_Motion]:
    """Each commanded motion with its repetitions, in the order of others where they are given.

    Raises LogError where one lacks.
    """
    kinds = ("command", "position", "torque")
    rows = [[log.signal(kind, e.episode, [joint])[:, 0] for kind in kinds] for e in log.episodes]
    commands, found = [one.command[0] for one in like], []
    if not like:
        for command, _, _ in rows:
            if not any(_is_same(command, known) for known in commands):
                commands.append(command)
    for command in commands:
        alike = [row for row in rows if _is_same(row[0], command)]
        if not alike:
            raise LogError(
                f"{joint} is not moved alike in all logs; without a model, only logs of the same "
                "commands, at the same rate, can be compared"
            )
        n = min(len(row[0]) for row in alike)
        found.append(_Motion(*(np.stack([row[k][:n] for row in alike]) for k in range(3))))
    ours, theirs = ([np.isnan(m.effort).any() for m in some] for some in (found, like or found))
    if ours != theirs:
        raise LogError(f"some logs have the torque of {joint} and others do not")
    return found


def _is_same(a: Array, b: Array) -> bool:
    """Whether two commands are of one motion; clocks may add or drop a sample."""
    n = min(len(a), len(b))
    return abs(len(a) - len(b)) <= 1 and bool(
        np.sqrt(np.mean((a[:n] - b[:n]) ** 2)) <= ALIKE * max(np.ptp(b), FLOOR)
    )


def _beside(today: Sequence[_Motion], sound: Sequence[Sequence[_Motion]]) -> pd.DataFrame:
    """All motions of a log beside the mean of healthy ones, a row per sample.

    Columns: `speed` and `place` of healthy logs, and their `error`, command minus position; whether
    the joint is `moving`, and `calm`: it hardly accelerates, so that errors are what loads make of
    them; mean `position` over repetitions and mean `effort`, where logged, minus those of healthy
    logs; `along`, the sign of the effort that the motion asks for; `unshared`, the motion that no
    repetition shares, where there are some; and `noise`, from one sample to the next at rest.
    """
    pairs = [(one, [log[k] for log in sound]) for k, one in enumerate(today)]
    return pd.concat([_rows(*pair) for pair in pairs], ignore_index=True)


def _rows(today: _Motion, sound: Sequence[_Motion]) -> pd.DataFrame:
    n = min(one.command.shape[1] for one in (today, *sound))
    place = np.mean([one.position[:, :n].mean(axis=0) for one in sound], axis=0)
    speed = np.gradient(place)
    moving = np.abs(speed) > MOVING * np.abs(speed).max()
    position, hard = today.position[:, :n], np.abs(np.gradient(speed))
    jitter = np.pad(np.diff(position, 2, axis=1), ((0, 0), (1, 1)))
    found = {
        "speed": speed,
        "place": place,
        "error": today.command[0, :n] - place,
        "moving": moving,
        "calm": hard < CALM * hard.max(),
        "position": position.mean(axis=0) - place,
        "along": np.sign(speed),
        "noise": np.sqrt(np.mean(jitter**2, axis=0) / 6.0) * ~moving,
    }
    if len(position) > 1:
        apart = position - position.mean(axis=0)
        apart = apart - savgol_filter(apart, max(5, round(SLOW * n) | 1), 2, axis=1)
        found["unshared"] = np.sqrt(np.sum(apart**2, axis=0) / (len(position) - 1))
    if not np.isnan(today.effort).any():
        usual = np.mean([one.effort[:, :n].mean(axis=0) for one in sound], axis=0)
        found["effort"] = today.effort[:, :n].mean(axis=0) - usual
        if usual.min() >= 0.0 or usual.max() <= 0.0:  # an amount: no sign says which way
            found["along"] = np.full(n, np.sign(usual.sum()))
    return pd.DataFrame(found)


def _signatures(table: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """What each cause alone makes of the position, and the share of the difference that it takes.

    The first is a root mean square [rad, m], with the cause's sign.
    """
    calm = table[table["calm"]]
    apart = calm["position"].to_numpy()
    shapes = {
        "delay": -calm["speed"],
        "gain": -calm["error"],
        "drag": -np.sign(calm["speed"]) * calm["moving"],
        "offset": np.ones_like(apart),
    }
    found = {}
    for name, shape in shapes.items():
        along, square = float(shape @ apart), float(shape @ shape)
        size = along / max(np.sqrt(square * len(apart)), FLOOR)
        found[name] = float(size), along**2 / max(square * float(apart @ apart), FLOOR**2)
    return found


def _statistics(table: pd.DataFrame) -> dict[str, float]:
    """The statistics of a log, by name."""
    found = {name: size for name, (size, _) in _signatures(table).items()}
    found["gap"] = float(np.sqrt(np.mean(table["position"][table["calm"]] ** 2)))
    moving, still = table[table["moving"]], table[~table["moving"]]
    found["noise"] = _level(still["noise"])
    if "unshared" in table:
        noise = np.mean(still["noise"] ** 2) if len(still) else 0.0
        square = np.mean(moving["unshared"] ** 2)
        found["hunting"] = _level(np.sqrt(max(square - noise, WHITE * square)))
    if "effort" in table:
        found["effort"] = float(np.mean(moving["along"] * moving["effort"]))
        found["ripple"] = _level(moving["effort"] - found["effort"] * moving["along"])
    return found


def _level(values: Array | pd.Series) -> float:
    """Logarithm of a root mean square."""
    return float(np.log(np.sqrt(np.mean(values**2)) + FLOOR)) if np.size(values) else 0.0


def _group(table: pd.DataFrame, by: Mapping[str, Difference]) -> str:
    """The group that the differences speak of."""
    beyond = {name for name, one in by.items() if one.beyond}
    if not beyond:
        return NONE
    up = {name for name in beyond if by[name].score > 0.0}
    shares = {n: share for n, (_, share) in _signatures(table).items()}
    best = max(shares, key=shares.__getitem__)
    ripple = float(np.exp(by["ripple"].value)) if "ripple" in by else 0.0
    takes = best in beyond and shares[best] >= SHARE
    rubs = by["effort"].beyond if "effort" in by else takes and best == "drag"
    if takes and best != "drag":
        return {"delay": DELAY, "gain": GAIN, "offset": SENSOR}[best]
    if "hunting" in up and not (rubs and up & {"effort", "drag"}):
        return PLAY
    steady = abs(by["effort"].value) if "effort" in by else 0.0
    if "ripple" in up and "hunting" not in up and ripple > LAW * steady:
        return LOCAL
    if rubs:
        return MORE if up & ({"effort"} if "effort" in by else {"drag"}) else LESS
    return SENSOR if "noise" in up else UNKNOWN
