"""Smoothing without what takes long to import."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.signal import savgol_filter

from diagnosis.motion.smoothing import smooth

SLOW = {"scipy.signal", "scipy.optimize", "scipy.stats", "matplotlib", "torch"}
"""What a diagnosis of free air needs nothing of."""


@pytest.mark.parametrize(("width", "degree"), [(5, 3), (11, 4), (21, 3)])
def test_smooths_as_savitzky_and_golay(width, degree):
    """Give what SciPy's filter gives, at the ends as well."""
    samples = np.random.default_rng(0).normal(size=(200, 3)).cumsum(axis=0)
    expected = savgol_filter(samples, width, degree, axis=0)
    assert smooth(samples, width, degree) == pytest.approx(expected, abs=1e-10)


def test_a_diagnosis_starts_without_slow_imports():
    """Import the command and find none of them."""
    code = f"import sys, benchmark.gap.diagnose; print(*({SLOW} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not done.stdout.split()
