"""Real sides that are engines and no backends, against closed forms and the reference backend."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backends.spec import Spec
from benchmark.gap import blind
from benchmark.parts import registry
from benchmark.settings.run_spec import REFERENCE
from diagnosis.blind import make, motion, rigs, sides
from diagnosis.blind.engines._free import FreeHands
from diagnosis.blind.mechanics import _chain
from diagnosis.blind.plant import Limb
from diagnosis.motion.batch import at_rest

every_engine = pytest.mark.parametrize("name", sides.ENGINES)


def placed(name: str, spec: Spec, joint_rad: list[float]) -> FreeHands:
    """One world of a rig at rest."""
    engine = sides.engine(name)([spec])
    rest(engine, joint_rad)
    return engine


def rest(engine: FreeHands, joint_rad: list[float]) -> None:
    """Put an engine's one world to rest at these angles."""
    engine.reset(at_rest(np.array([joint_rad])), np.ones(1, dtype=bool))


def inertia_kgm2(spec: Spec) -> float:
    """Inertia of a lone arm about its hinge."""
    body = spec.hand.driven[0]
    arm_m = np.cross(body.joint.axis, body.com_m)
    own = np.array(body.joint.axis) ** 2 @ np.array(body.inertia_kgm2)
    return float(own + body.mass_kg * arm_m @ arm_m)


def turned(engine: FreeHands, torque_nm: list[float], time_s: float) -> None:
    """Let an engine run under one torque."""
    engine._tick(slice(0, 1), np.array([torque_nm]), None, round(time_s / engine.drive_s))


@every_engine
def test_a_free_joint_speeds_up_evenly(name):
    """Turn by M t^2 / 2 J under a torque M without gravity, to the integrator's accuracy."""
    spec = dataclasses.replace(rigs.nominal("joint"), gravity_m_s2=(0.0, 0.0, 0.0))
    inertia = inertia_kgm2(spec)
    engine = placed(name, spec, [0.0])
    turned(engine, [1e-4], 0.2)
    assert engine.state.joint_rad_s[0, 0] == pytest.approx(1e-4 * 0.2 / inertia, rel=1e-9)
    assert engine.state.joint_rad[0, 0] == pytest.approx(1e-4 * 0.2**2 / 2 / inertia, rel=1e-9)


@pytest.mark.parametrize("payload", [0.0, 0.8])
@every_engine
def test_a_finger_falls_as_lagrange_says(name, payload):
    """Follow the closed form of two links that fall freely, within 10 microrad in 0.3 s."""
    spec = dataclasses.replace(rigs.nominal("finger"), gravity_m_s2=(9.0, 2.0, -3.0))
    upper, lower = spec.hand.driven
    spec = spec.with_driven([upper, dataclasses.replace(lower, payload=payload)])
    start = [0.4, -0.7]
    bodies = tuple(body.loaded for body in spec.hand.driven)
    limb = Limb(bodies=bodies, numbers={}, gravity_m_s2=np.array(spec.gravity_m_s2))
    links, pull = _chain.geometry(limb)

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        faster = np.zeros(2)
        _chain.fall(state[:2], state[2:], np.zeros(2), links, pull, faster)
        return np.concatenate([state[2:], faster])

    exact = solve_ivp(rates, (0.0, 0.3), [*start, 0.0, 0.0], rtol=1e-10, atol=1e-12)
    engine = placed(name, spec, start)
    for _ in range(30):
        turned(engine, [0.0, 0.0], 0.01)
    assert np.abs(engine.state.joint_rad[0] - start).max() > 0.1
    assert engine.state.joint_rad[0] == pytest.approx(exact.y[:2, -1], abs=1e-5)


OTHERS = [name for name in registry.usual("backend") if name != REFERENCE]


@pytest.mark.parametrize("name", [*OTHERS, *sides.ENGINES])
def test_motors_turn_as_those_of_the_reference(name):
    """Meet MuJoCo's motors on smooth motions [rad]: backends integrate alike, others do not.

    Half a millirad is a drive period that is shorter by 0.8 ms, at 1.2 rad/s.
    """
    least, most = (0.0, 2e-6) if name in OTHERS else (1e-5, 1e-3)
    spec = rigs.nominal("finger")
    rng = np.random.default_rng(0)
    whole = [motion.motion(p, spec, rng) for p in ("triangle", "multisine", "push")]
    motions = [
        dataclasses.replace(m, target_rad=m.target_rad[:250], push_nm=m.push_nm[:250])
        for m in whole
    ]
    engines = (registry.load("backend", REFERENCE), blind._engine(name))
    seen = [make.engine_readings(e, spec, motions, np.random.default_rng(1)) for e in engines]
    for one, other in zip(*seen, strict=True):
        apart = np.abs(one["motor"] - other["motor"]).max()
        assert least <= apart <= most


