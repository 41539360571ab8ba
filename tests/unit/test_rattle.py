"""Play that rattles: with a play that is a thousandth larger the finger goes another way."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backends.catalogue import catalogue
from backends.shard import simulate
from benchmark.parts import registry
from benchmark.settings.run_spec import RunSpec
from diagnosis.evidence.evidence import evidence
from diagnosis.models.parameters import parameters
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.recording.record import Plan, record
from diagnosis.replay.parts import limbs
from diagnosis.search.chaos import with_prediction_spread
from diagnosis.search.fit import Fitter
from diagnosis.verdict.ordinary import SIMULATORS

PLAY_RAD = math.radians(1.5)


@pytest.fixture(scope="module")
def fitter():
    """Fits of a finger, in steps and triangles."""
    spec = RunSpec(backend="mujoco", task="line", effects="none").world()
    backend = registry.load("backend", "mujoco")
    plan = Plan(protocols=("steps", "triangle"))
    log = record(lambda specs: simulate(backend, specs, 1), spec, plan, source="test")
    part = limbs(spec)[1]
    said = evidence(Limb(spec=part, recordings=recordings(log, part), rigid=False))
    return Fitter(said, parameters(catalogue(), said, 0.05, SIMULATORS.everyday))


def left(fitter, real, **fitted):
    """Gaps of a fit whose first joint has other effects than the real one [floors].

    Of all readings, and of those that its world can predict.
    """
    real, fitted = at(fitter, real), at(fitter, fitted)
    shown = np.where(np.isnan(fitter.evidence.measured), np.nan, fitter.blocks(real))
    there = Fitter(replace(fitter.evidence, measured=shown), fitter.parameters)
    fit = there.fit(tuple(fitted), fitted, steps=0)
    return fit.worst, with_prediction_spread(there, fit, SIMULATORS).worst


def at(fitter, sizes):
    """Parameters of the first joint by the names of their effects."""
    numbers = {(p.effect, p.joint): k for k, p in enumerate(fitter.parameters)}
    return {numbers[name, 0]: size for name, size in sizes.items()}


@pytest.mark.parametrize("off", [0.001, 0.004, -0.003])
def test_a_play_a_thousandth_off_leaves_what_is_ordinary(fitter, off):
    """Leave many floors by one replay, and an ordinary gap in what replays agree on."""
    by_one, predicted = left(fitter, {"backlash": PLAY_RAD}, backlash=PLAY_RAD * (1.0 + off))
    assert by_one > 5.0 * SIMULATORS.floors and predicted < SIMULATORS.floors


@pytest.mark.parametrize("real", [{"kp-scale": -0.3}, {"backlash": 0.7 * PLAY_RAD}])
def test_what_is_wrong_shows_beside_play_that_rattles(fitter, real):
    """Excuse neither another cause nor another size."""
    _, predicted = left(fitter, real, backlash=PLAY_RAD)
    assert predicted > 2.0 * SIMULATORS.floors
