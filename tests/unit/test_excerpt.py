"""Parts of long logs."""

import re

import numpy as np
import pandas as pd
import pytest

from backends.mjcf import Plain, Play
from diagnosis import diagnose
from diagnosis.logs.log import Log, LogError, LogMeta, make_log
from diagnosis.motion.excerpt import FITTED_S, PIECE_S, SEARCHED_S, excerpt, excerpted
from diagnosis.motion.recordings import Recording, recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.triage.triage import triage

ARM = """<mujoco><worldbody><body><joint name="a" axis="0 1 0" armature="0.02"/>
<inertial mass="0.8" pos="0.15 0 0" diaginertia="8e-4 4e-3 4e-3"/></body></worldbody>
<actuator><position joint="a" kp="40" kv="1.2" forcerange="-8 8"/></actuator></mujoco>"""
META = {"schema": 1, "source": "test", "mechanism": {"mjcf": "arm.xml"}}

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
    """Take less than a minute of ten, from both of two episodes that move one joint each."""
    part = excerpt((recording(400.0, [1, 0]), recording(200.0, [0, 1])), SEARCHED_S)
    assert 0.45 < lasts_s(part) / SEARCHED_S < 0.67
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
    assert 0.45 < lasts_s(excerpt((held,), SEARCHED_S)) / SEARCHED_S < 0.67


def test_fits_take_more_than_a_search():
    """Take five times as much of a very long log."""
    part = excerpt((recording(3000.0, [1, 1]),), FITTED_S)
    assert 290.0 < lasts_s(part) < 330.0


def swinging(seconds):
    """A joint that never rests, and follows 20 ms late."""
    time_s = np.arange(int(seconds * HZ)) / HZ
    swing = [np.sin(t) + 0.3 * np.sin(2.3 * t) for t in (time_s, time_s - 0.02)]
    blank = np.full((len(time_s), 1), np.nan)
    read = np.stack([swing[1][:, None], blank, blank], axis=1)
    none = np.zeros_like(blank)
    return Recording(
        protocol="free",
        time_s=time_s,
        command=swing[0][:, None],
        push=none,
        measured=read,
        start=read[0, 0],
    )


def test_what_never_rests_is_not_cut():
    """Take pieces of all of a log without a rest; they begin as it moves there."""
    part = excerpt((swinging(1800.0),), SEARCHED_S)
    assert max(one.began_s for one in part) > 900.0
    for one in part[1:]:
        time_s = one.began_s - 0.02
        assert one.start == pytest.approx(np.sin(time_s) + 0.3 * np.sin(2.3 * time_s), abs=1e-3)
        assert one.rate == pytest.approx(np.cos(time_s) + 0.69 * np.cos(2.3 * time_s), abs=1e-2)


@pytest.mark.parametrize("at_s", [412.3, 1533.0])
def test_what_happens_once_is_taken(at_s):
    """Take the one second of half an hour in which a joint does not follow."""
    whole = swinging(1800.0)
    once = (whole.time_s > at_s) & (whole.time_s < at_s + 1.0)
    whole.measured[once, 0] += 0.03
    part = excerpt((whole,), SEARCHED_S)
    assert any(r.began_s <= at_s and at_s + 1.0 <= r.began_s + r.time_s[-1] for r in part)
    assert lasts_s(part) <= SEARCHED_S + PIECE_S


def test_a_log_is_thinned_as_its_recordings_are():
    """Take the same pieces of a log, which is read by parts, as of all its recordings."""
    whole = swinging(1800.0)
    columns = {"command_rad.a": whole.command[:, 0], "position_rad.a": whole.measured[:, 0, 0]}
    log = make_log(
        LogMeta.model_validate(META),
        pd.DataFrame({"t_s": whole.time_s, "episode": 0} | columns),
        ARM,
    )
    world = mjcf_world(log)
    (part, lasts), again = (
        excerpted(log, world, SEARCHED_S),
        excerpt(recordings(log, world), SEARCHED_S),
    )
    assert lasts == pytest.approx(whole.time_s[-1]) and len(part) == len(again)
    for one, other in zip(part, again, strict=True):
        assert one.began_s == pytest.approx(other.began_s)
        assert np.allclose(one.measured, other.measured, equal_nan=True)
        assert np.allclose(one.start, other.start, atol=1e-9)


def test_a_log_without_free_air_is_refused():
    """Say so where the stick is in the hand in every episode."""
    rows = {"t_s": np.arange(300) / HZ, "episode": 0, "command_rad.a": 0.0, "position_rad.a": 0.0}
    held = META | {"episodes": [{"episode": 0, "protocol": "grasp"}]}
    log = make_log(LogMeta.model_validate(held), pd.DataFrame(rows), ARM)
    with pytest.raises(LogError, match="0 s in free air"):
        excerpted(log, mjcf_world(log), SEARCHED_S)


def wandering(real: str, never: float = 0.0) -> Log:
    """Half an hour of an arm in plain MuJoCo that never rests, and is far out for 30 s."""
    time_s = np.arange(0, 1800, 1 / HZ)
    knots = 0.25 * np.random.default_rng(0).normal(size=1801).clip(-1.5, 1.5)
    command = np.interp(time_s, np.arange(1801.0), knots)
    command += np.interp(time_s, [1195, 1200, 1230, 1235], [0.0, 0.7, 0.7, 0.0])
    asked = Play(
        time_s=time_s,
        command=command[:, None],
        push=np.zeros((len(time_s), 1)),
        start=command[:1],
    )
    position = Plain(real, ["a"], {}).positions(asked)[:, 0]
    position += 2e-4 * np.random.default_rng(1).normal(size=len(time_s))
    position = np.where((time_s > 1533.0) & (time_s < 1535.0), position - never, position)
    frame = {"t_s": time_s, "episode": 0, "command_rad.a": command, "position_rad.a": position}
    return make_log(LogMeta.model_validate(META), pd.DataFrame(frame), COARSE)


COARSE = ARM.replace(
    "<worldbody>", '<option timestep="0.005" integrator="implicitfast"/><worldbody>'
)


def test_a_pause_in_a_long_log_is_said_with_its_time():
    """Say when in half an hour a joint did not follow for two seconds."""
    log = wandering(COARSE, never=0.8)
    (said,) = triage(log, mjcf_world(log))
    assert re.fullmatch(r"a did not follow from 1533.0 to 1535.0 s of episode 0", said)


@pytest.mark.slow
def test_a_fault_that_shows_in_one_stretch_is_named():
    """Name the end stop that a joint reaches in 30 s of half an hour, and where it is."""
    stopped = COARSE.replace('axis="0 1 0"', 'axis="0 1 0" limited="true" range="-180 40"')
    found = diagnose(wandering(stopped))
    assert found.verdict == ("end-stop",) and "at 4" in found.magnitudes[0].also
