"""Policies in the repository act as their rows say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.registry import ROOT
from benchmark.run import deploy
from benchmark.run_folder import EPISODES_FILE, check_policy, read_run, run_spec

POLICIES = sorted(path.parent for path in (ROOT / "leaderboard/policies").glob("*/run.json"))
FIRST_SEEDS = {replace(run_spec(read_run(path)), seed=0): path for path in reversed(POLICIES)}
EPISODES = 4
ROUNDING_CM = 0.05
"""Other CPUs round otherwise, and six seconds of contact amplify it."""


def test_there_are_policies() -> None:
    """Ship policies at all."""
    assert POLICIES


@pytest.mark.parametrize("folder", POLICIES, ids=lambda path: path.name)
def test_policy_is_its_rows_own(folder: Path) -> None:
    """Keep the policy and the episodes that the row speaks of."""
    row = read_run(folder)
    check_policy(folder, row)
    kept = pd.read_parquet(folder / EPISODES_FILE)
    assert np.mean(kept["tracked"]) == pytest.approx(row["scores"]["tracked"], abs=1e-9)


@pytest.mark.parametrize("folder", list(FIRST_SEEDS.values()), ids=lambda path: path.name)
def test_policy_repeats_its_row(folder: Path) -> None:
    """Reach the errors of the first kept episodes again, one seed of each kind of policy."""
    kept = pd.read_parquet(folder / EPISODES_FILE)
    again = deploy(run_spec(read_run(folder)), folder, workers=1, episodes=EPISODES)
    assert again.p_err_cm == pytest.approx(kept["p_err_cm"][:EPISODES], abs=ROUNDING_CM)
    assert again.held == pytest.approx(kept["held"][:EPISODES], abs=0.01)
