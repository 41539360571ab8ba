"""How far the engines are from the reference, as `bench doctor physics` measures it."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from backends import kinematics, sticks, trx
from backends.engine import Engine
from backends.spec import Spec
from backends.state import Array, State
from benchmark.errors import CommandError
from benchmark.parts import registry
from benchmark.physics import rigs, suite
from benchmark.physics.check import Compare
from benchmark.physics.grasp import squeeze
from benchmark.physics.rollout import at_rest
from benchmark.settings.run_spec import REFERENCE

KEPT = Path(__file__).resolve().parents[2] / "leaderboard/physics.json"
GRIPPED_M, ASIDE_M = (0.068, 0.0, -0.03), (1.068, 0.0, -0.03)


def loaded(name: str) -> type[Engine]:
    """An engine; skips where it is not installed."""
    try:
        return registry.load("backend", name)
    except CommandError as error:
        pytest.skip(str(error))


@pytest.fixture(params=registry.names("backend"))
def engine(request: pytest.FixtureRequest) -> type[Engine]:
    """Every engine that is installed."""
    return loaded(request.param)


@pytest.mark.parametrize("compare", suite.BESIDE, ids=lambda compare: compare.__name__)
@pytest.mark.parametrize("name", [n for n in registry.names("backend") if n != REFERENCE])
def test_engine_agrees_with_the_reference(name: str, compare: Compare) -> None:
    """Differ from the reference by rounding in free space, by contact models in the grasp."""
    checks = tuple(compare(loaded(name), loaded(REFERENCE)))
    assert checks
    assert [check for check in checks if not check.passed] == []
    kept = KEPT.read_text()
    assert [check.name for check in checks if check.name not in kept] == []


def test_contacts_lie_on_the_fingertips(engine: type[Engine]) -> None:
    """Press on the tips' surface, where numpy's kinematics has it, towards the tips' axis.

    A contact that yields lies halfway in the overlap: 0.04 mm/N in MuJoCo's.
    """
    spec = rigs.hand("built")
    path = squeeze(engine, [spec], 0.5)
    center, rotation = kinematics.tip_frames(spec.hand, path.joint_rad[-1])
    local = np.einsum("nfji,nfj->nfi", rotation, path.contact_point_m[-1] - center)
    local[..., 0] -= np.clip(local[..., 0], -trx.TIP_LENGTH_M, 0.0)
    distance_m = np.linalg.norm(local, axis=-1)
    force_n = np.linalg.norm(path.contact_force_n[-1], axis=-1)
    assert (np.abs(distance_m - trx.TIP_RADIUS_M) < 1e-5 + 4e-5 * force_n).all()
    push = np.einsum("nfji,nfj->nfi", rotation, path.contact_force_n[-1])
    push /= np.linalg.norm(push, axis=-1, keepdims=True)
    assert (push * -local / distance_m[..., None]).sum(axis=-1).min() > 0.9999


def jitter(spec: Spec, seed: int, periods: int) -> list[Array]:
    """Restless targets around the grasp."""
    rng = np.random.default_rng(seed)
    hold = np.add(spec.hand.grasp_rad, spec.hand.preload_rad)
    return [hold + rng.uniform(-0.05, 0.05, (1, len(hold))) for _ in range(periods)]


def episode(engine: Engine, stick_m: tuple[float, float, float], targets: list[Array]) -> list:
    """Every signal after a reset and each target."""
    spec = engine.specs[0]
    engine.reset(at_rest([spec], np.array(spec.hand.grasp_rad), stick_m), np.ones(1, dtype=bool))
    states = []
    for target in targets:
        state = engine.advance(target)
        states += [getattr(state, f.name).tobytes() for f in fields(State)]
    return states


@pytest.mark.parametrize("stick", ["reference", "square"])
def test_reset_leaves_no_memory(engine: type[Engine], stick: str) -> None:
    """Repeat a fresh world's run to the last bit after other runs and a drop."""
    spec = replace(rigs.hand("built"), stick=sticks.STICKS[stick])
    targets = jitter(spec, 0, 20)
    worlds = [engine([spec]) for _ in range(2)]
    fresh = episode(worlds[0], GRIPPED_M, targets)
    assert episode(worlds[1], GRIPPED_M, targets) == fresh
    for place, history in ((GRIPPED_M, jitter(spec, 1, 3)), (ASIDE_M, jitter(spec, 2, 10))):
        episode(worlds[0], place, history)
        assert episode(worlds[0], GRIPPED_M, targets) == fresh
    for world in worlds:
        world.close()
