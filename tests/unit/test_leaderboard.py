"""The leaderboard reads files alone, so these tests write the files a run would."""

import csv
import json
import random
from pathlib import Path

import pytest

from leaderboard.paper import PAPER
from leaderboard.rows import Row, read_rows
from leaderboard.tables import table, write_csv, write_markdown

SPEC = {
    **{"backend": "mujoco", "hand": "trx", "stick": "reference", "effects": "built"},
    **{"task": "eight", "radius_m": 0.02, "speed": 1.0, "observation": "pose", "algo": "ppo"},
    **{"steps": 1000, "seed": 0, "randomize": True, "worlds": 256, "smoke": False},
}


def run(tracked: float = 0.5, **changes: object) -> dict:
    """A finished run; `changes` go to its spec, or to the row where the spec has no such field."""
    spec = SPEC | {name: value for name, value in changes.items() if name in SPEC}
    row = {name: value for name, value in changes.items() if name not in SPEC}
    scores = {"p_err_cm": 1.25, "q_err_deg": 2.5, "held": 1.0, "tracked": tracked, "episodes": 100}
    provenance = {
        **{"command": f"bench run --seed {spec['seed']}", "cpu": "x", "cores": 2, "commit": "c"},
        **{"versions": {"mujoco": "3.3", "numpy": "2.0", "ppo": "2.7"}, "platform": "linux"},
        "finished": "2026-01-01T00:00:00",
    }
    return {
        **{"schema": 1, "status": "done", "reason": "", "spec": spec, "digest": str(spec)},
        **{"spec_digest": "w0", "scores": scores, "steps": 1000, "wall_s": 90.0},
        **{"env_steps_per_s": 11.0, "policy_sha256": None, "provenance": provenance},
    } | row


def seeds(tracked: float, count: int = 3, **changes: object) -> list[dict]:
    """Finished runs that differ in their seed alone."""
    return [run(tracked, seed=seed, **changes) for seed in range(count)]


def rows(*runs: dict) -> list[Row]:
    return [Row.model_validate(item) for item in runs]


def save(folder: Path, item: dict) -> Path:
    folder.mkdir(parents=True)
    (folder / "run.json").write_text(json.dumps(item))
    return folder


def rendered(folder: Path, read: list[Row], problems: tuple[str, ...] = ()) -> str:
    write_markdown(table(read), read, problems, folder / "board.md")
    return (folder / "board.md").read_text()


def test_reads_every_kind_of_path(tmp_path):
    """Find a run folder, run folders at depth and a bare file."""
    one = save(tmp_path / "one", run(seed=1))
    (one / "contract.json").write_text("{}")
    save(tmp_path / "deep" / "a" / "b", run(seed=2))
    (tmp_path / "shipped").mkdir()
    (tmp_path / "shipped" / "any.json").write_text(json.dumps(run(seed=3)))
    paths = [one, tmp_path / "deep", tmp_path / "shipped" / "any.json"]
    read, problems = read_rows(paths)
    assert [row.spec.seed for row in read] == [1, 2, 3] and not problems
    assert read_rows([tmp_path / "shipped"])[0] == read_rows(paths[2:])[0]


def test_counts_equal_digests_once(tmp_path):
    """Count a run that lies in two files once, the finished one before the interrupted one."""
    save(tmp_path / "a", run(seed=1))
    save(tmp_path / "b", run(seed=1))
    save(tmp_path / "c", run(seed=1, status="interrupted", scores=None))
    read, problems = read_rows([tmp_path, tmp_path / "a"])
    assert [row.status for row in read] == ["done"] and not problems
    assert table([*read, *read])["seeds"].tolist() == [1]


def test_reports_equal_digests_with_unequal_scores(tmp_path):
    """Say so when two files of one run disagree."""
    save(tmp_path / "a", run(0.5))
    save(tmp_path / "b", run(0.6))
    read, problems = read_rows([tmp_path])
    assert len(read) == len(problems) == 1 and "other scores" in problems[0]


@pytest.mark.parametrize(
    ("part", "field", "value", "said"),
    [
        ("scores", "tracked", 1.5, ("scores.tracked", "1.5", "less than or equal to 1")),
        ("scores", "p_err_cm", float("nan"), ("scores.p_err_cm", "nan", "finite")),
        ("scores", "held", -0.1, ("scores.held", "-0.1", "greater than or equal to 0")),
        ("spec", "randomize", "yes", ("spec.randomize", "'yes'", "boolean")),
        ("spec", "task", None, ("spec.task", "None", "string")),
        ("", "status", "fine", ("status", "'fine'", "'done'")),
        ("", "schema", 2, ("schema", "2", "1")),
        ("", "scores", None, ("scores", "None", "the scores")),
    ],
)
def test_names_field_value_and_what_is_allowed(tmp_path, part, field, value, said):
    """Refuse a bad value by file, field, value and allowed values, and read the others."""
    bad = run(seed=1)
    (bad[part] if part else bad)[field] = value
    save(tmp_path / "bad", bad)
    save(tmp_path / "good", run(seed=2))
    read, (problem,) = read_rows([tmp_path])
    assert [row.spec.seed for row in read] == [2]
    assert all(text in problem for text in (str(tmp_path / "bad" / "run.json"), *said, "allowed"))