@pytest.mark.slow
def test_engines_of_other_rates_agree():
    """Turn motors in Drake and Exudyn within 0.1 mrad of each other, within 0.6 in steps [rad]."""
    spec, rng = rigs.nominal("finger"), np.random.default_rng(0)
    for protocol, most in (("steps", 6e-4), ("triangle", 1e-4), ("multisine", 1e-4)):
        moved = [motion.motion(protocol, spec, rng)]
        both = [
            make.engine_readings(sides.engine(name), spec, moved, np.random.default_rng(1))
            for name in sides.ENGINES
        ]
        (one,), (other,) = both
        assert 0.0 < np.abs(one["motor"] - other["motor"]).max() < most


@every_engine
@pytest.mark.parametrize("drive_s", [1e-3, None])
def test_a_held_torque_gives_back_damping(name, drive_s, monkeypatch):
    """Ring for a second on a spring k with damping c = k (1 ms) / 2, and lose nothing at 1 kHz.

    Held torques give k dt / 2 of the damping back, so exp(-(c - k dt / 2) t / 2 J) is kept of the
    swing: 0.454 at 5 kHz. This is why the drives of these sides do not run at 1 kHz.
    """
    if drive_s is not None:
        monkeypatch.setattr(sides.engine(name), "drive_s", drive_s)
    period_s = sides.engine(name).drive_s
    spec = dataclasses.replace(rigs.nominal("joint"), gravity_m_s2=(0.0, 0.0, 0.0))
    stiffness = inertia_kgm2(spec) * (2 * np.pi * 10.0) ** 2
    damping = stiffness * 1e-3 / 2
    engine = placed(name, spec, [0.1])
    angle, speed = engine.state.joint_rad, engine.state.joint_rad_s
    for _ in range(round(1.0 / period_s)):
        engine._tick(slice(0, 1), -stiffness * angle - damping * speed, None)
    kept = np.exp(-(damping - stiffness * period_s / 2) / 2 / inertia_kgm2(spec))
    swing = np.hypot(angle[0, 0], speed[0, 0] / (2 * np.pi * 10.0))
    assert swing / 0.1 == pytest.approx(kept, rel=0.03)


@every_engine
def test_episodes_start_anew(name):
    """Move again as the first time after a reset."""
    spec, start = rigs.nominal("finger"), [0.4, -0.7]
    engine = placed(name, spec, start)
    moved = []
    for _ in range(2):
        rest(engine, start)
        turned(engine, [1e-3, 0.0], 0.1)
        moved.append(engine.state.joint_rad.copy())
    assert moved[0] == pytest.approx(moved[1], abs=1e-9)
    assert np.abs(moved[0] - start).max() > 1e-3


@every_engine
def test_slides_are_refused(name):
    """Say that these sides build hinges alone."""
    spec = rigs.nominal("joint")
    body = spec.hand.driven[0]
    slide = dataclasses.replace(body, joint=dataclasses.replace(body.joint, slides=True))
    bodies = tuple(slide if b.name == body.name else b for b in spec.hand.bodies)
    with pytest.raises(ValueError, match=r"joint\.slides is refused: only hinge"):
        sides.engine(name)(
            [dataclasses.replace(spec, hand=dataclasses.replace(spec.hand, bodies=bodies))]
        )


def test_exudyn_builds_no_link_of_two_bodies():
    """Refuse a body that is fixed on another one, whose mass would be missing."""
    spec = rigs.nominal("finger")
    base, *links = spec.hand.bodies
    cap = dataclasses.replace(base, name="cap", parent=links[-1].name)
    hand = dataclasses.replace(spec.hand, bodies=(base, *links, cap))
    with pytest.raises(ValueError, match="cap is fixed to finger1_distal"):
        sides.engine("exudyn")([dataclasses.replace(spec, hand=hand)])
