"""A stick that is pulled slips where the pull and its weight outdo friction, in every engine."""

import dataclasses

import numpy as np
import pytest

from backends.shard import simulate
from backends.state import InitialState
from benchmark.parts import registry
from benchmark.settings.run_spec import RunSpec
from tasks.initial_states import sample_initial_states

RATE_N_S = 20.0
"""So slow that a stick moves by much less than a millimetre before it slips."""
GRIP_S, SLIPPED_M = 0.5, 1e-3
SLIPS_AT = 0.08
"""Bullet's pyramid of friction holds by some hundredths more than a cone off its axes."""


def world(backend: str, effects: str = "none"):
    spec = RunSpec(backend=backend, task="circle", effects=effects).world()
    return dataclasses.replace(spec, timing=dataclasses.replace(spec.timing, policy_s=0.005))


def pulled(backend: str, spec, workers: int = 1, count: int = 1, seconds: float = 2.0):
    """Heights of the sticks (T, N) [m], their pulls [N] and the squeeze on each [N]."""
    start = sample_initial_states([spec], np.random.default_rng(3))
    fields = [f.name for f in dataclasses.fields(InitialState)]
    starts = InitialState(**{f: np.repeat(getattr(start, f), count, axis=0) for f in fields})
    target = starts.joint_rad + np.array(spec.hand.preload_rad)
    simulator = simulate(registry.load("backend", backend), [spec] * count, workers)
    height, pull, squeeze = [], [], []
    try:
        state = simulator.reset(starts, np.ones(count, dtype=bool))
        for k in range(round(seconds / spec.timing.policy_s)):
            height.append(state.stick_pos_m[:, 2].copy())
            pull.append(RATE_N_S * max(k * spec.timing.policy_s - GRIP_S, 0.0))
            squeeze.append(np.linalg.norm(state.contact_force_n, axis=-1).sum(axis=1))
            state = simulator.advance(target, None, np.full(count, pull[-1]))
    finally:
        simulator.close()
    return np.array(height), np.array(pull), np.array(squeeze)


@pytest.mark.parametrize("backend", registry.names("backend"))
@pytest.mark.parametrize("effects", ["none", "contact-friction=-40%", "stick-mass=300%"])
def test_a_pulled_stick_slips_at_the_cone(backend, effects):
    """Slip where pull and weight reach friction times the sum of the normal forces."""
    spec = world(backend, effects)
    height, pull, squeeze = pulled(backend, spec)
    held = int(np.argmax(pull > 0)) - 1
    slips = int(np.argmax(height[:, 0] < height[held, 0] - SLIPPED_M))
    weight_n = -spec.gravity_m_s2[2] * spec.stick.mass_kg
    assert slips > held + 1
    cone_n = spec.stick.friction * squeeze[slips - 2, 0]
    assert pull[slips - 1] + weight_n == pytest.approx(cone_n, rel=SLIPS_AT)


@pytest.mark.parametrize(
    "backend",
    [
        pytest.param(name, marks=() if name == "bullet" else pytest.mark.slow)
        for name in registry.usual("backend")
    ],
)
def test_processes_pull_alike(backend):
    """Pull worlds over two processes as in one."""
    spec = world(backend)
    one, two = (pulled(backend, spec, workers, 2, 1.2)[0] for workers in (1, 2))
    assert np.array_equal(one, two)


def test_a_stick_that_is_out_is_let_go():
    """Let a stick that no fingertip touches fall freely, whatever is pulled."""
    spec = world("mujoco")
    height, *_ = pulled("mujoco", spec, seconds=2.5)
    late = height[-20:, 0]
    dt_s = spec.timing.policy_s
    assert np.diff(late, n=2) / dt_s**2 == pytest.approx(spec.gravity_m_s2[2], rel=1e-3)
