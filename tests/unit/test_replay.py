"""The replay of limbs in closed form moves them as engines do."""

import dataclasses

import numpy as np
import pytest

from backends.spec import Spec
from backends.state import Array
from benchmark.parts.registry import load
from diagnosis.blind import motion, rigs
from diagnosis.motion.batch import replay
from diagnosis.motion.limb import Limb, unread
from diagnosis.motion.recordings import Recording


def asked(spec: Spec, start: Array) -> Recording:
    """Steps of a rig, a sample every 5 ticks."""
    one = motion.motion("steps", spec, np.random.default_rng(0))
    return Recording(
        protocol="steps",
        time_s=np.arange(250) * 5 * spec.timing.drive_s,
        command=one.target_rad[:250],
        push=one.push_nm[:250],
        measured=np.broadcast_to(start, (250, 3, len(start))),
        start=start,
    )


@pytest.mark.parametrize("rig", ["joint", "finger"])
@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"command-delay": 6.3e-3},
        {"command-delay": 0.013, "command-rate-limit": 0.1, "kp-scale": -0.2},
        {"command-delay": 6.3e-3, "command-resolution": 0.02},
        {"sensor-delay": 6.3e-3, "encoder-scale": 0.1, "encoder-bias": 0.02},
        {"encoder-eccentricity": 0.03, "encoder-eccentricity-sine": -0.05, "encoder-bias": 0.02},
        {"stiction": 0.05, "coulomb-friction": 0.02, "dead-zone": 0.01},
        {"direction-friction": -0.05, "coulomb-friction": 0.02},
        {"torque-speed-limit": 0.1, "torque-limit": -0.3},
        {"cogging": 0.1, "coulomb-friction": 0.02},
        {"end-stop": 0.8, "backlash": 0.01},
        {"end-stop": -0.8},
        {"thermal-fade": 16.0, "presliding": 0.05, "cogging": 0.05},
        {"presliding": 0.1, "backlash": 0.01},
        {"self-lock": 0.5, "load-friction": 0.3, "encoder-scale": 0.1},
        {"link-mass": 0.5, "payload": 0.4, "gravity-tilt": 0.2},
    ],
)
def test_closed_form_is_the_engines_motion(rig, effects):
    """Show the positions and motor angles of MuJoCo with the same drives, paths and sensors."""
    nominal, spec = (without_noise(rigs.nominal(rig)) for _ in range(2))
    for name, size in effects.items():
        spec = load("effect", name)(magnitude=size).on_spec(spec)
    start = motion.motion("steps", nominal, np.random.default_rng(0)).target_rad[0] + 0.01
    one = asked(nominal, start)
    limb = Limb(spec=spec, recordings=(one,), rigid=False, exact=True)
    assert limb.closed
    angle = unread(start, limb.nominal)
    moved = dataclasses.replace(
        one, start=angle, measured=np.broadcast_to(angle, one.measured.shape)
    )
    engine = load("backend", "mujoco")
    (real,) = replay(lambda specs: engine(specs), [spec], [moved])
    assert np.ptp(real[0, :, 0], axis=0).min() > 0.05
    shown = limb.simulate(limb.nominal, edges=limb.every_sample)
    assert np.abs(shown[1:, :2] - real[0, 1:]).max() < 1e-6


def without_noise(spec: Spec) -> Spec:
    """A world whose sensors read without noise."""
    return spec.with_driven(
        dataclasses.replace(
            body,
            joint=dataclasses.replace(
                body.joint, encoder=dataclasses.replace(body.joint.encoder, noise_rad=0.0)
            ),
        )
        for body in spec.hand.driven
    )
