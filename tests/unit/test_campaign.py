"""A small part of the campaign: spoilt inputs are refused, killed commands go on as if nothing."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


EVERY = ("run mujoco sb3-ppo", "run mujoco rsl-ppo", "run --force sb3-ppo", "blind make presliding")
"""Commands that are killed at each of their operations."""


def only(*names):
    """Words that choose kinds."""
    return [word for name in names for word in ("--only", name)]


@pytest.mark.parametrize(
    "words",
    [
        ["--inputs", "--quick", "--n", "18"],
        ["--kills", "--n", "2", *only("run mujoco sb3-ppo", "excite")],
        *(
            pytest.param(["--kills", "--every", "--only", name], marks=pytest.mark.slow)
            for name in EVERY
        ),
        pytest.param(["--kills", "--n", "84"], marks=pytest.mark.slow),
        pytest.param(["--inputs", "--n", "430"], marks=pytest.mark.slow),
    ],
    ids=" ".join,
)
def test_nothing_breaks(words):
    """End without a trace, a hang or a full memory; leave no row changed and no folder stuck."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.campaign", *words, "--seed", "7", "--hang-s", "600"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
