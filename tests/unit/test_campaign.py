"""A small part of the campaign: spoilt inputs are refused, killed commands go on as if nothing."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.campaign.watch import watched

ROOT = Path(__file__).resolve().parents[2]
SPINS = "while True: pass"

EVERY = ("run mujoco sb3-ppo", "run mujoco rsl-ppo", "run --force sb3-ppo", "blind make presliding")
"""Commands that are killed at each of their operations."""


def only(*names):
    """Words that choose kinds."""
    return [word for name in names for word in ("--only", name)]


@pytest.mark.parametrize(
    "words",
    [
        ["--inputs", "--quick", "--n", "12"],
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
        [sys.executable, "-m", "tests.campaign", *words, "--seed", "7"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    "call",
    [
        pytest.param(lambda: exec(SPINS), marks=pytest.mark.slow, id="itself"),
        pytest.param(lambda: subprocess.call([sys.executable, "-c", SPINS]), id="what it started"),
    ],
)
def test_what_computes_for_ever_hangs(call, tmp_path):
    """Count the CPU time of a call and of what it started."""
    assert watched(call, tmp_path, cpu_s=1).fault == "hang"


def test_what_waits_for_ever_hangs(tmp_path):
    """End a call that computes nothing, and everything it waits for."""
    assert watched(lambda: time.sleep(1e6), tmp_path, wait_s=0.5).fault == "hang"


def test_what_waits_for_its_turn_does_not_hang(tmp_path):
    """Let a call that computes little take its time."""
    assert watched(lambda: time.sleep(2.5) or 0, tmp_path, cpu_s=1).fault == ""
