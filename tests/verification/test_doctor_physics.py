"""`bench doctor physics`: what it takes, writes, prints and exits with."""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from backends.engine import Engine
from benchmark.cli import app as cli
from benchmark.physics import free, suite
from benchmark.physics.check import Check

PHYSICS = ["doctor", "physics", "--backend", "mujoco"]


def diverged(engine: type[Engine]) -> Iterator[Check]:
    """A check without a figure."""
    yield Check(name="ran away", figure=math.nan, unit="m", expected=0.0, bound=1.0, why="none")


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """One check instead of all."""
    monkeypatch.setattr(suite, "ALONE", (free.fall,))
    return monkeypatch


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["doctor", "--physics"], "run `bench doctor physics`"),
        (["doctor", "--json", "--physics"], "run `bench doctor physics`"),
        (["doctor", "--backend", "bullet"], "See `bench doctor installation --help`"),
        (["doctor", "physics", "--backend", "bulet"], "Did you mean 'bullet'?"),
    ],
)
def test_wrong_usage_exits_2(
    arguments: list[str], words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Refuse options that do not fit, and say what does."""
    assert cli.call(arguments) == 2
    assert words in capfd.readouterr().err


def test_figures_are_printed_and_written(
    quick: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit 0 when all pass, with JSON on standard output and tables with reasons in the file."""
    out = tmp_path / "new" / "table.md"
    assert cli.call([*PHYSICS, "--json", "--out", str(out)]) == 0
    printed = json.loads(capfd.readouterr().out)
    checks = printed["engines"]["mujoco"]["checks"]
    assert printed["ok"] and len(checks) == 4
    for check in checks:
        assert abs(check["figure"] - check["expected"]) <= check["bound"]
        assert check["name"] in out.read_text() and check["why"] in out.read_text()


def test_failed_check_exits_1(quick: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """Exit 1 when one check fails, mark it in the table, and give no figure as null in JSON."""
    quick.setattr(suite, "ALONE", (free.fall, diverged))
    assert cli.call(PHYSICS) == 1
    printed = capfd.readouterr().out
    assert "1 of 5 failed" in printed and "FAIL" in printed
    assert cli.call([*PHYSICS, "--json"]) == 1
    printed = json.loads(capfd.readouterr().out)
    assert not printed["ok"] and printed["engines"]["mujoco"]["checks"][-1]["figure"] is None


def test_unwritable_file_is_refused_before_the_checks(
    quick: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Name what cannot be written, without a traceback."""
    assert cli.call([*PHYSICS, "--out", str(tmp_path)]) == 1
    assert str(tmp_path) in capfd.readouterr().err
