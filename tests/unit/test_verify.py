"""`bench verify`: a true row is marked, and a forged one is told from it."""

import json
import shutil

import pandas as pd
import pytest

from benchmark.cli import app as cli
from leaderboard.identity import run_digest


def _other_world(row: dict) -> None:
    """Claim another hand, with digests that fit the claim."""
    row["spec"]["effects"] = "none"
    row["digest"] = run_digest(row["spec"], row["spec_digest"])


@pytest.fixture
def verified(finished, tmp_path, capfd):
    """Verifies a copy of a finished run after edits of its row and its episodes."""

    def verify(row=lambda row: None, episodes=lambda table: None) -> dict:
        folder = tmp_path / "policies/one"
        shutil.copytree(finished, folder)
        item, table = json.loads((folder / "run.json").read_text()), folder / "episodes.parquet"
        kept = pd.read_parquet(table)
        row(item)
        episodes(kept)
        (folder / "run.json").write_text(json.dumps(item))
        kept.to_parquet(table, index=False)
        words = ["verify", str(tmp_path / "policies"), "--out", str(tmp_path / "new"), "--json"]
        code = cli.call(words)
        found = json.loads(capfd.readouterr().out)
        assert code == len(found["failed"]) == 1 - found["verified"]
        assert (tmp_path / "new/verified.json").exists() == (code == 0)
        return found

    return verify


def test_a_true_row_is_marked(verified):
    """Replay a policy, and mark its row where the scores hold."""
    assert verified()["exact"] == 1


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda row: row["scores"].update(p_err_cm=0.31), "whose mean is 0.31"),
        (lambda row: row["scores"].update(episodes=3), "scores.episodes is 3"),
        (lambda row: row.update(steps=0), "steps is 0"),
        (lambda row: row.update(wall_s=0.0), "wall_s is 0"),
        (_other_world, "spec_digest is not that"),
    ],
)
def test_an_edited_row_is_refused(verified, edit, said):
    """Say what is impossible in a row."""
    assert said in verified(edit)["failed"][0]["reason"]


def test_a_row_that_is_possible_and_untrue_is_found(verified):
    """Name the score that the policy does not reach again, though row and episodes agree on it."""

    def farther(table: pd.DataFrame) -> None:
        table["p_err_cm"] += 5

    found = verified(
        lambda row: row["scores"].update(p_err_cm=row["scores"]["p_err_cm"] + 5), farther
    )
    assert "replayed" in found["failed"][0]["reason"]
