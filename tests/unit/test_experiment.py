"""The experiment that distinguishes tied causes, against the user's file in plain MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from arms import Real, log_of

from backends.catalogue import catalogue
from backends.effect import NumberEffect
from diagnosis.evidence.evidence import evidence
from diagnosis.models.parameters import parameters
from diagnosis.motion.columns import by_name, with_numbers
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.recording.excitation import FREE, Joints
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.replay.plain import model_text, plain, shown
from diagnosis.search.fit import Fitter
from diagnosis.verdict.experiment import experiment
from diagnosis.verdict.ordinary import ROBOTS


@pytest.fixture(scope="module")
def log():
    """The log of an arm with nothing wrong."""
    return log_of(Real())


@pytest.fixture(scope="module")
def fitter(log):
    """Fits of it."""
    (part,) = limbs(mjcf_world(log))
    said = evidence(Limb(spec=part, recordings=recordings(log, part), rigid=True))
    return Fitter(said, parameters(catalogue(), said, 0.05, ROBOTS.everyday))


def at(fitter, **sizes):
    """Parameters of the first joint by the names of their effects."""
    numbers = {(p.effect, p.joint): k for k, p in enumerate(fitter.parameters)}
    return {numbers[name.replace("_", "-"), 0]: size for name, size in sizes.items()}


def standing(fitter, u):
    """A fit of effects that stand at u."""
    return replace(fitter.fit(steps=0), freed=tuple(u), u=u)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"coulomb_friction": 0.02}, {"viscous_friction": 0.05}),
        ({"kp_scale": -0.1}, {"viscous_friction": 0.3}),
        ({"rotor_inertia": 0.5}, {"kd_scale": 0.2}),
    ],
)
def test_the_named_protocol_shows_most_in_plain_mujoco(log, fitter, one, other):
    """Name the protocol in which plain MuJoCo with both files moves furthest apart."""
    ends = [at(fitter, **sizes) for sizes in (one, other)]
    first, *others = (standing(fitter, u) for u in ends)
    said = experiment(fitter, first, others)
    texts = [model_text(log, _world(fitter, u)) for u in ends]
    apart = {}
    for protocol in FREE:
        motion, spec = _recording(fitter.evidence.limb, protocol), fitter.evidence.limb.spec
        a, b = (shown(plain(log, text, ("J0",), 5e-4), motion, spec) for text in texts)
        apart[protocol] = float(np.sqrt(np.mean((a - b) ** 2)))
    assert f"--protocol {max(apart, key=apart.get)}" in said, (said, apart)


@pytest.mark.parametrize(
    ("effect", "instead"), [("kp_scale", "the motor's angle"), ("link_mass", "weigh these links")]
)
def test_worlds_that_no_motion_distinguishes_need_something_else(fitter, effect, instead):
    """Say what, where two worlds show the same in every protocol."""
    same = standing(fitter, at(fitter, **{effect: 0.1}))
    assert instead in experiment(fitter, same, [same])


def _world(fitter, u):
    """The nominal world with parameters at u, of numbers that an MJCF has."""
    spec = fitter.evidence.limb.spec
    for k, size in u.items():
        kind = fitter.parameters[k].kind
        assert issubclass(kind, NumberEffect)
        row = fitter.numbers({k: size})[0]
        spec = with_numbers(spec, dict(zip(spec.hand.joint_names, map(by_name, row), strict=True)))
    return spec


def _recording(limb, protocol):
    """An episode of the arm under a protocol, in the range of its log."""
    command = np.concatenate([r.command for r in limb.recordings])
    asked = FREE[protocol](
        Joints(
            names=limb.joints,
            center_rad=np.median(command, axis=0),
            range_rad=np.stack([command.min(axis=0), command.max(axis=0)], axis=1),
            limit_nm=np.array([d.torque_limit_nm for d in limb.spec.drives]),
        ),
        1.0 / limb.period_s,
    )
    return replace(
        limb.recordings[0],
        time_s=asked.t_s,
        command=asked.target_rad,
        push=asked.push_nm,
        start=asked.target_rad[0],
    )
