"""A submission is replayed before it is written, and checked when it arrives."""

import json
import shutil
from pathlib import Path

import pytest

from benchmark.cli import app as cli
from benchmark.parts.registry import ROOT

POLICY = min((ROOT / "leaderboard/policies").glob("mujoco-*"))


def call(words: list[str], capfd: pytest.CaptureFixture[str]) -> tuple[int, dict]:
    """A command's exit code and its JSON."""
    code = cli.call([*words, "--json"])
    return code, json.loads(capfd.readouterr().out)


@pytest.fixture(scope="module")
def submission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shipped policy, submitted."""
    out = tmp_path_factory.mktemp("elsewhere") / "submission"
    assert cli.call(["submit", str(POLICY), "--out", str(out)]) == 0
    return out


def test_a_submission_joins_a_board(submission, tmp_path, capfd):
    """Write rows, policies and digests; rank them on another board."""
    said = json.loads((submission / "submission.json").read_text())
    (name,) = said["rows"]
    kept = {f"policies/{name}/{file}" for file in ("policy.onnx", "run.json", "README.md")}
    assert kept <= set(said["files"])
    words = ["leaderboard", str(submission), "--add", "--policies", "--out", str(tmp_path)]
    code, found = call(words, capfd)
    assert (code, found["rows"], found["policies"]) == (0, 1, 1)
    assert (tmp_path / "policies" / name / "policy.onnx").exists()


@pytest.mark.parametrize(
    ("file", "words"), [("contract.json", "contract.json"), ("extra.txt", "extra.txt")]
)
def test_what_was_changed_on_the_way_is_named(submission, file, words, tmp_path, capfd):
    """Refuse a run whose files are not those that were submitted."""
    came = tmp_path / "came"
    shutil.copytree(submission, came)
    (run,) = (came / "policies").iterdir()
    with (run / file).open("a") as out:
        out.write(" ")
    code, found = call(["verify", str(came)], capfd)
    assert code == 1 and found["verified"] == 0
    assert f"not as submitted: {words}" in found["failed"][0]["reason"]


def test_a_run_that_is_missing_is_named(submission, tmp_path, capfd):
    """Refuse a submission that lacks a run."""
    came = tmp_path / "came"
    shutil.copytree(submission, came)
    shutil.copytree(came / "policies", tmp_path / "kept")
    shutil.rmtree(came / "policies")
    shutil.copytree(next((tmp_path / "kept").iterdir()), came / "policies/other")
    code, found = call(["verify", str(came)], capfd)
    assert code == 2 and "policy.onnx" in found["error"]


def test_a_row_that_is_not_verified_is_not_submitted(tmp_path, capfd):
    """Write nothing where a row was edited, and keep an earlier submission."""
    run, out = tmp_path / "run", tmp_path / "submission"
    shutil.copytree(POLICY, run)
    row = json.loads((run / "run.json").read_text())
    row["scores"]["episodes"] = 3
    (run / "run.json").write_text(json.dumps(row))
    code, found = call(["submit", str(run), "--out", str(out)], capfd)
    assert code == 1 and "scores.episodes is 3" in found["error"]
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_other_folders_are_left_alone(tmp_path, capfd):
    """Replace nothing that is no submission."""
    (tmp_path / "thesis.tex").write_text("years of work")
    code, found = call(["submit", str(POLICY), "--out", str(tmp_path)], capfd)
    assert code == 2 and "no submission" in found["error"]
    assert (tmp_path / "thesis.tex").exists()
