"""MuJoCo Warp on its CPU device: its drive law is the engines', and a grasp is MuJoCo's.

The suites that every engine goes through hold it as well, among the slow tests.
"""

from dataclasses import astuple, fields, replace
from importlib.util import find_spec

import numpy as np
import pytest

from backends.drive import MEMORY, drive_step
from backends.spec import Drive, Spec
from backends.state import Array, State
from benchmark.parts import registry
from benchmark.settings.run_spec import RunSpec
from tasks.initial_states import sample_initial_states

pytestmark = pytest.mark.skipif(
    find_spec("mujoco_warp") is None, reason="install it with the extra 'warp'"
)
WORLDS, JOINTS, DT_S = 200, 6, 1e-3
LARGEST = Drive(
    kp_nm_rad=20.0,
    kd_nms_rad=0.5,
    torque_limit_nm=1.0,
    rotor_inertia_kgm2=1e-3,
    coulomb_nm=0.1,
    viscous_nms_rad=0.1,
    gear_stiffness_nm_rad=100.0,
    gear_damping_nms_rad=0.1,
    play_rad=0.02,
    lock_nm=0.2,
    stiction_nm=0.1,
    load_friction=0.5,
    dead_zone_rad=0.01,
    one_way_friction_nm=0.1,
    limit_fall_nms_rad=2.0,
    cogging_nm=0.1,
    cogging_period_rad=0.1,
    cogging_phase_rad=3.0,
    end_stop_rad=0.02,
    end_stop_nm_rad=50.0,
    spring_nm_rad=2.0,
    spring_rest_rad=0.3,
    weakness=0.5,
    thermal_fade=5.0,
    thermal_s=0.01,
    presliding_nm=0.1,
    presliding_rad=0.002,
)
OFTEN_ZERO = [f.name for f in fields(Drive) if f.name not in ("kp_nm_rad", "rotor_inertia_kgm2")]


def world(stick: str = "reference", effects: str = "built") -> Spec:
    """The nominal world of a run."""
    return RunSpec(backend="mujoco", task="line", stick=stick, effects=effects).world()


def drives(rng: np.random.Generator) -> Array:
    """Numbers of random drives (N, J, 26), each of which is often zero where it may be."""
    largest = np.array(astuple(LARGEST))
    numbers = largest * rng.uniform(0.2, 1.0, (WORLDS, JOINTS, len(largest)))
    for column, field in enumerate(fields(Drive)):
        if field.name in OFTEN_ZERO:
            numbers[..., column] *= rng.random((WORLDS, JOINTS)) < 0.6
    return np.pad(numbers, ((0, 0), (0, 0), (0, len(MEMORY))))


def test_the_drive_law_is_the_same_to_1e_6():
    """Step random drives as the compiled law of all engines does."""
    import warp as wp

    from backends._warp_drive import drive_tick

    rng = np.random.default_rng(0)
    p = drives(rng)
    shape = WORLDS, JOINTS
    target, joint, motor = (rng.normal(0.0, 0.02, shape) for _ in range(3))
    joint, joint_speed = joint.astype(np.float32), rng.normal(0, 0.3, shape).astype(np.float32)
    speed = rng.normal(0.0, 0.3, shape) * (rng.random(shape) < 0.8)
    here = [motor.copy(), speed.copy(), np.zeros(shape), np.zeros(shape)]
    there = [wp.array(x, dtype=wp.float64) for x in (*here[:3], here[3][:, None])]
    applied, place = wp.zeros(shape, dtype=float), wp.array(np.arange(JOINTS, dtype=np.int32))
    state = [
        wp.array(target, dtype=wp.float64),
        wp.array(joint),
        wp.array(joint_speed),
        place,
        place,
    ]
    numbers, p = wp.array(p, dtype=wp.float64), p.swapaxes(1, 2).copy()
    tick = wp.zeros(WORLDS, dtype=int)
    inputs = [*state, numbers, wp.float64(DT_S), *there[:3], tick, there[3], applied]
    for _ in range(3):
        wp.launch(drive_tick, dim=shape, inputs=inputs)
        drive_step(
            *(target, joint.astype(float), joint_speed.astype(float)),
            *(here[0], here[1], p, DT_S, True, here[2], here[3]),
        )
    for one, other in zip(here, there, strict=True):
        assert np.abs(one).max() > 0.0
        assert other.numpy().reshape(shape) == pytest.approx(one, rel=1e-6, abs=1e-9)
    assert applied.numpy() == pytest.approx(here[3], rel=1e-6, abs=1e-6)


@pytest.fixture(scope="module")
def specs() -> list[Spec]:
    """Worlds that differ in masses, friction, gravity and drives."""
    heavy = world("steel", "kp-scale=20%,backlash=2deg,link-mass=10%")
    return [world(), replace(heavy, gravity_m_s2=(0.5, 0.0, -9.7)), world("fabric", "none")]


def played(name: str, specs: list[Spec]) -> list[State]:
    """Two periods of a grasp, the second under a load, then a third from a reset of one world."""
    sim = registry.load("backend", name)(specs)
    start = sample_initial_states(specs, np.random.default_rng(0))
    target = start.joint_rad + np.array([spec.hand.preload_rad for spec in specs])
    sim.reset(start, np.ones(len(specs), dtype=bool))
    states = []
    for load in (None, np.full_like(target, 0.01)):
        states.append(State(**{k: v.copy() for k, v in vars(sim.advance(target, load)).items()}))
    sim.reset(start, np.arange(len(specs)) == 1)
    states.append(State(**{k: v.copy() for k, v in vars(sim.advance(target)).items()}))
    sim.close()
    return states


def test_a_grasp_is_mujocos(specs: list[Spec]):
    """Differ from MuJoCo by what single precision does when a finger meets the stick."""
    here, there = played("mujoco-warp", specs), played("mujoco", specs)
    for one, other in zip(here, there, strict=True):
        assert one.joint_rad == pytest.approx(other.joint_rad, abs=1e-3)
        assert one.motor_rad == pytest.approx(other.motor_rad, abs=1e-3)
        assert one.stick_pos_m == pytest.approx(other.stick_pos_m, abs=2e-4)
        assert one.contact_force_n == pytest.approx(other.contact_force_n, abs=0.15)
        assert np.linalg.norm(one.contact_force_n, axis=2).max() > 1.0
    assert np.array_equal(here[0].joint_rad[1], here[2].joint_rad[1])


def test_it_is_chosen_by_name_alone():
    """Leave it out of 'all', and know it by its name."""
    assert "mujoco-warp" not in registry.chosen("backend", "all")
    assert registry.chosen("backend", "mujoco-warp") == ("mujoco-warp",)
