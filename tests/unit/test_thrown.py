"""A healthy arm whose last, light joint is thrown about: no step of a replay follows that."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from diagnosis.blind import arms, motion
from diagnosis.evidence.evidence import evidence, squared_gaps
from diagnosis.logs.log import Log, LogMeta, make_log
from diagnosis.models.world import World
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import Recording, recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.replay.plain import model_text, plain, shown
from diagnosis.search.chaos import spreading
from diagnosis.verdict.ordinary import ROBOTS

JOINTS, SEED, HZ, DRAW = 6, 805586689, 200.0, 4


def commands() -> Log:
    """The four protocols of the arm, with targets in place of readings."""
    frames, nominal = [], arms.spec(JOINTS, SEED)
    for number, protocol in enumerate(motion.PROTOCOLS):
        asked = motion.motion(protocol, nominal, np.random.default_rng(DRAW), HZ)
        columns = {"episode": number, "t_s": motion.times_s(HZ)}
        for j in range(JOINTS):
            columns[f"command_rad.j{j}"] = columns[f"position_rad.j{j}"] = asked.target_rad[:, j]
            columns[f"push_nm.j{j}"] = asked.push_nm[:, j]
        frames.append(pd.DataFrame(columns))
    meta = LogMeta(schema=1, source="test", mechanism=arms.described(JOINTS, SEED))
    return make_log(meta, pd.concat(frames), arms.mjcf(arms.sheet(JOINTS, SEED)))


@pytest.fixture(scope="module")
def world() -> World:
    """The nominal world of what plain MuJoCo does with the same numbers."""
    log = commands()
    (part,) = limbs(mjcf_world(log))
    limb = Limb(spec=part, recordings=recordings(log, part), rigid=True)
    free = re.sub(r' range="[^"]*"', "", model_text(log, part))  # no stop is in its way
    engine = plain(log, free, limb.joints, limb.dt)
    read = tuple(_read(one, shown(engine, one, limb.spec)) for one in limb.recordings)
    return World(evidence(replace(limb, recordings=read)))


def _read(asked: Recording, position: np.ndarray) -> Recording:
    """A recording with what was read."""
    measured = asked.measured.copy()
    measured[:, 0] = position
    return replace(asked, measured=measured)


def gaps(world: World) -> np.ndarray:
    """The gap of each joint [floors]."""
    said = world.evidence
    return np.sqrt(squared_gaps(said, said.readings - world.shown({})))


def test_a_thrown_joint_leaves_an_ordinary_gap(world):
    """Count a joint beyond 20 rad/s in what steps predict, and a calm one as it is."""
    steps = world.evidence.limb.recordings[0].measured[:, 0]
    speed = np.abs(np.diff(steps, axis=0)).max() * HZ
    before, after = gaps(world), gaps(World(spreading(world)))
    assert speed > 20.0 and before.max() > 1.5 * ROBOTS.floors
    assert after.max() < ROBOTS.floors
    assert after[0] == pytest.approx(before[0], rel=0.1)
