"""A small part of the campaign: spoilt inputs are refused, killed commands go on as if nothing."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("part", "cases"),
    [
        ("--inputs", 60),
        ("--kills", 10),
        pytest.param("--inputs", 1000, marks=pytest.mark.slow),
        pytest.param("--kills", 200, marks=pytest.mark.slow),
    ],
)
def test_nothing_breaks(part, cases):
    """End without a trace, a hang or a full memory; leave no row changed and no folder stuck."""
    quick = ["--quick"] if cases <= 60 else []
    words = [part, "--n", str(cases), "--seed", "7", "--hang-s", "600", *quick]
    done = subprocess.run(
        [sys.executable, "-m", "tests.campaign", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
