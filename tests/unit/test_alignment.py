"""Recordings whose rows are read after their command has acted are logs like others."""

from dataclasses import replace

import pytest
from arms import Real, log_of

from diagnosis.logs.log import Log
from diagnosis.replay.alignment import SAID, with_commands_first
from diagnosis.solver import solve


def read_late(log: Log) -> Log:
    """The log as a program writes it that sends, waits and reads."""
    samples = log.samples.copy()
    sent = [name for name in samples.columns if name.startswith("command")]
    late = samples.groupby("episode")[sent].shift(1)
    samples[sent] = late.fillna(samples[sent])
    return replace(log, samples=samples)


@pytest.mark.parametrize(("kp", "verdict"), [({}, "none"), ({0: 0.6}, "kp-scale")])
def test_a_row_that_is_read_after_its_command_acted(kp, verdict):
    """Take commands a row earlier, say so, and name what is wrong beside it."""
    late = read_late(log_of(Real(joints=2, kp=kp)))
    log = with_commands_first(late)
    assert log.warnings[-1] == SAID
    assert solve(log).verdict == (verdict,)


@pytest.mark.parametrize(
    "real",
    [
        Real(),
        Real(kp={0: 0.5}),
        Real(kp={0: 2.0}),
        Real(coulomb_nm={0: 2.0}),
        Real(delay_s=0.02),
        Real(lost_share=0.3),
        Real(spring_nm_rad3=400.0),
    ],
)
def test_no_fault_moves_a_command(real):
    """Leave logs as they are whose commands act from their rows on."""
    log = log_of(real)
    assert with_commands_first(log) is log
