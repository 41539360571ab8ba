"""The leaderboard: lines and ranks, comparisons, and the files that say them."""

import base64
import csv
import json
import random
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from result_rows import detailed, page, rendered, rows, run, save, seeds, table

from benchmark.cli import app as cli
from benchmark.runs.run_folder import RunFolder
from benchmark.settings.run_spec import RunSpec
from leaderboard.files import PICTURES, TRANSFERS, write
from leaderboard.paper import PAPER
from leaderboard.rows import read_rows
from leaderboard.tables import board
from leaderboard.verified import read_verified


def test_means_and_spread_over_seeds():
    """Give mean, sample standard deviation and count over seeds."""
    line = table(rows(*(run(x, seed=i) for i, x in enumerate((0.2, 0.4, 0.6))))).iloc[0]
    assert line["tracked"] == pytest.approx(0.4) and line["tracked_std"] == pytest.approx(0.2)
    assert (line["seeds"], line["rank"], line["wall_s"]) == (3, 1, 90.0)
    assert line["command"] == "bench run --seed 0" and line["versions"] == "mujoco 3.3, ppo 2.7"


def test_ranks_by_tracked_within_a_task():
    """Sort each task by falling `tracked`, rank from one, and let ties share a rank."""
    runs = [*seeds(0.2, algo="c"), *seeds(0.7, algo="a"), *seeds(0.7, algo="b")]
    frame = table(rows(*runs, *seeds(0.1, task="line")))
    assert frame["task"].tolist() == ["line", "eight", "eight", "eight"]
    assert frame["algo"].tolist() == ["ppo", "a", "b", "c"]
    assert frame["rank"].tolist() == [1, 1, 1, 3]


def test_gives_no_rank_under_three_seeds():
    """Show the values of two seeds, blank their rank, and rank the others as if alone."""
    frame = table(rows(*seeds(0.9, 2, algo="few"), *seeds(0.1)))
    assert frame["tracked"].tolist() == pytest.approx([0.9, 0.1])
    assert frame["rank"].isna().tolist() == [True, False] and frame["rank"][1] == 1
    assert frame["unranked"].tolist() == ["2 of at least 3 seeds", ""]


@pytest.mark.parametrize(
    "change", [{"steps": 9}, {"radius_m": 0.01}, {"speed": 2.0}, {"backend": "bullet"}]
)
def test_never_ranks_unequal_settings_together(change):
    """Rank rows of unequal budget, figure or engine apart."""
    assert table(rows(*seeds(0.9), *seeds(0.1, **change)))["rank"].tolist() == [1, 1]


def test_never_ranks_unequal_worlds_together():
    """Rank rows of unequal world digest apart, and never average over them."""
    other = seeds(0.1, spec_digest="w1")
    frame = table(rows(*seeds(0.9), *other))
    assert frame["rank"].tolist() == [1, 1] and frame["spec_digest"].tolist() == ["w0", "w1"]


def test_hides_smoke_runs(tmp_path):
    """List smoke runs only when asked, and rank them never."""
    read = rows(*seeds(0.9, smoke=True), *seeds(0.1))
    assert table(read)["tracked"].tolist() == pytest.approx([0.1])
    frame = table(read, smoke=True)
    assert frame["rank"].isna().tolist() == [True, False]
    assert frame["unranked"].tolist() == ["smoke run", ""]
    skipped = run(smoke=True, status="skipped", reason="no engine", scores=None)
    assert "no engine" not in rendered(tmp_path, rows(skipped))


def test_csv_reads_back(tmp_path):
    """Write blanks for what is not known and numbers that need no cleaning."""
    write(board(rows(run(1 / 3))), tmp_path)
    with (tmp_path / "leaderboard.csv").open(newline="") as file:
        (line,) = csv.DictReader(file)
    assert (line["rank"], line["tracked"], line["tracked_std"]) == ("", "0.333333", "")
    assert (line["steps"], line["randomize"]) == ("1000", "True")


