"""Play in logs that are slower than their drives: by where joints rest, else not claimed."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from backends.catalogue import catalogue
from backends.effect import with_effects
from benchmark.gap.take_home import take_home
from benchmark.settings.effects import parse_effects
from diagnosis.evidence.evidence import Evidence
from diagnosis.evidence.evidence import evidence as gathered
from diagnosis.logs.log import DriveSettings, EpisodeMeta, Log, LogMeta, MjcfMechanism, make_log
from diagnosis.motion.columns import table
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.verdict.lost_motion import lost_motion, play, rests
from diagnosis.verdict.result import Nominal
from diagnosis.walk import diagnose

LEVER = """
<mujoco model="lever"><worldbody><body>
  <joint name="servo" axis="0 0 1" armature="0.03"/>
  <inertial pos="0.05 0 0" mass="0.02" diaginertia="1e-7 2e-5 2e-5"/>
</body></worldbody></mujoco>
"""
KP, PUSH_NM, ROW_S = 40.0, 0.3, 0.1
SHARE = 0.1
"""Uncertainty of the nominal drive."""
RAMP = PUSH_NM * np.array([0.3, 0.7, 1, 1, 1, 1, 1, 0.7, 0.3])
REST, STROKE = np.zeros(9), np.zeros(12)
CYCLE = np.concatenate([STROKE, RAMP, REST, -RAMP, REST, RAMP, REST])
"""Pushes of one cycle, which begins with a stroke to the side and back."""
PUSH = np.concatenate([CYCLE, -CYCLE, CYCLE, -CYCLE])
STROKES = np.concatenate([np.where(np.arange(len(CYCLE)) < 6, s, 0.0) for s in (1, -1, 1, -1)])
COMMAND = 0.15 * STROKES
DRIVES = {
    "free": (0.0, "motor"),
    "light": (0.3, "motor"),
    "half": (0.5, "motor"),
    "heavy": (0.8, "motor"),
    "held": (1.2, "motor"),
    "on the joint": (0.7, "joint"),
}
"""Friction over the push, and where the loop is closed."""


def recorded(reading: np.ndarray, row_s: float = ROW_S) -> Log:
    """A log of the lever."""
    servo = DriveSettings(kp=KP, kd=1.0, limit=8.0)
    meta = LogMeta(
        schema=1,
        source="a lever",
        mechanism=MjcfMechanism(mjcf="lever.xml", joints={"servo": servo}),
        episodes=(EpisodeMeta(episode=0, protocol="push"),),
        nominal_uncertainty=SHARE,
    )
    columns = {
        "t_s": row_s * np.arange(len(PUSH)),
        "command_rad.servo": COMMAND,
        "position_rad.servo": reading,
        "push_nm.servo": PUSH,
    }
    return make_log(meta, pd.DataFrame(columns), LEVER)


def evidence(reading: np.ndarray, row_s: float = ROW_S) -> Evidence:
    """Evidence of a log of the lever."""
    log = recorded(reading, row_s)
    (part,) = limbs(mjcf_world(log))
    return gathered(Limb(spec=part, recordings=recordings(log, part), rigid=True))


def at_equilibrium(half_rad: float, friction_nm: float, loop: str) -> np.ndarray:
    """Where a joint that stays where nothing moves it would be read: a plant of other equations.

    Motor and joint move no further than friction, teeth without give and the drive's pull ask for.
    """
    motor = joint = 0.0
    read = [0.0]
    for push, command in zip(PUSH[:-1], COMMAND[:-1], strict=True):
        about = motor if loop == "motor" else joint
        if push != 0.0 and loop == "joint":
            about = motor + np.sign(push) * half_rad
        low, high = command + (push - friction_nm) / KP, command + (push + friction_nm) / KP
        moved = np.clip(about, low, high) - about
        if loop == "joint" and push == 0.0 and moved != 0.0:
            moved += joint - motor - np.sign(-moved) * half_rad
        motor += moved
        ends = motor - half_rad, motor + half_rad
        joint = ends[int(push > 0)] if push != 0.0 else float(np.clip(joint, *ends))
        read.append(joint)
    return np.array(read)


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("half_rad", [0.008, 0.016])
def test_play_is_found_whatever_the_friction(drive, half_rad):
    """Name backlash, and hold its size in the interval; a loop on the joint pulls some back."""
    share, loop = DRIVES[drive]
    found = play(evidence(at_equilibrium(half_rad, share * PUSH_NM, loop)), 0, SHARE)
    assert found is not None and found.joint == "servo"
    assert found.interval_rad[0] <= half_rad
    assert half_rad <= found.interval_rad[1] or loop == "joint"
    assert found.after < found.before and found.share > 0.7


@pytest.mark.parametrize("drive", DRIVES)
def test_friction_is_no_play(drive):
    """Find nothing where friction alone makes a joint rest on the side that it was pushed to."""
    share, loop = DRIVES[drive]
    assert play(evidence(at_equilibrium(0.0, share * PUSH_NM, loop)), 0, SHARE) is None


@pytest.mark.parametrize(
    "effects", ["none", "coulomb-friction=150mNm", "stiction=200mNm", "kp-scale=-60%"]
)
def test_what_moves_otherwise_is_no_play(effects):
    """Find nothing in what the drive law shows of friction and of softer drives."""
    limb = evidence(COMMAND).limb
    world = with_effects(limb.spec, parse_effects(effects, limb.spec.hand))
    shown = limb.simulate(table(world, rigid=True), edges=limb.every_sample)[:, 0, 0]
    assert play(evidence(shown), 0, SHARE) is None


def test_a_slow_log_is_diagnosed_at_rest():
    """Name play, correct it alone, and say what this log cannot distinguish it from."""
    said = diagnose(recorded(at_equilibrium(0.016, 0.3 * PUSH_NM, "motor")))
    assert said.verdict == ("backlash",) and said.joints == ("servo",)
    assert said.limbs[0].tied == (("dead-zone@servo",),)
    assert any("motor's angle" in text for text in said.limbs[0].sentences)
    assert said.share > 0.9
    (size, _, _), *_ = (cause.sizes for cause in said.magnitudes)
    assert said.corrected == {"servo": {"drive.play_rad": pytest.approx(size)}}


def test_rests_are_what_a_written_play_is_measured_by():
    """Measure the gap in plain MuJoCo where joints rest, and say where it does not shrink."""
    log = recorded(at_equilibrium(0.016, 0.0, "motor"))
    found, world = diagnose(log), mjcf_world(log)
    gap = found.in_mujoco
    assert gap is not None and gap.at_rest and gap.after_rad < 0.5 * gap.before_rad
    home = take_home(log, world, found, catalogue())
    assert home is not None and not home.less and "where pushed joints rest" in home.words[-1]
    worse = dataclasses.replace(gap, after_rad=1.1 * gap.before_rad)
    home = take_home(log, world, dataclasses.replace(found, in_mujoco=worse), catalogue())
    assert home is not None and "less than the verdict says: most of it is" in home.words[-1]


def test_what_stays_as_it_is_is_no_change():
    """List no refitted number that the corrected world has as the file does."""
    log = recorded(at_equilibrium(0.016, 0.0, "motor"))
    found = diagnose(log)
    stays = Nominal(effect="viscous-friction", joint="servo", value=1.0, sd=1.0, unit="mNms/rad")
    (limb,) = found.limbs
    found = dataclasses.replace(found, limbs=(dataclasses.replace(limb, nominal=(stays,)),))
    home = take_home(log, mjcf_world(log), found, catalogue())
    assert home is not None and [one.number for one in home.changes] == ["range of the play"]


def test_no_play_is_named_without_a_name_for_it():
    """Leave the result alone where no effect of the catalogue is play."""
    kinds = {name: kind for name, kind in catalogue().items() if name != "backlash"}
    said = diagnose(recorded(at_equilibrium(0.016, 0.3 * PUSH_NM, "motor")), catalogue=kinds)
    assert "backlash" not in said.verdict


def test_lost_motion_is_what_lies_between_the_sides():
    """Measure play and yield under a push, and the play after it, of a drive without friction."""
    found = rests(evidence(at_equilibrium(0.005, 0.0, "motor")), 0)
    pushed, released = lost_motion(found)
    assert pushed == pytest.approx(2 * (0.005 + PUSH_NM / KP), rel=1e-6)
    assert released == pytest.approx(2 * 0.005, rel=1e-6)
    assert found["push_nm"].to_numpy() == pytest.approx(PUSH_NM)


def test_a_log_without_pushes_both_ways_has_no_lost_motion():
    """Say nothing where pushes come from one side."""
    part = evidence(at_equilibrium(0.01, 0.0, "motor"))
    (recording,) = part.limb.recordings
    one_way = dataclasses.replace(recording, push=np.abs(recording.push))
    limb = dataclasses.replace(part.limb, recordings=(one_way,))
    assert rests(dataclasses.replace(part, limb=limb), 0).empty


def test_rests_say_nothing_of_what_shows_in_motion():
    """Look for no delay, damping or inertia where only rests are judged, and say that they are."""
    kinds = {name: kind for name, kind in catalogue().items() if name != "backlash"}
    found = diagnose(recorded(at_equilibrium(0.016, 0.3 * PUSH_NM, "motor")), catalogue=kinds)
    sought = {cause.effect for limb in found.limbs for cause in (*limb.causes, *limb.leading)}
    assert sought and not sought & {"kd-scale", "viscous-friction", "command-rate-limit"}
    assert any("only rests are judged" in note for note in found.notes)
