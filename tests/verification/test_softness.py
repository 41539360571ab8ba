"""Soft contacts in every engine: yield in proportion to the force, grip as before."""

import dataclasses

import numpy as np
import pytest

from backends import kinematics, sticks, trx
from backends.engine import Engine
from backends.spec import Spec
from backends.state import Array, State, quat_z_axis
from benchmark.errors import CommandError
from benchmark.parts import registry
from tasks.initial_states import sample_initial_states

IDEAL = trx.spec(sticks.STICKS["reference"])
COMPLIANCES_M_N = (0.0, 2e-5, 1e-4, 3e-4, 1e-3)


@pytest.fixture(params=registry.names("backend"))
def engine(request: pytest.FixtureRequest) -> type[Engine]:
    """Every engine that is installed."""
    try:
        return registry.load("backend", request.param)
    except CommandError as error:
        pytest.skip(str(error))


def soft(compliance_m_n: float, **stick: float) -> Spec:
    """The ideal hand with soft contacts."""
    contact = dataclasses.replace(IDEAL.contact, compliance_m_n=compliance_m_n)
    changed = dataclasses.replace(IDEAL.stick, **stick)
    return dataclasses.replace(IDEAL, contact=contact, stick=changed)


def hold(engine: type[Engine], specs: list[Spec], squeeze: float, periods: int) -> list[State]:
    """The states while the nominal grasp is held; `squeeze` scales half of its preload.

    All of it would press deeper into the softest contacts than the stick's radius.
    """
    start = sample_initial_states(specs, np.random.default_rng(0), 0.0)
    sim = engine(specs)
    sim.reset(start, np.ones(len(specs), dtype=bool))
    target = start.joint_rad + squeeze / 2 * np.array(IDEAL.hand.preload_rad)
    states = []
    for _ in range(periods):
        state = sim.advance(target)
        rows = {f.name: getattr(state, f.name).copy() for f in dataclasses.fields(State)}
        states.append(State(**rows))
    sim.close()
    return states


def yields(state: State) -> Array:
    """How deep tips and stick overlap [m], (N, F): two radii less the distance of their axes."""
    front, rotation = kinematics.tip_frames(IDEAL.hand, state.joint_rad)
    along = np.linspace(0.0, trx.TIP_LENGTH_M, 1000)[:, None]
    points = front[:, :, None] - along * rotation[:, :, None, :, 0]
    away = points - state.stick_pos_m[:, None, None]
    axis = quat_z_axis(state.stick_quat_wxyz)[:, None, None]
    distance = np.linalg.norm(np.cross(away, axis), axis=-1).min(axis=-1)
    return trx.TIP_RADIUS_M + IDEAL.stick.radius_m - distance


@pytest.mark.parametrize("squeeze", [0.5, 1.0])
def test_contact_yields_in_proportion(engine: type[Engine], squeeze: float) -> None:
    """Yield by the compliance times the force beyond the engine's own, within 0.1 %."""
    specs = [soft(c) for c in COMPLIANCES_M_N]
    state = hold(engine, specs, squeeze, 75)[-1]
    force_n = np.linalg.norm(state.contact_force_n, axis=2)
    per_n, beside_m = engine.own.get("contact.compliance_m_n", 0.0), engine.slop_m
    expected = (np.array(COMPLIANCES_M_N)[:, None] + per_n) * force_n + beside_m
    assert force_n.min() > 0.2
    assert yields(state)[1:] == pytest.approx(expected[1:], rel=1e-3, abs=1e-7)
    # The nominal contacts of MuJoCo stiffen under load.
    assert (yields(state)[0] < 1.001 * expected[0] + 2e-7).all()


def test_soft_grasp_holds(engine: type[Engine]) -> None:
    """Let the stick creep no faster than 0.05 mm/s, however soft, and settle its squeeze.

    MuJoCo creeps most: by its friction's regularisation, R f / b, in proportion to the contact's
    time constant; at 1 mm/N that is 0.044 mm/s.
    """
    states = hold(engine, [soft(c) for c in COMPLIANCES_M_N], 1.0, 75)
    creep_m_s = np.linalg.norm(states[-1].stick_pos_m - states[-26].stick_pos_m, axis=1) / 0.5
    assert creep_m_s.max() < 5e-5
    force = [np.linalg.norm(s.contact_force_n, axis=2).sum(axis=1) for s in states[-26:]]
    assert np.ptp(force, axis=0).max() < 0.02 * np.min(force)


@pytest.mark.parametrize(("compliance_m_n", "within"), [(0.0, 0.07), (2e-4, 0.01)])
def test_contact_creeps_in_proportion(
    engine: type[Engine], compliance_m_n: float, within: float
) -> None:
    """Let three tips sink with the stick by its weight's third each, times the creep.

    A hard contact of MuJoCo creeps less where it is deep: by 6 % in this grip. With 32 bits a
    position moves in steps that make 1e-6 m/s.
    """
    if engine.support["contact.creep_m_ns"].startswith("refused"):
        pytest.skip("refused by this engine")
    more_m_ns = np.array([0.0, 2e-4, 5e-4, 2e-3, 5e-3])
    spec = soft(compliance_m_n)
    contacts = [dataclasses.replace(spec.contact, creep_m_ns=float(one)) for one in more_m_ns]
    specs = [dataclasses.replace(spec, contact=contact) for contact in contacts]
    states = hold(engine, specs, 1.0, 75)
    sunk_m_s = (states[-26].stick_pos_m - states[-1].stick_pos_m)[:, 2] / 0.5
    expected = more_m_ns * IDEAL.stick.mass_kg * 9.81 / 3
    assert sunk_m_s - sunk_m_s[0] == pytest.approx(expected, rel=within, abs=1e-6)


def test_soft_grip_slides_only_beyond_friction(engine: type[Engine]) -> None:
    """Hold 0.9 of friction times squeeze, and let 1.3 of it slide, as hard contacts do.

    SAPIEN's solver of soft contacts grips up to a fifth more than friction alone.
    """
    mu, compliance = 0.3, 2e-4
    probe = soft(compliance, friction=mu, grip_to_lower_end_m=0.1)
    state = hold(engine, [probe], 2.0, 40)[-1]
    limit_kg = mu * np.linalg.norm(state.contact_force_n[0], axis=1).sum() / 9.81
    masses = [float(share * limit_kg) for share in (0.5, 0.9, 1.3)]
    specs = [
        soft(compliance, friction=mu, grip_to_lower_end_m=0.1, mass_kg=mass) for mass in masses
    ]
    states = hold(engine, specs, 2.0, 40)
    sunk_m = states[15].stick_pos_m[:, 2] - states[-1].stick_pos_m[:, 2]
    assert sunk_m[:2].max() < 1e-4
    assert sunk_m[2] > 5e-3