def test_markdown_ends_each_task_with_the_paper(tmp_path):
    """Put the paper's errors last in the table of each task it reports."""
    lines = rendered(tmp_path, rows(*seeds(0.5))).splitlines()
    assert lines[0] == "Made by `bench leaderboard`; not edited by hand."
    grid = [line for line in lines if line.startswith("|")]
    assert "0.500 [0.500, 0.500]" in grid[-2] and "| 3 x 100 |" in grid[-2]
    assert "1.25 [1.25, 1.25]" in grid[-2] and "| 1.5 |" in grid[-2]
    assert "paper" in grid[-1] and "1.16" in grid[-1] and "2.36" in grid[-1]
    assert len({line.count("|") for line in grid}) == 1
    assert any("`bench run --seed 0`" in line for line in lines)
    assert list(PAPER) == ["line", "circle", "spiral", "eight"]


def test_markdown_leaves_the_paper_out_of_other_tasks(tmp_path):
    """Compare with the paper only where it reports the task."""
    assert "not reported" not in rendered(tmp_path, rows(run(task="star")))


def test_markdown_lists_what_is_not_ranked(tmp_path):
    """Count the runs that are not done, and give every reason with its pipes escaped."""
    lost = run(seed=4, status="diverged", reason="a|b\nis NaN", scores=None)
    late = run(seed=5, status="interrupted", scores=None)
    text = rendered(tmp_path, rows(run(), lost, late), ("x.json: tracked is 2",))
    assert "2: 1 diverged, 1 interrupted." in text and "| a\\|b is NaN |" in text
    assert "1 of at least 3 seeds" in text and "x.json: tracked is 2" in text


def test_same_input_gives_the_same_bytes(tmp_path):
    """Write the same bytes whatever the order of the arguments."""
    runs = [*seeds(0.3), *seeds(0.1 + 0.2, algo="b"), *seeds(0.7, task="line"), run(0.2, seed=9)]
    paths = [save(tmp_path / str(number), item) for number, item in enumerate(runs)]
    paths.append(tmp_path / "absent")
    written = set()
    for order in range(5):
        random.Random(order).shuffle(paths)
        read, problems = read_rows(paths)
        random.Random(order).shuffle(read)
        files = write(board(read, problems[::-1]), tmp_path / "board")
        written.add(b"".join(file.read_bytes() for file in files))
    assert len(written) == 1


def test_an_empty_board_is_written(tmp_path):
    """Write every file when nothing has finished."""
    for file in write(board([]), tmp_path / "new"):
        assert file.exists()
    assert (tmp_path / "new" / "leaderboard.csv").read_text().startswith("rank,task,backend")
    assert "No finished run." in rendered(tmp_path, [])
    assert "No finished run." in page(tmp_path, [])


def test_a_failed_write_leaves_the_old_file(tmp_path):
    """Keep the old file and no leftovers when the text cannot be written."""
    rendered(tmp_path, rows(run()))
    before = (tmp_path / "leaderboard.md").read_bytes()
    with pytest.raises(UnicodeEncodeError):
        rendered(tmp_path, rows(run()), ("\ud800",))
    assert (tmp_path / "leaderboard.md").read_bytes() == before
    assert not list(tmp_path.glob(".*"))


def test_intervals_and_interquartile_mean():
    """Give the middle half's mean, and intervals about the mean from three seeds on."""
    runs = [detailed(mean, seed=seed) for seed, mean in enumerate((0.4, 0.5, 0.6))]
    line = table(rows(*runs)).iloc[0]
    assert line["tracked_iqm"] == pytest.approx(0.5, abs=1e-6)
    assert line["tracked_low"] < 0.45 and line["tracked_high"] > 0.55
    assert line["tracked_iqm_low"] < 0.5 < line["tracked_iqm_high"]
    assert (line["seeds"], line["episodes"]) == (3, 300)
    few = table(rows(*runs[:2])).iloc[0]
    assert np.isnan([few["tracked_low"], few["tracked_iqm_high"]]).all()
    assert few["tracked_iqm"] == pytest.approx(0.45, abs=1e-6)


