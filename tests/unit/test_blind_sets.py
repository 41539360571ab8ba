"""The sets that a solver is judged on: all can be drawn, each is drawn and solved once."""

import pytest

from benchmark.cli import app as cli
from benchmark.errors import UsageError
from benchmark.gap import blind, blind_sets

TINY = {
    "tiny-1": {"cases": 1, "rig": "joint", "real": "presliding", "seed": 3},
    "tiny-2": {"cases": 1, "rig": "joint", "real": "presliding", "seed": 4},
}


def test_every_set_can_be_drawn():
    """Name real sides, rigs and counts that can be drawn, and no seed twice."""
    sets = blind_sets.sets()
    for options in sets.values():
        wanted = blind.settings(
            options["cases"], options["real"], options["rig"], "all", "all", "all"
        )
        assert wanted.cases == options["cases"]
    assert len({options["seed"] for options in sets.values()}) == len(sets)


def test_a_set_is_drawn_and_solved_once(tmp_path, monkeypatch):
    """Draw and solve sets by name, once, after what a killed call left; score a group together."""
    monkeypatch.setattr(blind_sets, "sets", lambda: TINY)
    (tmp_path / ".tiny-1.part").mkdir()
    (tmp_path / ".tiny-1.part" / "left").touch()
    with pytest.raises(UsageError, match="is not drawn"):
        blind_sets.judge(["tiny-1"], tmp_path, ["solve"], 1)
    (row,) = blind_sets.judge([], tmp_path, blind_sets.STAGES, 1)[0]["scores"]
    assert row["cases"] == 2 and set(blind_sets.SHOWN) <= set(row)
    assert not (tmp_path / ".tiny-1.part").exists()
    kept = {file: file.stat().st_mtime_ns for file in (tmp_path / "tiny-1").rglob("*.json")}
    assert len([file for file in kept if file.parent.name == "results"]) == 1
    blind_sets.judge(["tiny-1"], tmp_path, ["draw", "solve"], 1)
    assert kept == {file: file.stat().st_mtime_ns for file in (tmp_path / "tiny-1").rglob("*.json")}
    assert (tmp_path / "scores" / "tiny" / "score.json").exists()


def test_an_unknown_set_is_refused(tmp_path, capfd):
    """Name the sets there are."""
    assert cli.call(["blind", "judge", "fingr", "--out", str(tmp_path)]) == 2
    assert "Did you mean 'finger'?" in " ".join(capfd.readouterr().err.split())
