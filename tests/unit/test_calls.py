"""An engine whose wheel is unknown is stepped by its public calls, with the same results."""

import importlib
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from backends import _calls
from backends.state import Array
from benchmark.errors import CommandError
from benchmark.parts import registry
from benchmark.runs.train import training_worlds
from benchmark.settings.run_spec import RunSpec
from tasks.initial_states import sample_initial_states

BACKENDS = Path(_calls.__file__).parent
ENGINES = [path.stem[1:].removesuffix("_public") for path in BACKENDS.glob("_*_public.py")]
SIGNALS = (
    "joint_rad",
    "joint_rad_s",
    "stick_pos_m",
    "stick_quat_wxyz",
    "stick_vel_m_s",
    "stick_omega_rad_s",
    "contact_point_m",
    "contact_force_n",
)


@pytest.fixture(params=ENGINES)
def module(request: pytest.FixtureRequest) -> ModuleType:
    """Every engine that has calls of both sorts."""
    try:
        registry.load("backend", request.param)
    except CommandError as error:
        pytest.skip(str(error))
    return importlib.import_module(f"backends.{request.param}")


def played(module: ModuleType) -> list[Array]:
    """All signals of a grasp that is shaken and pushed, in worlds as training draws them."""
    name = module.__name__.rpartition(".")[2]
    specs = training_worlds(RunSpec(backend=name, task="line", worlds=3), 0)
    sim = module.Backend(specs)
    start = sample_initial_states(specs, np.random.default_rng(0))
    sim.reset(start, np.ones(len(specs), dtype=bool))
    target = start.joint_rad + np.array([s.hand.preload_rad for s in specs])
    rng, seen = np.random.default_rng(1), []
    for period in range(12):
        jerk = rng.uniform(-0.03, 0.03, target.shape)
        state = sim.advance(target + jerk, np.full_like(target, 0.01) if period == 8 else None)
        seen += [getattr(state, name).copy() for name in SIGNALS]
    sim.reset(start, np.arange(len(specs)) == 1)
    sim.rollout(sim.applied_nm)
    seen.append(sim.state.joint_rad.copy())
    sim.close()
    return seen


def test_public_calls_give_the_same(module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Step an engine by compiled and by public calls, and get the same to rounding."""
    name = module.__name__.rpartition(".")[2]
    assert module.calls.__name__ == f"backends._{name}_calls"
    compiled = played(module)
    monkeypatch.setattr(module, "calls", importlib.import_module(f"backends._{name}_public"))
    for left, right in zip(played(module), compiled, strict=True):
        assert left == pytest.approx(right, rel=1e-9, abs=1e-12)
    assert np.any(compiled[SIGNALS.index("contact_force_n")])


def test_an_unknown_wheel_is_stepped_by_its_public_calls() -> None:
    """Say once that a wheel's layout is not a known one, and what to install."""
    version = metadata.version("numpy")
    with pytest.warns(RuntimeWarning, match=f"numpy {version} .* install numpy==1.0") as said:
        taken = _calls.chosen("numpy", ("0.9", "1.0"), "backends.trx", "backends.sticks")
    assert taken.__name__ == "backends.sticks" and len(said) == 1


def test_a_layout_that_cannot_be_read_is_not_a_known_one() -> None:
    """Take the public calls where the compiled ones cannot be loaded."""
    version = metadata.version("numpy")
    with pytest.warns(RuntimeWarning, match="No module named 'backends.absent'"):
        taken = _calls.chosen("numpy", (version,), "backends.absent", "backends.sticks")
    assert taken.__name__ == "backends.sticks"


def test_a_missing_engine_is_named() -> None:
    """Raise for a package that is not installed at all."""
    with pytest.raises(ModuleNotFoundError) as raised:
        _calls.chosen("absent-engine", ("1.0",), "backends.trx", "backends.sticks")
    assert raised.value.name == "absent-engine"


@pytest.mark.parametrize("engine", registry.usual("backend"))
def test_an_engine_prints_nothing_where_it_is_loaded(engine):
    """Load an engine in silence, its compiled parts as well."""
    loaded = subprocess.run(
        [sys.executable, "-c", f"import backends.{engine}"], capture_output=True, text=True
    )
    assert (loaded.returncode, loaded.stdout, loaded.stderr) == (0, "", "")