def test_rows_without_episodes_have_no_interquartile_mean():
    """Draw seeds alone where one of a line's rows has kept only its means."""
    runs = [detailed(0.4, seed=0), run(0.5, seed=1), detailed(0.6, seed=2)]
    line = table(rows(*runs)).iloc[0]
    assert np.isnan(line["tracked_iqm"])
    assert (line["tracked_low"], line["tracked_high"]) == pytest.approx((0.4, 0.6))


def test_compares_policies_over_the_tasks_they_share(tmp_path):
    """Give every pair one probability over its tasks, the likelier winner first."""
    runs = [*seeds(0.2, algo="a"), *seeds(0.9, algo="b"), *seeds(0.2, task="line", algo="a")]
    runs += [*seeds(0.9, task="line", algo="b"), *seeds(0.5, task="line", algo="c")]
    found = board(rows(*runs, *seeds(0.1, 2, algo="few"))).comparisons
    named = {(c.first["algo"], c.second["algo"]): (c.tasks, c.seeds) for c in found}
    assert named == {
        ("b", "a"): (("line", "eight"), (6, 6)),
        ("b", "c"): (("line",), (3, 3)),
        ("c", "a"): (("line",), (3, 3)),
    }
    assert all(c.probability.value == 1.0 for c in found)
    text = rendered(tmp_path, rows(*runs))
    assert "## Probability of improvement" in text and "6 against 6 | 1.00 [1.00, 1.00]" in text


def test_the_likelier_winner_over_all_tasks_comes_first():
    """Turn a pair round when the policy that leads one task loses the two others."""
    runs = [item for task in ("circle", "eight") for item in seeds(0.9, task=task, algo="b")]
    runs += [item for task in ("circle", "eight") for item in seeds(0.5, task=task, algo="a")]
    runs += [*seeds(0.9, task="line", algo="a"), *seeds(0.5, task="line", algo="b")]
    (found,) = board(rows(*runs)).comparisons
    assert (found.first["algo"], found.second["algo"]) == ("b", "a")
    assert found.probability.value == pytest.approx(2 / 3)
    assert found.probability.low == found.probability.high == pytest.approx(2 / 3)


@pytest.mark.parametrize("change", [{"steps": 9}, {"backend": "bullet"}, {"spec_digest": "w1"}])
def test_never_compares_unequal_worlds_or_budgets(change):
    """Compare nothing across engine, world or budget."""
    others = seeds(0.1, algo="b", **change)
    assert not board(rows(*seeds(0.9), *others)).comparisons


class Tags(HTMLParser):
    """Counts tags, and what they would fetch."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.count: dict[str, int] = {}
        self.fetched: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Count one tag."""
        self.count[tag] = self.count.get(tag, 0) + 1
        self.fetched += [v or "" for k, v in attrs if k in ("src", "href", "srcset", "data")]


def test_page_stands_alone(tmp_path):
    """Show intervals, seeds, the paper and learning curves, and fetch nothing for it."""
    runs = [detailed(mean, seed=seed) for seed, mean in enumerate((0.4, 0.5, 0.6))]
    text = page(tmp_path, rows(*runs))
    tags = Tags(text)
    assert tags.count["circle"] == 3 * 3 and text.count('class="bar"') == 3
    assert text.count('class="paper"') == 3 and "2.36" in text
    assert text.count('class="curve"') == 2 and tags.count["script"] == 1
    assert all(target.startswith(("#", "data:")) for target in tags.fetched)
    assert "3 x 100" in text and "mujoco 3.3, ppo 2.7" in text and "w0" in text


def test_page_escapes_what_rows_say(tmp_path):
    """Show markup in names and reasons as text."""
    lost = run(seed=4, status="diverged", reason="<b>q</b> & so", scores=None)
    text = page(tmp_path, rows(run(algo="<script>"), lost), ("<i>.json: bad",))
    assert {"b", "i"}.isdisjoint(Tags(text).count) and Tags(text).count["script"] == 1
    assert "&lt;b&gt;q&lt;/b&gt; &amp; so" in text and "&lt;i&gt;.json: bad" in text


