"""How far the engines are apart, against MuJoCo and against closed forms, in physical units."""

import dataclasses
import importlib
import importlib.util
import math

import numpy as np
import pytest

from backends import kinematics, mujoco, sticks, trx
from backends.engine import Engine
from backends.spec import Spec, Stick, field_names
from backends.state import Array, InitialState, State

GRIPPED_M = (0.068, 0.0, -0.03)
ASIDE_M = (1.068, 0.0, -0.03)
ALL = ("mujoco", "bullet", "sapien")


@pytest.fixture
def backend(request: pytest.FixtureRequest) -> type[Engine]:
    """The engine named by the parameter; skips where its file or its package is missing."""
    if importlib.util.find_spec(f"backends.{request.param}") is None:
        pytest.skip(f"no backends/{request.param}.py")
    if request.param != "mujoco":
        pytest.importorskip({"bullet": "pybullet"}.get(request.param, request.param))
    return importlib.import_module(f"backends.{request.param}").Backend


every_engine = pytest.mark.parametrize("backend", ALL, indirect=True)
beside_mujoco = pytest.mark.parametrize("backend", ALL[1:], indirect=True)


def built(stick: Stick = sticks.STICKS["reference"], play_rad: float = math.radians(1)) -> Spec:
    """The hand as built, with play and self-lock on its worm gears."""
    spec = trx.spec(stick)
    return spec.with_drives(
        tuple(
            dataclasses.replace(drive, play_rad=play_rad, lock_nm=10.0)
            if body.joint.gear == "worm"
            else drive
            for body, drive in zip(spec.hand.driven, spec.drives, strict=True)
        )
    )


def start(specs: list[Spec], stick_m: tuple[float, float, float]) -> InitialState:
    """The nominal grasp with upright sticks centred at `stick_m`."""
    n = len(specs)
    return InitialState(
        joint_rad=np.array([s.hand.grasp_rad for s in specs]),
        stick_pos_m=np.tile(stick_m, (n, 1)),
        stick_quat_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
    )


def squeeze(specs: list[Spec]) -> Array:
    """Targets of the nominal grasp, shape (N, J)."""
    return np.array([np.add(s.hand.grasp_rad, s.hand.preload_rad) for s in specs])


def play(engine: Engine, targets_rad: list[Array]) -> list[State]:
    """The states after each policy period, as copies."""
    fields = [f.name for f in dataclasses.fields(State)]
    states = []
    for target in targets_rad:
        state = engine.advance(target)
        states.append(State(**{name: getattr(state, name).copy() for name in fields}))
    return states


def run(
    backend: type[Engine], specs: list[Spec], stick_m: tuple[float, float, float], targets: list
) -> list[State]:
    """The states of fresh worlds under `targets`."""
    engine = backend(specs)
    engine.reset(start(specs, stick_m), np.ones(len(specs), dtype=bool))
    states = play(engine, targets)
    engine.close()
    return states


def jitter(spec: Spec, seed: int, periods: int) -> list[Array]:
    """Restless targets around the grasp."""
    rng = np.random.default_rng(seed)
    return [squeeze([spec]) + rng.uniform(-0.05, 0.05, (1, 6)) for _ in range(periods)]


def same(a: list[State], b: list[State]) -> bool:
    """Whether two runs are equal to the last bit."""
    names = [f.name for f in dataclasses.fields(State)]
    pairs = zip(a, b, strict=True)
    return all(np.array_equal(getattr(x, n), getattr(y, n)) for x, y in pairs for n in names)


@every_engine
def test_every_field_is_answered(backend: type[Engine]) -> None:
    """Answer for every field of the spec with one of three words."""
    assert set(backend.support) >= set(field_names())
    words = {answer.split(":")[0] for answer in backend.support.values()}
    assert words <= {"exact", "approximate", "refused"}


@every_engine
def test_contacts_lie_on_the_fingertips(backend: type[Engine]) -> None:
    """Press on the tips' surface, where numpy's kinematics has it, towards the tips' axis."""
    spec = built()
    state = run(backend, [spec], GRIPPED_M, [squeeze([spec])] * 25)[-1]
    center, rotation = kinematics.tip_frames(spec.hand, state.joint_rad)
    length_m, radius_m = trx.TIP_LENGTH_M, trx.TIP_RADIUS_M
    local = np.einsum("nfji,nfj->nfi", rotation, state.contact_point_m - center)
    local[..., 0] -= np.clip(local[..., 0], -length_m, 0.0)
    distance_m = np.linalg.norm(local, axis=-1)
    assert np.abs(distance_m - radius_m).max() < 2e-4
    push = np.einsum("nfji,nfj->nfi", rotation, state.contact_force_n)
    push /= np.linalg.norm(push, axis=-1, keepdims=True)
    assert (push * -local / distance_m[..., None]).sum(axis=-1).min() > 0.9999


