"""When the commands of a log act: from their rows on, or before them.

A log has commands that act from its rows' times on. Many programs write others. One that sends a
command, waits and reads has each reading after its command has acted. One that sends commands
between its rows writes the last of them, which acts from some moment after the row before. How long
before their rows all of them act is fitted here, and of those that jump, each by itself. How late
they then are is left to the diagnosis.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize_scalar

from backends.catalogue import catalogue
from backends.effect import NumberEffect
from backends.state import Array
from diagnosis.evidence.evidence import evidence
from diagnosis.evidence.log_faults import checked
from diagnosis.logs._columns import SENT
from diagnosis.logs.log import Log, LogError
from diagnosis.models.parameters import Parameter, parameters
from diagnosis.motion.columns import DELAY
from diagnosis.motion.excerpt import FITTED_S, excerpted
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import Recording
from diagnosis.replay.jumps import moved_jumps
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.search.fit import Fit, Fitter

NEARER = 0.4
"""Commands act before their rows where that costs so much at most: of the squared gap beyond a
floor, and of numbers that are far off. So it is with jumps that act by themselves."""
APART = 0.1
"""Jumps act by themselves where their moments differ by this share of a row (root mean square):
fits find less where there is none, and of commands twice as frequent as rows it is 0.25."""
LOST = 0.4
"""A jump that acts so many rows late at least waited for the next packet."""
FREE, EVERYDAY = 1.0, 10.0
"""Standard deviation of the nominal numbers, relative, and how many times everyday play and
friction, that are fitted to either: a fault moves no command."""
TURNS, ON = 4, 2
"""Fits of jumps, each with fits of the numbers after it, while something is left; fits on."""
SCANNED, CLOSER = np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0]), 8
"""Rows that all commands may be late by alone, and so many trials between."""
ENOUGH_S = 60.0
"""Joint-seconds of a log that show it."""


class _Late(NumberEffect):
    """How much later than their rows commands act."""

    number = "command.delay_s"
    dimension, unit = "time", "ms"
    bounds = (-0.2, 0.2)
    least = 0.003
    either_sign = True


_LATE = Parameter(
    effect="late",
    kind=_Late,
    joint=None,
    place=DELAY,
    unit=1.0,
    tolerance=0.0,
    least=_Late.least,
    most=_Late.bounds[1],
)
Fits = Sequence[tuple[Fitter, Fit]]
"""Of every limb; the last of its parameters is `_LATE`."""


@dataclass(frozen=True, kw_only=True)
class Moments:
    """When commands act."""

    lead_s: float
    """How long before their rows [s]."""
    jumps: Mapping[tuple[int, int], float] = field(default_factory=dict)
    """How much earlier than that, of those that jump, by episode and row [s]."""

    def early_s(self, episode: int, rows: Array) -> Array:
        """How long before its row the command of each of an episode's rows acts [s]."""
        own = [self.jumps.get((episode, row), 0.0) for row in rows.tolist()]
        return self.lead_s + np.array(own)

    def apart(self, row_s: float) -> float:
        """How far jumps are apart, root mean square [rows], but for those after a lost packet."""
        rows = np.array(list(self.jumps.values())) / row_s
        some = rows[rows > -LOST]
        return float(np.std(some)) if len(some) else 0.0


def with_moments(log: Log) -> Log:
    """The log, with `sent_s` where its commands act before their rows, and a warning that says so.

    As it is where that is known, where its nominal world cannot be built, or shows nothing.
    """
    if SENT in log.samples:
        return log
    try:
        found = _found(log)
    except LogError:
        return log
    if found is None:
        return log
    rows = ((one.episode, np.arange(len(log.episode(one.episode)))) for one in log.episodes)
    early_s = np.concatenate([found.early_s(*one) for one in rows])
    samples = log.samples.assign(**{SENT: log.samples["t_s"] - early_s})
    return replace(log, samples=samples, warnings=(*log.warnings, _said(found)))


def _said(found: Moments) -> str:
    """What was found, in words."""
    most = 1e3 * max(map(abs, found.jumps.values()), default=0.0)
    if not found.lead_s:
        return f"commands that jump act up to {most:.2g} ms before or after the others"
    said = f"commands act {1e3 * found.lead_s:.2g} ms before their rows"
    return f"{said}, those that jump up to {most:.2g} ms sooner or later" if most else said


def _found(log: Log) -> Moments | None:
    """When commands act; None: from their rows on. Raises LogError."""
    as_is = [(fitter, fitter.fit()) for fitter in _fitters(log, ENOUGH_S)]
    if not _leaves(as_is):
        return None
    late = _fitted([_begun(*one) for one in as_is])
    found = _led(late, Moments(lead_s=0.0))
    led = _moved(log, late, found, found.lead_s) if found.lead_s else late
    jumped, jumps = _jumped(log, led, found)
    if jumps != found and _is_nearer(jumped, led):
        led, found = jumped, jumps
    punctual = as_is if found.lead_s else late
    if found == Moments(lead_s=0.0) or not _is_nearer(led, punctual):
        return None
    return _whole(log, led, found) if found.jumps else found


def _fitters(log: Log, enough_s: float) -> Iterator[Fitter]:
    """Fits of every limb to a part of a log."""
    for part in limbs(mjcf_world(log)):
        some, _ = excerpted(log, part, enough_s)
        limb, _ = checked(Limb(spec=part, recordings=some, rigid=True))
        said = evidence(limb)
        known = parameters(catalogue(), said, FREE, EVERYDAY)
        prompt = (replace(p, tolerance=0.0) if p.place == DELAY else p for p in known)
        yield Fitter(said, (*prompt, _LATE))


