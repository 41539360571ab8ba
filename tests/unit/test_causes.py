"""What makes a loss of transfer: the shares on scores that are known, and the command on a run."""

import json
from pathlib import Path

import pandas as pd
import pytest

from benchmark.cli import app as cli
from benchmark.results.explain import switches
from benchmark.settings.run_spec import RunSpec
from leaderboard.causes import AT_HOME, AWAY, CAUSES, HOME, THERE, TOGETHER, best, causes, losses
from leaderboard.causes_files import read_causes, write_causes
from leaderboard.transfer_files import read_sources, write_transfer
from tests.unit.test_transfer import SHARED, scores

ONE, TWO = "mujoco built", "bullet built"
RUN = RunSpec(backend="mujoco", task="line", algo="hold-still")


def cell(name: str, tracked: float, switched: str = "") -> pd.DataFrame:
    """Episodes of three seeds in one of a cell's worlds."""
    place = {"train": ONE, "deploy": TWO, "difference": name, "effects": name, "switched": switched}
    rows = [
        {**SHARED, **place, "policy": seed, "seed": ord(seed), "episode": n, "tracked": tracked}
        for seed in "abc"
        for n in range(2)
    ]
    return pd.DataFrame(rows, columns=list(CAUSES))


WORLDS = pd.concat(
    [
        *(cell(HOME, 0.8), cell(AWAY, 0.4)),
        *(cell("touch-force", 0.7, THERE), cell("contact-softness", 0.7, AT_HOME)),
        cell(TOGETHER, 0.9, THERE),
    ]
)


def test_shares_of_a_loss():
    """Divide what is won there, or lost at home, by the loss; the largest share comes first."""
    found = causes(WORLDS)
    assert list(found["difference"]) == [TOGETHER, "touch-force", "contact-softness"]
    assert list(found["won"]) == pytest.approx([1.25, 0.75, 0.25])
    assert list(found["won_low"]) == pytest.approx([1.25, 0.75, 0.25])
    assert list(found["seeds"]) == [3, 3, 3] and (found["home"] - found["away"] > 0.39).all()
    (one,) = best(found)
    assert one["difference"] == "touch-force"


def test_only_losses_are_explained():
    """Take cells that lose a tenth or more against their own train world."""
    tables = [scores([0.8, 0.8], "a", ONE, train=ONE), scores([0.75, 0.75], "a", TWO, train=ONE)]
    tables += [scores([0.6, 0.8], "a", "three none", train=ONE)]
    assert [key[-2:] for key in losses(pd.concat(tables))] == [(ONE, "three none")]


def test_files_hold_the_causes(tmp_path):
    """Write every share and the reasons, and read the episodes again."""
    files = write_causes(WORLDS, ONE, ["a: b | c"], tmp_path)
    assert sorted(files) == sorted(tmp_path.iterdir())
    text = (tmp_path / "causes.md").read_text()
    assert "| touch-force | touch-force | there | 0.70 [0.70, 0.70] | 0.75 [0.75, 0.75] |" in text
    assert "- a: b \\| c" in text
    episodes, notes = read_causes(tmp_path)
    assert notes == ["a: b | c"] and len(causes(episodes)) == 3


@pytest.mark.parametrize(
    ("train", "deploy", "wanted"),
    [
        (
            "mujoco none",
            "mujoco built",
            {"backlash": (THERE, "self-lock=10Nm"), "self-lock": (THERE, "backlash=1deg")},
        ),
        (
            "bullet none",
            "mujoco none",
            {
                "torsional-friction": (THERE, "torsional-friction=-3mm"),
                "touch-force": (AT_HOME, "touch-force=0.1N"),
            },
        ),
        ("mujoco none", "sapien none", {"touch-force": (THERE, "touch-force=0.1N")}),
    ],
)
def test_differences_follow_from_what_engines_say(train, deploy, wanted):
    """Switch each there, or at home where the deploy world's engine cannot have it."""
    found = {one.difference: one for one in switches(RUN, train, deploy)}
    for name, (switched, effects) in wanted.items():
        assert (found[name].switched, found[name].spec.effects) == (switched, effects)
        assert found[name].spec.backend == (deploy if switched == THERE else train).split()[0]


def test_a_loss_of_a_real_run_is_explained(tmp_path: Path, capfd):
    """Deploy with one difference at a time; with all of them the world is the train world."""
    run, matrix, out = (str(tmp_path / name) for name in ("run", "matrix", "causes"))
    base = ["run", "--backend", "mujoco", "--task", "line", "--algo", "hold-still", "--smoke"]
    assert cli.call([*base, "--workers", "1", "--out", run]) == 0
    options = ["--include-smoke", "--episodes", "2", "--workers", "1", "--json"]
    assert cli.call(["transfer", run, "--backend", "mujoco", "--out", matrix, *options]) == 0
    episodes, reference, notes = read_sources(Path(matrix))
    lost = (episodes["deploy"] != episodes["train"]) & ~episodes["floor"]
    own = episodes[~lost & ~episodes["floor"]]["tracked"].mean()
    episodes.loc[lost, "tracked"] = own - 0.5
    write_transfer(episodes, reference, notes, Path(matrix))
    capfd.readouterr()
    assert cli.call(["transfer", matrix, "--explain", "--out", out, *options]) == 0
    found = json.loads(capfd.readouterr().out)
    lines = {line["difference"]: line for line in found["causes"]}
    assert lines.keys() == {"backlash", "self-lock", TOGETHER}
    assert lines[TOGETHER]["tracked"] == pytest.approx(own)
    assert lines[TOGETHER]["won"] == pytest.approx(1.0)
    assert all(Path(file).exists() for file in found["written"])
    Path(run).rename(tmp_path / "moved")
    again = ["transfer", matrix, "--explain", "--out", str(tmp_path / "again"), *options]
    assert cli.call(again) == 2
    assert "are not where they were; give their folders" in capfd.readouterr().err
    assert cli.call([*again, str(tmp_path / "moved")]) == 0


@pytest.mark.parametrize("given", [[], ["elsewhere"]])
def test_a_matrix_is_needed(given, tmp_path, capfd):
    """Refuse folders among which no matrix is."""
    folders = [str(tmp_path), *(str(tmp_path / name) for name in given)]
    assert cli.call(["transfer", *folders, "--explain", "--out", str(tmp_path / "new")]) == 2
    assert "bench transfer --out" in capfd.readouterr().err
