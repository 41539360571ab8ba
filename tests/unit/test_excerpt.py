"""Parts of long logs."""

import numpy as np

from diagnosis.motion.excerpt import FITTED_S, SEARCHED_S, excerpt
from diagnosis.motion.recordings import Recording

HZ = 100


def recording(seconds, moving):
    """Two joints that step every two seconds and then rest; `moving` (K,) of them at all."""
    time_s = np.arange(int(seconds * HZ)) / HZ
    step = np.where((time_s / 2.0).astype(int) % 2, 0.4, 0.0)
    command = step[:, None] * np.array(moving, dtype=float)
    lag = np.exp(-(time_s % 2.0) / 0.1)[:, None]
    position = command + lag * (np.roll(command, 2 * HZ, axis=0) - command)
    blank = np.full_like(position, np.nan)
    return Recording(
        protocol="free",
        time_s=time_s,
        command=command,
        push=np.zeros_like(command),
        measured=np.stack([position, blank, blank], axis=1),
        start=position[0],
    )


def lasts_s(recordings):
    """How long recordings last together."""
    return sum(r.time_s[-1] for r in recordings)


def test_a_short_log_stays_whole():
    """Give the recordings as they are where a search is quick on all."""
    whole = (recording(20.0, [1, 1]), recording(20.0, [1, 1]))
    assert excerpt(whole, SEARCHED_S) == whole


def test_a_part_of_a_long_log_moves_every_joint():
    """Take a minute of ten, from both of two episodes that move one joint each."""
    part = excerpt((recording(400.0, [1, 0]), recording(200.0, [0, 1])), SEARCHED_S)
    assert 55.0 < lasts_s(part) < 80.0
    moved = sum(np.abs(np.diff(r.command, axis=0)).sum(axis=0) for r in part)
    assert moved.min() > 0.3 * moved.max()


def test_pieces_begin_at_rest():
    """Begin where the reading is at its target and stays there."""
    part = excerpt((recording(600.0, [1, 1]),), SEARCHED_S)
    for one in part:
        assert np.allclose(one.start, one.command[0], atol=5e-3)
        assert one.time_s[0] == 0.0


def test_a_joint_that_is_held_rests():
    """Cut a log in which one joint only scatters about its target."""
    held = recording(600.0, [1, 0])
    held.measured[:, 0, 1] += np.random.default_rng(0).normal(0.0, 4e-4, len(held.time_s))
    assert 55.0 < lasts_s(excerpt((held,), SEARCHED_S)) < 80.0


def test_fits_take_more_than_a_search():
    """Take ten times as much of a very long log."""
    part = excerpt((recording(3000.0, [1, 1]),), FITTED_S)
    assert 590.0 < lasts_s(part) < 650.0
