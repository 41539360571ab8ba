"""The history of the blind sets: a new score goes in by one command, and is read again."""

from datetime import datetime

import blind_scores as scores
import pytest

from leaderboard.blind.__main__ import FOLDER, main
from leaderboard.blind.add import add, latest
from leaderboard.blind.history import history_text, line_of, read_history
from leaderboard.blind.score import ScoreError, read_score

DAY = datetime(2026, 1, 2, 3, 4)


def put(folder, found: dict, **options):
    """Add a score to a folder."""
    path = scores.save(folder.parent / "score.json", found)
    return add(path, folder, **{"commit": "abc", "date": DAY, **options})


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "blind"


def test_kept_history_reads_and_writes_alike():
    """Read the repository's own history, with a line for each of the latest scores."""
    lines = read_history(FOLDER)
    assert (FOLDER / "history.csv").read_text() == history_text(lines)
    by_name = {line.name: line for line in lines}
    assert len(by_name) == len(lines)
    for kind, found in latest(FOLDER).items():
        for name, score in found.items():
            line = by_name[name]
            assert (line.kind, line.blind) == (kind, True)
            assert line_of(score, name, line.date, line.commit) == line


def test_a_score_becomes_a_line_and_the_latest_of_its_kind(folder):
    """Keep what a score is of, what it counted, and its full file."""
    line = put(folder, scores.score(right=8, count=10, sides=("bullet", "mujoco")))
    assert [line] == read_history(folder)
    assert line.name == "finger-bullet-mujoco-2026-01-02"
    assert (line.cases, line.blind, line.commit, line.date) == (8, True, "abc", DAY)
    assert line.figures["top1"].hits == 8 and line.figures["top1"].count == 10
    assert line.figures["cpu_s_median"].count == 0
    (kept,) = latest(folder)[line.kind].values()
    assert kept.of_side("bullet", "top1").hits == 8


def test_a_newer_score_supersedes_its_kind_alone(folder):
    """Replace the latest of the same sides, keep that of others and the whole history."""
    put(folder, scores.score())
    other = put(folder, scores.score(sides=("dart",)))
    newer = put(folder, scores.score(right=9))
    assert {name for found in latest(folder).values() for name in found} == {newer.name, other.name}
    assert len(read_history(folder)) == 3 and newer.name.endswith("-2")


def test_sets_of_one_solver_count_together(folder):
    """Keep both scores where one is added to the other."""
    first = put(folder, scores.score())
    second = put(folder, scores.score(right=9), pool=True)
    assert set(latest(folder)[first.kind]) == {first.name, second.name}


def test_a_tuning_set_is_not_shown(folder):
    """Take what was tuned on into the history and not among the latest."""
    put(folder, scores.score(frozen=False))
    assert latest(folder) == {} and not read_history(folder)[0].blind


def test_what_is_there_is_not_taken_twice(folder):
    """Refuse the same score and a name that is taken."""
    put(folder, scores.score(), name="a")
    with pytest.raises(ScoreError, match="there already, as 'a'"):
        put(folder, scores.score(), name="b")
    with pytest.raises(ScoreError, match="set 'a'"):
        put(folder, scores.score(right=1), name="a")
    assert len(read_history(folder)) == 1


@pytest.mark.parametrize(
    ("change", "field"),
    [({"cases": "many"}, "cases"), ({"tables": {}}, "cases"), ({"intervals": None}, "intervals")],
)
def test_what_is_no_score_is_refused(tmp_path, change, field):
    """Name the file and the field."""
    path = scores.save(tmp_path / "score.json", scores.score() | change)
    with pytest.raises(ScoreError, match=f"score.json is no blind score.*{field}"):
        read_score(path)


def test_command_adds_a_score(tmp_path, folder, capsys):
    """Say what was added and what to do next; exit 2 with the reason for what is no score."""
    path = scores.save(tmp_path / "score.json", scores.score())
    options = ["--folder", str(folder), "--commit", "abc", "--date", "2026-01-02 03:04"]
    assert main(["add", str(path), *options]) == 0
    assert "added finger-mujoco-2026-01-02" in capsys.readouterr().out
    assert main(["add", str(tmp_path / "none.json"), *options]) == 2
    assert "none.json cannot be read" in capsys.readouterr().err
