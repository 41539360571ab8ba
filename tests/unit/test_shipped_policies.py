"""Policies in the repository act as their rows say."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.registry import ROOT
from benchmark.run import deploy
from benchmark.run_folder import EPISODES_FILE, check_policy, read_run, run_spec

POLICIES = sorted(path.parent for path in (ROOT / "leaderboard/policies").glob("*/run.json"))
EPISODES = 4
ROUNDING_CM = 0.05
"""Other CPUs round otherwise, and six seconds of contact amplify it."""


def test_there_are_policies() -> None:
    """Ship policies at all."""
    assert POLICIES


@pytest.mark.parametrize("folder", POLICIES, ids=lambda path: path.name)
def test_policy_repeats_its_row(folder: Path) -> None:
    """Reach the errors of the first kept episodes again, with a policy that is the row's own."""
    row = read_run(folder)
    check_policy(folder, row)
    kept = pd.read_parquet(folder / EPISODES_FILE)
    assert np.mean(kept["tracked"]) == pytest.approx(row["scores"]["tracked"], abs=1e-9)
    again = deploy(run_spec(row), folder, workers=1, episodes=EPISODES)
    assert again.p_err_cm == pytest.approx(kept["p_err_cm"][:EPISODES], abs=ROUNDING_CM)
    assert again.held == pytest.approx(kept["held"][:EPISODES], abs=0.01)
