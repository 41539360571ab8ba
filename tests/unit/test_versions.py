"""Other versions of an engine: the same calls, and environments of their own."""

from dataclasses import replace

import numpy as np
import pytest

from backends import _mujoco_worlds, mujoco
from benchmark.cli import app as cli
from benchmark.errors import UsageError
from benchmark.results import versions
from benchmark.settings.run_spec import RunSpec

SPEC = RunSpec(backend="mujoco", task="circle")
WORLDS, STEPS = 3, 15


def states() -> np.ndarray:
    """Joints, sticks and contacts of random actions in worlds that differ."""
    rng = np.random.default_rng(0)
    worlds = [SPEC.world(), *(replace(SPEC, effects=e).world() for e in ("none", "link-mass=20%"))]
    env = SPEC.make_env(worlds, seed=3, workers=1)
    env.reset()
    shown = []
    for _ in range(STEPS):
        env.step(rng.uniform(-0.3, 0.3, (WORLDS, env.action_width)))
        state = env.simulator.state
        parts = (state.joint_rad, state.stick_pos_m, state.contact_force_n, state.contact_point_m)
        shown.append(np.concatenate([part.ravel() for part in parts]))
    env.reset(np.arange(WORLDS) == 1)
    env.simulator.rollout(env.simulator.applied_nm)
    shown.append(np.resize(state.joint_rad, len(shown[0])))
    env.close()
    return np.array(shown)


@pytest.mark.parametrize("has_sensor", [True, False])
def test_older_calls_give_the_same_numbers(has_sensor, monkeypatch):
    """Step worlds one by one, and read contacts without sensors, to the bit as batches do."""
    batch = states()
    monkeypatch.setattr(_mujoco_worlds, "HAS_BATCH", False)
    monkeypatch.setattr(_mujoco_worlds, "HAS_SENSOR", has_sensor)
    monkeypatch.setattr(mujoco, "HAS_SENSOR", has_sensor)
    assert np.array_equal(states(), batch)
    assert batch[:-1, -1].any(), "no contact was read"


def test_a_version_is_part_of_an_engines_name():
    """Read engine and version, and refuse an engine that has no versions."""
    assert versions.split("mujoco") == ("mujoco", "")
    assert versions.split(" mujoco@3.6.0") == ("mujoco", "3.6.0")
    with pytest.raises(UsageError, match="'mujocoo'"):
        versions.split("mujocoo@3.6.0")


def test_a_version_that_is_not_there_is_said(tmp_path, monkeypatch, capfd):
    """Leave no half environment, and name engine and version."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    run = tmp_path / "run"
    words = [
        "run",
        "--backend",
        "mujoco",
        "--task",
        "circle",
        "--algo",
        "hold-still",
        "--smoke",
        "--out",
        str(run),
    ]
    assert cli.call(words) == 0
    words = ["transfer", str(run), "--backend", "mujoco,mujoco@0.0.1", "--include-smoke"]
    words += ["--effects", "none", "--episodes", "2", "--out", str(tmp_path / "out")]
    assert cli.call(words) == 1
    assert "mujoco 0.0.1 cannot be installed" in capfd.readouterr().err
    assert not (tmp_path / "stickbench/versions/mujoco-0.0.1").exists()
    assert (tmp_path / "out/matrix.csv").exists()