def _begun(fitter: Fitter, fit: Fit) -> tuple[Fitter, Fit]:
    """Where to fit how late commands act from: late alone, where that leaves less than a fit."""
    late, rows_s = len(fitter.parameters) - 1, SCANNED * fitter.evidence.limb.period_s

    def left(late_s: float) -> float:
        return fitter.excess_at({late: float(late_s)})

    best = int(np.argmin([left(late_s) for late_s in rows_s]))
    ends = rows_s[[max(best - 1, 0), min(best + 1, len(rows_s) - 1)]]
    near = minimize_scalar(left, bounds=ends, method="bounded", options={"maxiter": CLOSER})
    return fitter, replace(fitter.fit(steps=0), u={late: near.x}) if near.fun < fit.excess else fit


def _fitted(fits: Fits) -> Fits:
    """Fits on, with commands that may be late or early."""
    every = ((one, (len(one.parameters) - 1,), fit) for one, fit in fits)
    return [(one, one.fit(late, fit.u, slopes=fit.slopes)) for one, late, fit in every]


def _late_s(fit: Fit) -> float:
    return fit.u.get(fit.freed[0], 0.0)


def _led(fits: Fits, before: Moments) -> Moments:
    """Commands that act earlier by how early all limbs together find them, at most a row."""
    if not np.isfinite(_cost(fits)):
        return before
    late, sd = np.array([(_late_s(fit), fit.sd[fit.freed[0]]) for _, fit in fits]).T
    lead_s = before.lead_s - np.average(late, weights=sd**-2.0)
    row_s = fits[0][0].evidence.limb.period_s
    return replace(before, lead_s=float(np.clip(lead_s, 0.0, row_s)))


def _moved(log: Log, fits: Fits, found: Moments, more_s: float = 0.0) -> Fits:
    """Fits on to commands that act then: earlier by `more_s` for all than in the fits."""
    others = []
    for one, fit in fits:
        limb = one.evidence.limb
        rows = [(r.time_s, r.episode, _rows(log, r)) for r in limb.recordings]
        sent_s = [time_s - found.early_s(number, at) for time_s, number, at in rows]
        u = {**fit.u, fit.freed[0]: _late_s(fit) + more_s}
        others.append((one.of(limb.with_signals(sent_s=sent_s)), replace(fit, u=u)))
    return _fitted(others)


def _jumped(log: Log, fits: Fits, found: Moments) -> tuple[Fits, Moments]:
    """Fits on to jumps that act by themselves, and when; as they are where none do."""
    for _ in range(TURNS):
        if not _leaves(fits) or not np.isfinite(_cost(fits)):
            break
        jumps = _with_jumps(log, fits, found)
        if jumps.apart(fits[0][0].evidence.limb.period_s) < APART:
            break
        found = jumps
        fits = _moved(log, fits, found)
        before_s, found = found.lead_s, _led(fits, found)
        fits = _moved(log, fits, found, found.lead_s - before_s)
    return fits, found


def _with_jumps(log: Log, fits: Fits, found: Moments) -> Moments:
    """Commands whose jumps act when all limbs together show it."""
    shown = dict[tuple[int, int], list[tuple[float, float]]]()
    for one, fit in fits:
        recordings = one.evidence.limb.recordings
        rows = [_rows(log, r) for r in recordings]
        pairs = zip(recordings, rows, strict=True)
        now_s = [found.early_s(r.episode, at) - found.lead_s for r, at in pairs]
        for jump in moved_jumps(one, fit, now_s):
            at = recordings[jump.recording].episode, int(rows[jump.recording][jump.row])
            shown.setdefault(at, []).append((jump.early_s, jump.known + 1e-12))
    each = ((at, np.array(pairs).T) for at, pairs in shown.items())
    return replace(found, jumps={at: float(x @ known / known.sum()) for at, (x, known) in each})


def _whole(log: Log, fits: Fits, found: Moments) -> Moments:
    """With the jumps of all of a log that a diagnosis fits."""
    whole = list(_fitters(log, FITTED_S))
    pairs = list(zip(whole, fits, strict=True))
    if all(len(a.evidence.readings) == len(b.evidence.readings) for a, (b, _) in pairs):
        return found
    there = [(one, one.fit(fit.freed, fit.u, steps=0)) for one, (_, fit) in pairs]
    _, more = _jumped(log, _moved(log, there, found), found)
    return more


def _rows(log: Log, recording: Recording) -> Array:
    """The rows of its episode that a recording has."""
    time_s = log.episode(recording.episode)["t_s"].to_numpy(float)
    return np.searchsorted(time_s - time_s[0], recording.began_s + recording.time_s - 1e-6)


def _is_nearer(fits: Fits, others: Fits) -> bool:
    """Whether fits cost much less than others that leave something, also after fits on."""
    for turn in range(1 + ON):
        if turn:
            fits, others = (
                [(one, one.fit(fit.freed, fit.u)) for one, fit in some] for some in (fits, others)
            )
        if not _leaves(others) or not _cost(fits) < NEARER * _cost(others):
            return False
    return True


def _leaves(fits: Fits) -> bool:
    return any(fit.excess for _, fit in fits)


def _cost(fits: Fits) -> float:
    return sum(fit.excess + fit.prior for _, fit in fits)
