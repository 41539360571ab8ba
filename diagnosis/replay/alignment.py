"""Which command a row of a recording holds: the one that acts from it on, or one that has acted.

A program that sends a command, waits and reads has each reading after its command has acted. A log
has them otherwise (`command_rad` acts from its row's time on), so such commands are a row late.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from backends.catalogue import catalogue
from diagnosis.evidence.evidence import evidence
from diagnosis.evidence.log_faults import checked
from diagnosis.logs.log import Log, LogError
from diagnosis.models.parameters import parameters
from diagnosis.motion.columns import DELAY
from diagnosis.motion.excerpt import excerpted
from diagnosis.motion.limb import Limb
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.search.fit import Fit, Fitter

NEARER = 0.4
"""Commands are a row late where a row earlier costs so much at most: of the squared gap beyond a
floor, and of numbers that are far off, by which a row may be undone."""
MOST_ROWS = 0.2
"""Commands that are a row late are not found to be delayed by more of a row, of all joints."""
FREE = 1.0
"""Standard deviation of the nominal numbers, relative, that are fitted to either: a fault moves no
command."""
ENOUGH_S = 60.0
"""Joint-seconds of a log that show it."""
SENT = ("command", "reference", "feedforward")
"""Kinds of columns that hold what is sent to a drive."""
SAID = "each row is read after its command has acted: commands are taken one row earlier"

Fits = Sequence[tuple[Fitter, Fit]]
"""Of every limb."""


def with_commands_first(log: Log) -> Log:
    """The log, with commands a row earlier where they are a row late, and a warning that says so.

    As it is where its nominal world cannot be built, or shows nothing.
    """
    try:
        if not _is_late(log):
            return log
    except LogError:
        return log
    samples = log.samples.copy()
    columns = [name for name in samples.columns if str(name).startswith(SENT)]
    moved = samples.groupby("episode")[columns].shift(-1)
    samples[columns] = moved.fillna(samples[columns])
    return replace(log, samples=samples, warnings=(*log.warnings, SAID))


def _is_late(log: Log) -> bool:
    """Whether commands a row earlier leave much less, also after fits on; raises LogError."""
    as_is = [(fitter, fitter.fit()) for fitter in _fitters(log)]
    if not any(fit.excess for _, fit in as_is):
        return False
    earlier = [_earlier(*one) for one in as_is]
    if not _is_nearer(earlier, as_is):
        return False
    earlier, as_is = ([(one, one.settled(fit.u)) for one, fit in some] for some in (earlier, as_is))
    return _is_nearer(earlier, as_is)


def _fitters(log: Log) -> Iterator[Fitter]:
    """Fits of every limb to a part of a log."""
    for part in limbs(mjcf_world(log)):
        some, _ = excerpted(log, part, ENOUGH_S)
        limb, _ = checked(Limb(spec=part, recordings=some, rigid=True))
        said = evidence(limb)
        yield Fitter(said, parameters(catalogue(), said, FREE, 1.0))


def _earlier(fitter: Fitter, fit: Fit) -> tuple[Fitter, Fit]:
    """The same fit to commands a row earlier."""
    limb = fitter.evidence.limb
    sent = [np.concatenate([r.command[1:], r.command[-1:]]) for r in limb.recordings]
    other = fitter.of(limb.with_signals(command=sent))
    return other, other.fit(u=fit.u, slopes=fit.slopes)


def _is_nearer(earlier: Fits, as_is: Fits) -> bool:
    """Whether fits cost much less a row earlier, and no delay is found as they are."""
    after, before = (sum(fit.excess + fit.prior for _, fit in some) for some in (earlier, as_is))
    rows = [one.numbers(fit.u)[0][:, DELAY] / one.evidence.limb.period_s for one, fit in as_is]
    return after < NEARER * before and bool(np.concatenate(rows).mean() <= MOST_ROWS)
