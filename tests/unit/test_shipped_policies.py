"""Policies in the repository act as their rows say."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.cli import app as cli
from benchmark.parts.registry import ROOT
from benchmark.runs.run import deploy
from benchmark.runs.run_folder import EPISODES_FILE, check_policy, read_run, run_spec
from leaderboard.identity import run_digest

POLICIES = sorted(path.parent for path in (ROOT / "leaderboard/policies").glob("*/run.json"))
KINDS = ("backend", "task", "observation", "algo", "effects", "randomize", "start_spread")
EPISODES = 4


def _other_world(row: dict) -> None:
    """Claim another hand, with digests that fit the claim."""
    row["spec"]["effects"] = "none"
    row["digest"] = run_digest(row["spec"], row["spec_digest"])


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


@pytest.mark.parametrize(
    ("edit", "state"),
    [(None, 0), (lambda row: row["scores"].update(p_err_cm=0.31), 1), (_other_world, 1)],
)
def test_verify_tells_a_true_row_from_an_edited_one(edit, state, tmp_path, capfd):
    """Replay a policy, mark its row where the scores hold, and say which one does not."""
    folder = tmp_path / "policies/one"
    shutil.copytree(next(p for p in POLICIES if p.name.startswith("mujoco")), folder)
    row = json.loads((folder / "run.json").read_text())
    if edit is not None:
        edit(row)
        (folder / "run.json").write_text(json.dumps(row))
    words = ["verify", str(tmp_path / "policies"), "--out", str(tmp_path), "--json"]
    assert cli.call(words) == state
    found = json.loads(capfd.readouterr().out)
    assert found["verified"] == 1 - state
    assert (tmp_path / "verified.json").exists() == (state == 0)
    assert len(found["failed"]) == state


@pytest.mark.slow
@pytest.mark.parametrize("folder", POLICIES, ids=lambda path: path.name)
def test_policy_repeats_its_scores(folder: Path) -> None:
    """Reach the scores of a row again, over all of its episodes."""
    row = read_run(folder)
    scores = row["scores"]
    again = deploy(run_spec(row), folder, workers=1, episodes=scores["episodes"])
    for name, rounding in ROUNDING.items():
        assert np.mean(getattr(again, name)) == pytest.approx(scores[name], abs=rounding)
