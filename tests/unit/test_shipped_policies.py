"""Policies in the repository act as their rows say."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.parts.registry import ROOT
from benchmark.runs.evaluate import deploy
from benchmark.runs.run_folder import EPISODES_FILE, check_policy, read_run, run_spec

POLICIES = sorted(path.parent for path in (ROOT / "leaderboard/policies").glob("*/run.json"))
KINDS = ("backend", "task", "observation", "algo", "effects", "randomize", "start_spread")
EPISODES = 2


ROUNDING_CM = 0.05
"""Other CPUs round otherwise, and six seconds of contact amplify it."""
ROUNDING = {"tracked": 0.02, "held": 0.01, "p_err_cm": 0.05, "q_err_deg": 0.2}
"""The same of means over all episodes."""


def _some() -> list[Path]:
    """Policies that show every engine, task, observation, algorithm and way to train once."""
    shown: set[tuple[str, object]] = set()
    some = []
    for path in POLICIES:
        spec = run_spec(read_run(path))
        kinds = {(kind, getattr(spec, kind)) for kind in KINDS}
        if kinds - shown:
            some.append(path)
            shown |= kinds
    return some


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


@pytest.mark.parametrize("folder", _some(), ids=lambda path: path.name)
def test_policy_repeats_its_row(folder: Path) -> None:
    """Reach the errors of the first kept episodes again."""
    kept = pd.read_parquet(folder / EPISODES_FILE)
    again = deploy(run_spec(read_run(folder)), folder, workers=1, episodes=EPISODES)
    assert again.p_err_cm == pytest.approx(kept["p_err_cm"][:EPISODES], abs=ROUNDING_CM)
    assert again.held == pytest.approx(kept["held"][:EPISODES], abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("folder", POLICIES, ids=lambda path: path.name)
def test_policy_repeats_its_scores(folder: Path) -> None:
    """Reach the scores of a row again, over all of its episodes."""
    row = read_run(folder)
    scores = row["scores"]
    again = deploy(run_spec(row), folder, workers=1, episodes=scores["episodes"])
    for name, rounding in ROUNDING.items():
        assert np.mean(getattr(again, name)) == pytest.approx(scores[name], abs=rounding)
