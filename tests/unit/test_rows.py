"""Rows are read from files alone, so these tests write the files a run would."""

import json

import numpy as np
import pandas as pd
import pytest
from result_rows import detailed, resigned, rows, run, save, table

from leaderboard.details import kept_text, read_details
from leaderboard.rows import read_rows


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


@pytest.mark.parametrize("place", ["--out /home/me/x", "--out=/home/me/x", "--out '/home/me/a b'"])
def test_commands_name_no_folder_of_a_machine(place):
    """Leave out where a run was written, and nothing else."""
    item = run()
    item["provenance"] = item["provenance"] | {"command": f"bench run --seed 1 {place} --json"}
    assert table(rows(item))["command"].tolist() == ["bench run --seed 1 --json"]


def test_keeps_unknown_fields():
    """Accept fields of a later writer, and never average over them."""
    item = run(note="new")
    item["spec"] = item["spec"] | {"gamma": 0.9}
    item = resigned(item)
    (row,) = rows(item)
    assert row.spec.model_extra == {"gamma": 0.9}
    assert len(table(rows(item, run(seed=1)))) == 2


def test_details_beside_a_run_are_read_and_kept(tmp_path):
    """Read a run folder's episodes and curve, and find the same in the row that is kept."""
    item = detailed()
    scores = item.pop("episodes")
    folder = save(tmp_path / "a", item | {"curve": None})
    pd.DataFrame(scores).to_parquet(folder / "episodes.parquet")
    progress = {"steps": range(1, 201), "p_err_cm": 1.0, "q_err_deg": 2.0, "wall_s": 1.0}
    pd.DataFrame(progress | {"reward": np.arange(200.0)}).to_csv(folder / "progress.csv")
    (row,), problems = read_rows([folder])
    assert not problems and row.episodes is not None and row.curve is not None
    assert row.episodes.tracked == scores["tracked"]
    assert row.curve.steps == list(range(4, 201, 4))
    assert row.curve.reward == [1.5 + 4 * n for n in range(50)]
    (tmp_path / "kept").mkdir()
    text = kept_text(item, read_details(folder))
    (tmp_path / "kept" / "a.json").write_text(text)
    assert read_rows([tmp_path / "kept"])[0] == [row]
    assert len(text) < 6000


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"tracked": [0.5] * 99}, ("100 values of tracked", "99")),
        ({"tracked": [0.5] * 99 + [0.6]}, ("mean is 0.5",)),
        ({"held": [1.0] * 99 + [2.0]}, ("episodes.held.99", "2.0", "less than or equal to 1")),
    ],
)
def test_kept_scores_must_be_those_of_the_means(tmp_path, change, said):
    """Refuse a kept row whose episodes are not those of its scores."""
    item = detailed()
    item["episodes"] |= change
    save(tmp_path / "a", item)
    read, (problem,) = read_rows([tmp_path])
    assert not read and all(text in problem for text in said)


def test_scores_that_are_not_of_the_episodes_beside_them_are_refused(tmp_path):
    """Leave out a run whose scores were edited, or whose episodes are another's."""
    folder = save(tmp_path / "a", run())
    pd.DataFrame(detailed(0.4)["episodes"]).to_parquet(folder / "episodes.parquet")
    found, (problem,) = read_rows([folder])
    assert not found
    assert str(folder) in problem and "values of tracked whose mean is 0.5" in problem


@pytest.mark.parametrize("content", [b"", b"PAR1 no parquet at all PAR1"])
def test_a_run_with_broken_details_keeps_its_means(tmp_path, content):
    """Use the means of a run whose episodes cannot be read, and say so."""
    folder = save(tmp_path / "a", run())
    (folder / "episodes.parquet").write_bytes(content)
    (row,), (problem,) = read_rows([folder])
    assert row.episodes is None and row.scores is not None and row.scores.tracked == 0.5
    assert str(folder) in problem and "has no such details" in problem


def test_a_curve_with_holes_is_left_out(tmp_path):
    """Keep a run's row where its learning curve has steps that are no numbers, and say so."""
    folder = save(tmp_path / "a", run())
    lines = ["steps,reward,p_err_cm,q_err_deg,wall_s", "1,1,1,1,1", ",1,1,1,2"]
    (folder / "progress.csv").write_text("\n".join(lines))
    (row,), (problem,) = read_rows([folder])
    assert row.curve is None and "no finite numbers" in problem


def test_the_row_with_episodes_counts_before_the_one_without(tmp_path):
    """Take the richer of two files of one run."""
    save(tmp_path / "a", run())
    save(tmp_path / "b", detailed())
    (row,), problems = read_rows([tmp_path])
    assert row.episodes is not None and not problems


def test_old_rows_and_new_rows_are_one_line():
    """Read a row from before the training's spread was named as one with the paper's."""
    new = run(seed=1)
    new["spec"] = new["spec"] | {"spread": "paper"}
    assert table(rows(run(), resigned(new)))["seeds"].tolist() == [2]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"digest": "anything"}, "digest is 'anything'"),
        ({"spec_digest": "w9"}, "not that of this spec and world"),
        ({"spec": {"seed": 7}}, "not that of this spec and world"),
        ({"spec": {"backend": "bullet"}}, "not that of this spec and world"),
        ({"scores": {"held": 0.0}, "episodes": None}, "tracked at most held"),
        ({"policy_sha256": None}, "policy_sha256 is None"),
        ({"steps": 0}, "steps is 0"),
        ({"provenance": {"finished": "9999-01-01T00:00:00"}}, "that is past"),
        ({"provenance": {"finished": "yesterday"}}, "Invalid isoformat"),
        ({"scores": {"tracked": 0.9}}, "whose mean is 0.9"),
        ({"scores": {"episodes": 3}}, "3 values of"),
        ({"scores": {"episodes": 3}, "episodes": None}, "scores.episodes is 3; allowed: 100"),
        ({"wall_s": 0.0}, "wall_s is 0"),
        ({"wall_s": 1.0}, "1000 steps were trained at 12.5 a second"),
        ({"env_steps_per_s": 0.0}, "1000 steps were trained at 0 a second"),
    ],
)
def test_a_forged_row_is_refused(tmp_path, change, said):
    """Say what an edited row cannot be, and leave it out."""
    item = detailed()
    for name, value in change.items():
        item[name] = item[name] | value if isinstance(value, dict) else value
    found, problems = read_rows([save(tmp_path / "a", item)])
    assert found == []
    assert said in problems[0]