def test_survives_broken_files(tmp_path):
    """Give one message for each file or path that is no result, and read the others."""
    whole = json.dumps(run())
    partial = {name: value for name, value in run().items() if name != "digest"}
    texts = [whole[:200], "", "\0\xff", "[]", "[" * 100_000, json.dumps(partial)]
    for number, text in enumerate(texts):
        (tmp_path / f"{number}.json").write_bytes(text.encode("latin-1"))
    (tmp_path / "good.json").write_text(whole)
    read, problems = read_rows([tmp_path, tmp_path / "absent"])
    assert len(read) == 1 and len(problems) == len(texts) + 1
    assert "digest is missing" in problems[5] and "absent" in problems[6]


def test_accepts_nan_scores_of_a_run_that_diverged(tmp_path):
    """Read a diverged run whatever its scores are, and use none of them."""
    item = run(float("nan"), status="diverged", reason="joint_rad is NaN at 0.5 s")
    (row,), problems = read_rows([save(tmp_path / "a", item)])
    assert row.scores is None and not problems and table([row]).empty


def test_keeps_unknown_fields():
    """Accept fields of a later writer, and never average over them."""
    item = run(note="new")
    item["spec"] = item["spec"] | {"gamma": 0.9}
    (row,) = rows(item)
    assert row.spec.model_extra == {"gamma": 0.9}
    assert len(table(rows(item, run(seed=1)))) == 2


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
    other = [row | {"digest": f"w1-{n}", "spec_digest": "w1"} for n, row in enumerate(seeds(0.1))]
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
    write_csv(table(rows(run(1 / 3))), tmp_path / "board.csv")
    with (tmp_path / "board.csv").open(newline="") as file:
        (line,) = csv.DictReader(file)
    assert (line["rank"], line["tracked"], line["tracked_std"]) == ("", "0.333333", "")
    assert (line["steps"], line["randomize"]) == ("1000", "True")


def test_markdown_ends_each_task_with_the_paper(tmp_path):
    """Put the paper's errors last in the table of each task it reports."""
    lines = rendered(tmp_path, rows(*seeds(0.5))).splitlines()
    assert lines[0] == "Made by `bench leaderboard`; not edited by hand."
    grid = [line for line in lines if line.startswith("|")]
    assert "0.500 ± 0.000" in grid[-2] and "1.25 ± 0.00" in grid[-2] and "| 1.5 |" in grid[-2]
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
        write_csv(table(read), tmp_path / "board.csv")
        write_markdown(table(read), read, problems[::-1], tmp_path / "board.md")
        written.add((tmp_path / "board.csv").read_bytes() + (tmp_path / "board.md").read_bytes())
    assert len(written) == 1


def test_an_empty_board_is_written(tmp_path):
    """Write both files when nothing has finished."""
    write_csv(table([]), tmp_path / "new" / "board.csv")
    assert (tmp_path / "new" / "board.csv").read_text().startswith("rank,task,backend")
    assert "No finished run." in rendered(tmp_path, [])


def test_a_failed_write_leaves_the_old_file(tmp_path):
    """Keep the old file and no leftovers when the text cannot be written."""
    rendered(tmp_path, rows(run()))
    before = (tmp_path / "board.md").read_bytes()
    with pytest.raises(UnicodeEncodeError):
        rendered(tmp_path, rows(run()), ("\ud800",))
    assert (tmp_path / "board.md").read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["board.md"]


def test_shipped_files_come_from_the_shipped_rows(tmp_path: Path) -> None:
    """Find in the repo what `bench leaderboard` makes of its rows, byte for byte."""
    home = Path(__file__).parents[2] / "leaderboard"
    read, problems = read_rows([home / "results"])
    assert not problems
    frame = table(read)
    write_csv(frame, tmp_path / "leaderboard.csv")
    write_markdown(frame, read, problems, tmp_path / "leaderboard.md")
    for name in ("leaderboard.csv", "leaderboard.md"):
        assert (tmp_path / name).read_bytes() == (home / name).read_bytes()