@beside_mujoco
@pytest.mark.parametrize(("play_rad", "gap_rad"), [(0.0, 1e-5), (math.radians(1), 1e-2)])
def test_free_fingers_follow_alike(backend: type[Engine], play_rad: float, gap_rad: float) -> None:
    """Follow the same target steps for 1 s as MuJoCo; drifting in the play amplifies rounding."""
    spec = built(play_rad=play_rad)
    steps = [np.array([[0.1, -0.2, 0.15, 0.1, -0.1, 0.2]]) * k for k in (1.0, -1.5)]
    targets = [np.array([spec.hand.grasp_rad]) + steps[k // 25] for k in range(50)]
    ours, theirs = (run(b, [spec], ASIDE_M, targets) for b in (backend, mujoco.Backend))
    gap = [np.abs(a.joint_rad - b.joint_rad).max() for a, b in zip(ours, theirs, strict=True)]
    assert max(gap) < gap_rad


@every_engine
def test_stick_falls_after_the_weightless_start(backend: type[Engine]) -> None:
    """Hang still for 0.1 s, then fall as semi-implicit Euler does (float32 tolerance)."""
    spec = built()
    states = run(backend, [spec], ASIDE_M, [squeeze([spec])] * 20)
    dt, g = spec.timing.drive_s, np.array(spec.gravity_m_s2)
    for period, state in enumerate(states, start=1):
        k = max(0, period * spec.timing.substeps - round(spec.timing.weightless_s / dt))
        assert state.stick_vel_m_s[0] == pytest.approx(g * dt * k, abs=1e-5)
        fallen = g * dt**2 * k * (k + 1) / 2
        assert state.stick_pos_m[0] - ASIDE_M == pytest.approx(fallen, abs=1e-5)


@beside_mujoco
def test_grasp_holds_with_equal_force(backend: type[Engine]) -> None:
    """Hold the stick within 1 mm for 2 s, with MuJoCo's squeeze within 10 %."""
    spec = built()
    ours, theirs = (
        run(b, [spec], GRIPPED_M, [squeeze([spec])] * 100) for b in (backend, mujoco.Backend)
    )
    settled_m = ours[9].stick_pos_m
    assert max(np.linalg.norm(s.stick_pos_m - settled_m) for s in ours[10:]) < 1e-3
    assert np.linalg.norm(ours[-1].stick_pos_m - theirs[-1].stick_pos_m) < 1e-3
    force_n, reference_n = (
        np.linalg.norm(s[-1].contact_force_n[0], axis=-1) for s in (ours, theirs)
    )
    assert force_n == pytest.approx(reference_n, rel=0.1)


@every_engine
def test_stick_slides_only_beyond_friction(backend: type[Engine]) -> None:
    """Hold 0.95 of friction times squeeze, slide at 1.05; the worlds differ in the stick's mass."""
    slippery = dataclasses.replace(sticks.STICKS["reference"], friction=0.1)
    probe = built(slippery)
    squeeze_n = np.linalg.norm(
        run(backend, [probe], GRIPPED_M, [squeeze([probe])] * 25)[-1].contact_force_n[0], axis=-1
    ).sum()
    masses_kg = [share * 0.1 * squeeze_n / 9.81 for share in (0.95, 1.05)]
    specs = [built(dataclasses.replace(slippery, mass_kg=float(m))) for m in masses_kg]
    end = run(backend, specs, (0.068, 0.0, 0.0), [squeeze(specs)] * 25)[-1]
    assert abs(end.stick_vel_m_s[0, 2]) < 2e-3 < 0.1 < -end.stick_vel_m_s[1, 2]


@every_engine
@pytest.mark.parametrize("stick", ["reference", "square"])
def test_reset_leaves_no_memory(backend: type[Engine], stick: str) -> None:
    """Repeat a fresh world's run to the last bit after other runs and a drop."""
    spec, on = built(sticks.STICKS[stick]), np.ones(1, dtype=bool)
    targets = jitter(spec, 0, 20)
    fresh = run(backend, [spec], GRIPPED_M, targets)
    assert same(fresh, run(backend, [spec], GRIPPED_M, targets))
    engine = backend([spec])
    for place, history in ((GRIPPED_M, jitter(spec, 1, 3)), (ASIDE_M, jitter(spec, 2, 10))):
        engine.reset(start([spec], place), on)
        play(engine, history)
        engine.reset(start([spec], GRIPPED_M), on)
        assert same(fresh, play(engine, targets))
    engine.close()