def test_page_shows_pictures_with_their_captions(tmp_path):
    """Put the PNG files of the folder into the page, and name what is none."""
    about = PngInfo()
    about.add_text("Title", "ten circles")
    about.add_text("Source", "bench view a --out b.png")
    (tmp_path / "figures").mkdir()
    Image.new("RGB", (4, 4)).save(tmp_path / "figures" / "a.png", pnginfo=about)
    (tmp_path / "figures" / "b.png").write_bytes(b"no picture")
    text = page(tmp_path, rows(run()))
    assert Tags(text).count["img"] == 1 and 'src="data:image/png;base64,' in text
    assert "ten circles" in text and "bench view a --out b.png" in text
    assert "b.png: cannot be shown" in text


def test_command_keeps_rows_and_writes_files(tmp_path, capfd):
    """Keep a run's row with its episodes, and make the same board from it without the run."""
    folder = RunFolder(
        tmp_path / "a", RunSpec(backend="mujoco", task="line", algo="random", steps=0)
    )
    folder.claim(resume=False, force=False)
    item = detailed()
    folder.write_run("done", scores=item["scores"], wall_s=1.0)
    pd.DataFrame(item["episodes"]).to_parquet(folder.path / "episodes.parquet")
    out = tmp_path / "board"
    command = ["leaderboard", str(folder.path), "--out", str(out), "--add", "--json"]
    assert cli.call(command) == 0
    assert json.loads(capfd.readouterr().out)["rows"] == 1
    (kept,) = read_rows([out / "results"])[0]
    assert kept.episodes is not None and kept.episodes.tracked == item["episodes"]["tracked"]
    written = {file.name: file.read_bytes() for file in out.glob("leaderboard.*")}
    assert sorted(written) == ["leaderboard.csv", "leaderboard.html", "leaderboard.md"]
    shutil.rmtree(folder.path)
    (out / "leaderboard.html").unlink()
    assert cli.call(["leaderboard", "--out", str(out), "--no-html"]) == 0
    del written["leaderboard.html"]
    assert {file.name: file.read_bytes() for file in out.glob("leaderboard.*")} == written


def test_command_refuses_an_empty_place(tmp_path, capfd):
    """Exit with 1 and name the place where nothing was found, and write nothing."""
    assert cli.call(["leaderboard", str(tmp_path / "no"), "--out", str(tmp_path / "board")]) == 1
    assert f"nothing to rank in {tmp_path / 'no'}" in capfd.readouterr().err
    assert not (tmp_path / "board").exists()


def test_shipped_files_come_from_the_shipped_rows(tmp_path: Path) -> None:
    """Find in the repo what `bench leaderboard` makes of its rows and figures, byte for byte."""
    home = Path(__file__).parents[2] / "leaderboard"
    read, problems = read_rows([home / "results"])
    assert not problems
    for name in (PICTURES, TRANSFERS):
        if (home / name).is_dir():
            shutil.copytree(home / name, tmp_path / name)
    for file in write(board(read, problems, verified=read_verified(home)), tmp_path):
        assert file.read_bytes() == (home / file.name).read_bytes()
        assert file.stat().st_size < 4_000_000


def test_page_begins_with_a_summary(tmp_path):
    """Say what is best and how to add a row, and hand out every row as CSV."""
    runs = [detailed(mean, seed=seed) for seed, mean in enumerate((0.4, 0.5, 0.6))]
    text = page(tmp_path, rows(*runs, run(task="line", seed=0)))
    said = text.partition('<dl class="summary">')[2].partition("</dl>")[0]
    assert "0.50 (mujoco: " in said and "4 runs of 2 policies, 1 of them ranked." in said
    assert "bench leaderboard runs --add" in said
    table = text.partition("data:text/csv;base64,")[2].partition('"')[0]
    assert base64.b64decode(table).startswith(b"rank,task,backend")
