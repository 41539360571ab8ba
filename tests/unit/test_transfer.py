"""Transfer: the statistics on scores that are known, and the command on real, short runs."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.cli import app as cli
from benchmark.parts.registry import ROOT
from leaderboard._heatmap import heatmap
from leaderboard.files import TRANSFERS, write
from leaderboard.statistics import REPLICATES
from leaderboard.tables import board
from leaderboard.transfer import COLUMNS, agreement, matrix, mmrv
from leaderboard.transfer_files import write_transfer

HOME, AWAY = "one built", "two built"
KEPT = sorted((ROOT / "leaderboard/transfer").glob("*/matrix.parquet"))
SHARED = {
    **{"task": "line", "radius_m": 0.02, "speed": 1.0, "stick": "reference", "algo": "ppo"},
    **{
        "observation": "pose",
        "steps": 1000,
        "randomize": True,
        "spread": "paper",
        "worlds": 8,
        "start_spread": 1.0,
    },
    **{"hand": "trx", "smoke": False, "held": 1.0, "p_err_cm": 1.0, "q_err_deg": 2.0},
}
EPISODES = 2
TRANSFER = ["--include-smoke", "--episodes", str(EPISODES), "--workers", "1", "--json"]


def scores(tracked, policy: str, deploy: str, floor: bool = False, train: str = HOME):
    """One policy's episodes in one world."""
    place = {"policy": policy, "train": train, "deploy": deploy, "floor": floor}
    seed = sum(policy.encode())
    rows = [
        {**SHARED, **place, "seed": seed, "episode": number, "tracked": value}
        for number, value in enumerate(tracked)
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def line(found: pd.DataFrame, deploy: str) -> pd.Series:
    """The matrix's only line of a deploy world."""
    (place,) = np.flatnonzero(found["deploy"] == deploy)
    return found.iloc[place]


def test_retention_is_deploy_over_train():
    """Divide the means over seeds and episodes; set the train world's own at 1."""
    tables = [
        *(scores([0.2, 0.6], name, HOME) for name in "ab"),
        *(scores([0.1, 0.2], name, AWAY) for name in "ab"),
        *(scores([0.4, 0.5], name, HOME, floor=True) for name in "ab"),
    ]
    found = matrix(pd.concat(tables))
    away, home = line(found, AWAY), line(found, HOME)
    assert away["tracked"] == pytest.approx(0.15) and away["retention"] == pytest.approx(0.375)
    assert home["retention"] == home["retention_low"] == home["retention_high"] == 1.0
    assert away["floor"] == pytest.approx(0.45 / 0.4)
    assert (away["seeds"], away["episodes"], away["interval_over"]) == (2, 2, "episodes alone")


def test_episodes_of_equal_number_are_drawn_together():
    """Give a retention that is the same in every episode no spread at all."""
    tracked = np.linspace(0.2, 0.9, 8)
    found = matrix(pd.concat([scores(tracked, "a", HOME), scores(tracked / 2, "a", AWAY)]))
    away = line(found, AWAY)
    for name in ("retention", "retention_low", "retention_high"):
        assert away[name] == pytest.approx(0.5)
    assert away["tracked_high"] - away["tracked_low"] > 0.1


def test_interval_has_the_width_of_the_mean():
    """Agree with the normal interval of a mean of many episodes, within the bootstrap's own error.

    The 2.5 % quantile of R draws from a normal has the standard error sqrt(p (1 - p) / R) / f.
    """
    tracked = np.random.default_rng(0).uniform(0, 1, 400)
    found = line(matrix(scores(tracked, "a", HOME)), HOME)
    error = tracked.std() / math.sqrt(len(tracked))
    density = math.exp(-(1.96**2) / 2) / math.sqrt(2 * math.pi)
    slack = 4 * math.sqrt(0.025 * 0.975 / REPLICATES) / density * error
    assert found["tracked_low"] == pytest.approx(tracked.mean() - 1.96 * error, abs=slack)
    assert found["tracked_high"] == pytest.approx(tracked.mean() + 1.96 * error, abs=slack)


def test_three_seeds_widen_the_interval():
    """Draw seeds too from three on: seeds that differ spread the mean though episodes do not."""
    tables = [
        scores([value] * 5, name, HOME) for name, value in zip("abc", (0.2, 0.5, 0.8), strict=True)
    ]
    two, three = matrix(pd.concat(tables[:2])).iloc[0], matrix(pd.concat(tables)).iloc[0]
    assert two["tracked_low"] == two["tracked_high"] == pytest.approx(0.35)
    assert three["interval_over"] == "seeds and episodes"
    assert three["tracked_low"] == pytest.approx(0.2) and three["tracked_high"] == pytest.approx(
        0.8
    )


def test_nothing_is_retained_of_nothing():
    """Leave the retention open where the train world's score is zero."""
    found = matrix(pd.concat([scores([0, 0], "a", HOME), scores([0, 0.5], "a", AWAY)]))
    assert math.isnan(line(found, AWAY)["retention"])
    half = matrix(pd.concat([scores([0, 0.5], "a", HOME), scores([0, 0.5], "a", AWAY)]))
    assert line(half, AWAY)["retention"] == 1.0
    assert math.isnan(line(half, AWAY)["retention_low"])


def test_policies_of_another_kind_stay_apart():
    """Keep lines for every train world, algorithm and budget of their own."""
    tables = [scores([0.5, 0.5], "a", HOME), scores([0.5, 0.5], "b", AWAY, train=AWAY)]
    tables += [scores([0.5, 0.5], "c", HOME).assign(steps=9)]
    assert len(matrix(pd.concat(tables))) == 3


def test_rank_violations_cost_what_they_lose():
    """Give zero for the same order, and the mean of each policy's worst swap otherwise."""
    reference = np.array([0.9, 0.5, 0.1])
    assert mmrv(np.array([0.3, 0.2, 0.1]), reference) == 0
    assert mmrv(np.array([0.2, 0.3, 0.1]), reference) == pytest.approx((0.4 + 0.4 + 0) / 3)
    assert mmrv(np.array([0.1, 0.2, 0.3]), reference) == pytest.approx((0.8 + 0.4 + 0.8) / 3)
    assert mmrv(np.array([0.2, 0.2, 0.1]), reference) == pytest.approx((0 + 0.4 + 0) / 3)


def test_agreement_is_with_the_reference():
    """Correlate each world's scores with the reference's, and the reference with itself again."""
    tables = []
    for policy, value in zip("abcd", (0.1, 0.3, 0.4, 0.8), strict=True):
        tables += [scores([value] * 2, policy, HOME), scores([1 - value] * 2, policy, AWAY)]
        tables += [scores([value / 2] * 2, policy, HOME, floor=True)]
    found = agreement(pd.concat(tables), HOME).set_index("world")
    assert found.loc[AWAY, "pearson"] == pytest.approx(-1) and found.loc[AWAY, "mmrv"] > 0.4
    assert found.loc[HOME, "floor"] and found.loc[HOME, "pearson"] == pytest.approx(1)
    assert found.loc[HOME, "mmrv"] == 0 and found.loc[HOME, "policies"] == 4


def test_too_little_gives_no_agreement():
    """Say why where two policies, equal scores or no reference leave nothing to correlate."""
    flat = []
    for policy, value in zip("abc", (0, 0.5, 1), strict=True):
        flat += [scores([value] * 2, policy, HOME), scores([0.5] * 2, policy, AWAY)]
    two, three = agreement(pd.concat(flat[:4]), HOME), agreement(pd.concat(flat), HOME)
    assert two["note"].tolist() == ["2 of at least 3 policies"] and two["mmrv"].isna().all()
    assert three["note"].tolist() == ["all policies score alike"] and three["pearson"].isna().all()
    assert agreement(pd.concat(flat), "three built").empty


def test_files_hold_the_matrix(tmp_path):
    """Write intervals, gaps, reasons and a picture, also where a world is missing for a policy."""
    tables = [scores([0.5, 0.7], "a", HOME), scores([0.4, 0.5], "a", AWAY)]
    tables += [scores([0.5, 0.6], "b", "three none", train="three none")]
    files = write_transfer(pd.concat(tables), HOME, ["c: a | b"], tmp_path)
    assert sorted(files) == sorted(tmp_path.iterdir())
    text = (tmp_path / "transfer.md").read_text()
    assert "x 0.75 [" in text and "- c: a \\| b" in text
    grid = [row for row in text.splitlines() if row.startswith(("| trained", "| one", "| three"))]
    scored, erred = grid[: len(grid) // 2], grid[len(grid) // 2 :]
    for part, cells in ((scored, 5), (erred, 4)):
        assert {row.replace("\\|", "").count("|") - 1 for row in part} == {cells}
    assert "1.000, 1.00 cm, 2.00 deg" in text
    assert (tmp_path / "heatmap.png").read_bytes().startswith(b"\x89PNG")


def test_the_page_shows_the_matrix_and_says_what_it_cannot_read(tmp_path):
    """Put tables and picture of every transfer beside the leaderboard on its page."""
    tables = [scores([0.5, 0.7], "a", HOME), scores([0.4, 0.5], "a", AWAY)]
    write_transfer(pd.concat(tables), HOME, [], tmp_path / TRANSFERS / "circle-engines")
    cut = tmp_path / TRANSFERS / "cut"
    cut.mkdir()
    (cut / "matrix.csv").write_text("")
    odd = tmp_path / TRANSFERS / "odd"
    write_transfer(pd.concat(tables), HOME, [], odd)
    written = pd.read_csv(odd / "matrix.csv", dtype=str)
    words = {"retention": "much", "retention_high": "1", "floor_low": "1"}
    written.assign(**words).to_csv(odd / "matrix.csv", index=False)
    write(board([]), tmp_path)
    page = (tmp_path / "leaderboard.html").read_text()
    assert "circle engines" in page and "x 0.75 [" in page and "data:image/png;base64" in page
    assert "cut: cannot be shown" in page


def test_a_transfer_without_the_reference_is_shown(tmp_path):
    """Put a matrix on the page whose policies were not deployed in the reference."""
    tables = [scores([0.5, 0.7], "a", HOME), scores([0.4, 0.5], "a", AWAY)]
    write_transfer(pd.concat(tables), "three built", [], tmp_path / TRANSFERS / "elsewhere")
    write(board([]), tmp_path)
    page = (tmp_path / "leaderboard.html").read_text()
    assert "cannot be shown" not in page and "data:image/png;base64" in page


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seeds of random actions and one hold-still on the reference, a few seconds each."""
    folder = tmp_path_factory.mktemp("runs")
    base = ["run", "--backend", "mujoco", "--task", "line", "--smoke", "--workers", "1"]
    for algo, seed in (("random", 0), ("random", 1), ("random", 2), ("hold-still", 0)):
        options = ["--algo", algo, "--seed", str(seed), "--out", str(folder / f"{algo}-{seed}")]
        assert cli.call([*base, *options]) == 0
    return folder


def first_episodes(run: Path) -> pd.DataFrame:
    """What a run kept of the episodes that are asked for here."""
    return pd.read_parquet(run / "episodes.parquet").head(EPISODES)


def test_matrix_of_real_runs(runs, tmp_path, capfd):
    """Evaluate in every world, keep every episode, and not evaluate again what is there."""
    arguments = ["transfer", str(runs), "--backend", "mujoco", "--out", str(tmp_path), *TRANSFER]
    assert cli.call(arguments) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["status"] == "done" and found["reference"] == "mujoco built"
    cells = {(row["algo"], row["deploy"]): row for row in found["matrix"]}
    assert cells.keys() == {
        (algo, f"mujoco {effects}")
        for algo in ("random", "hold-still")
        for effects in ("built", "none")
    }
    for algo, seeds, over in (
        ("random", 3, "seeds and episodes"),
        ("hold-still", 1, "episodes alone"),
    ):
        row = cells[algo, "mujoco built"]
        assert (row["seeds"], row["interval_over"], row["retention"]) == (seeds, over, 1.0)
    own = first_episodes(runs / "hold-still-0")["tracked"].mean()
    assert cells["hold-still", "mujoco built"]["tracked"] == pytest.approx(own)
    assert {(row["world"], row["floor"]) for row in found["agreement"]} == {
        ("mujoco none", False),
        ("mujoco built", True),
    }
    assert all(row["policies"] == 4 and row["mmrv"] is not None for row in found["agreement"])
    episodes = pd.read_parquet(tmp_path / "episodes.parquet")
    assert len(episodes) == 4 * 3 * EPISODES
    pd.testing.assert_frame_equal(matrix(episodes), pd.read_parquet(tmp_path / "matrix.parquet"))
    before = {f.name: f.stat().st_mtime_ns for f in (tmp_path / "evaluations").iterdir()}
    assert cli.call(arguments) == 0
    assert {f.name: f.stat().st_mtime_ns for f in (tmp_path / "evaluations").iterdir()} == before


def test_noise_floor_starts_elsewhere(runs, tmp_path, capfd):
    """Evaluate the floor in the same world from other initial states."""
    arguments = [
        "transfer",
        str(runs / "hold-still-0"),
        "--backend",
        "mujoco",
        "--effects",
        "built",
    ]
    assert cli.call([*arguments, "--out", str(tmp_path), *TRANSFER]) == 0
    episodes = pd.read_parquet(tmp_path / "episodes.parquet")
    home, floor = (episodes[episodes["floor"] == flag]["q_err_deg"].to_numpy() for flag in (0, 1))
    assert len(home) == len(floor) == EPISODES and (home != floor).all()


@pytest.mark.slow
def test_worlds_may_be_any_engine_and_effects(runs, tmp_path, capfd):
    """Deploy in another engine and with effects of one's own; keep the train world beside them."""
    arguments = [
        "transfer",
        str(runs / "hold-still-0"),
        "--backend",
        "bullet",
        "--out",
        str(tmp_path),
    ]
    effects = ["--effects", "backlash=2deg,kp-scale=-10%", "--effects", "none"]
    assert cli.call([*arguments, *effects, *TRANSFER]) == 0
    found = json.loads(capfd.readouterr().out)
    worlds = ["bullet backlash=2deg,kp-scale=-10%", "bullet none", "mujoco built"]
    assert [row["deploy"] for row in found["matrix"]] == worlds
    assert {row["train"] for row in found["matrix"]} == {"mujoco built"}


def test_settings_are_worlds_too(runs, tmp_path, capfd):
    """Deploy a policy under other paces, sizes and figures, beside the one it knows."""
    arguments = [
        "transfer",
        str(runs / "hold-still-0"),
        "--backend",
        "mujoco",
        "--effects",
        "built",
    ]
    asked = ("radius=3cm,pace=0.5", "stick=steel", "task=eight", "task=line")
    settings = [part for text in asked for part in ("--setting", text)]
    assert cli.call([*arguments, *settings, "--out", str(tmp_path), *TRANSFER]) == 0
    found = {row["deploy"]: row for row in json.loads(capfd.readouterr().out)["matrix"]}
    assert list(found) == [
        "mujoco built",
        "mujoco built radius=3cm,pace=0.5",
        "mujoco built stick=steel",
        "mujoco built task=eight",
        "mujoco built task=line",
    ]
    assert found["mujoco built task=eight"]["p_err_cm"] != found["mujoco built"]["p_err_cm"]
    larger = found["mujoco built radius=3cm,pace=0.5"]
    assert larger["p_err_cm"] > found["mujoco built"]["p_err_cm"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("speed=2", "allowed: task=..., stick=..., radius=..., pace=..."),
        ("pace", "allowed: task=..., stick=..."),
        ("pace=fast", "'fast'; allowed: a number such as 0.5"),
        ("pace=99", "allowed"),
        ("radius=3", "allowed: a number with its unit"),
        ("stick=stele", "no stick named 'stele'"),
        ("task=cirle", "no task named 'cirle'"),
    ],
)
def test_what_is_no_setting_is_refused(text, said, runs, tmp_path, capfd):
    """Say what a setting may be, and write nothing."""
    arguments = ["transfer", str(runs / "hold-still-0"), "--setting", text]
    assert cli.call([*arguments, "--out", str(tmp_path / "new")]) == 2
    assert said in capfd.readouterr().err
    assert not (tmp_path / "new").exists()


def test_equal_worlds_have_one_name(runs, tmp_path, capfd):
    """Know the train world again when its effects are written out."""
    text = "backlash=1deg,self-lock=10Nm"
    arguments = ["transfer", str(runs / "hold-still-0"), "--backend", "mujoco", "--effects", text]
    assert cli.call([*arguments, "--out", str(tmp_path), *TRANSFER]) == 0
    found = json.loads(capfd.readouterr().out)
    assert [row["deploy"] for row in found["matrix"]] == [f"mujoco {text}"]


def test_a_world_that_cannot_be_leaves_a_gap(runs, tmp_path):
    """Write the rest of the matrix, with the reason, and exit 1 when an engine is missing."""
    code = (
        "import sys; sys.modules['pybullet'] = None\n"
        "from benchmark.cli import app; sys.exit(app.call(sys.argv[1:]))"
    )
    arguments = ["transfer", str(runs / "hold-still-0"), "--backend", "mujoco,bullet"]
    arguments += ["--effects", "built", "--out", str(tmp_path), *TRANSFER]
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stderr
    found = json.loads(done.stdout)
    assert [row["deploy"] for row in found["matrix"]] == ["mujoco built"]
    assert "'pybullet', which is not installed" in found["problems"][0]
    assert "pybullet" in (tmp_path / "transfer.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["absent"], "no run folder at absent"),
        (["RUNS"], "is a smoke run; --include-smoke includes it"),
        (["RUNS", "--backend", "mujoco,bulet"], "Did you mean 'bullet'?"),
        (["RUNS", "--include-smoke", "--effects", "built,nome"], "Did you mean 'none'?"),
        (
            ["RUNS", "--include-smoke", "--effects", "none,backlash=1deg"],
            "has 'none' and other effects",
        ),
        (["RUNS", "--episodes", "1"], "--episodes is 1; allowed: 2 to 10000"),
    ],
)
def test_bad_input_is_refused(runs, arguments, words, tmp_path, capfd):
    """Say what is wrong and what is allowed, and write nothing."""
    given = [str(runs) if word == "RUNS" else word for word in arguments]
    assert cli.call(["transfer", *given, "--out", str(tmp_path / "out")]) == 2
    err = capfd.readouterr().err
    assert words in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_a_damaged_evaluation_is_reported(runs, tmp_path, capfd):
    """Name the file that cannot be read, leave its place open, and fail where nothing is left."""
    arguments = ["transfer", str(runs / "hold-still-0"), "--backend", "mujoco"]
    arguments += ["--out", str(tmp_path), *TRANSFER]
    assert cli.call(arguments) == 0
    home = first_episodes(runs / "hold-still-0")
    files = {f: pd.read_parquet(f) for f in (tmp_path / "evaluations").iterdir()}
    (own,) = (file for file, found in files.items() if found.equals(home))
    own.write_bytes(own.read_bytes()[:100])
    capfd.readouterr()
    assert cli.call(arguments) == 1
    found = json.loads(capfd.readouterr().out)
    assert f"{own} is incomplete" in found["problems"][0]
    assert [(row["deploy"], row["retention"]) for row in found["matrix"]] == [("mujoco none", None)]
    for file in files:
        file.write_bytes(b"")
    assert cli.call(arguments) == 1
    assert "no policy could be evaluated" in json.loads(capfd.readouterr().out)["error"]


@pytest.mark.parametrize("file", KEPT, ids=lambda file: file.parent.name)
def test_names_of_worlds_stand_apart(file):
    """Draw no name of a world over its neighbour's."""
    figure = heatmap(pd.read_parquet(file))
    figure.canvas.draw()
    for axes in figure.axes:
        boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
        assert not any(a.x1 > b.x0 for a, b in zip(boxes, boxes[1:], strict=False))
