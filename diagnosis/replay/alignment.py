"""Which command a row of a recording holds: the one that acts from it on, or one that has acted.

A program that sends a command, waits and reads has each reading after its command has acted. A log
has them otherwise (`command_rad` acts from its row's time on), so such commands are a row late.
"""

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
from diagnosis.search.fit import Fitter

NEARER = 0.4
"""Commands are a row late where they leave, a row earlier, so much of the squared gap at most."""
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


def with_commands_first(log: Log) -> Log:
    """The log, with commands a row earlier where they are a row late, and a warning that says so.

    As it is where its nominal world cannot be built, or shows nothing.
    """
    try:
        if not (_is_late(log) and _is_late(log, settled=True)):
            return log
    except LogError:
        return log
    samples = log.samples.copy()
    columns = [name for name in samples.columns if str(name).startswith(SENT)]
    moved = samples.groupby("episode")[columns].shift(-1)
    samples[columns] = moved.fillna(samples[columns])
    return replace(log, samples=samples, warnings=(*log.warnings, SAID))


def _is_late(log: Log, settled: bool = False) -> bool:
    """Whether commands a row earlier leave much less; raises LogError.

    `settled`: after fits that close no more, which is sure and takes longer.
    """
    as_is, earlier, delays = 0.0, 0.0, np.zeros(0)
    for part in limbs(mjcf_world(log)):
        some, _ = excerpted(log, part, ENOUGH_S)
        limb, _ = checked(Limb(spec=part, recordings=some, rigid=True))
        said = evidence(limb)
        fitter = Fitter(said, parameters(catalogue(), said, FREE, 1.0))
        fit = fitter.settled() if settled else fitter.fit()
        delay_rows = fitter.numbers(fit.u)[0][:, DELAY] / limb.period_s
        as_is, delays = as_is + fit.excess, np.append(delays, delay_rows)
        if as_is > 0.0:
            sent = [np.concatenate([r.command[1:], r.command[-1:]]) for r in limb.recordings]
            other = fitter.of(limb.with_signals(command=sent))
            near = other.fit(u=fit.u, slopes=fit.slopes, again=False)
            earlier += (other.settled() if settled else near).excess
    return earlier < NEARER * as_is and bool(delays.mean() <= MOST_ROWS)
