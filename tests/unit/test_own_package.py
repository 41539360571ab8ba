"""A package of one's own: written by `bench new`, installed, and used by name everywhere."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.parts.registry import ROOT

PARTS = {"task": "clover", "effect": "magnet-askew", "observation": "touch-area", "algo": "my-a2c"}


def bench(words: str, here: Path, site: Path | None = None) -> dict:
    """What a command says as JSON, in a folder outside of the checkout."""
    paths = [str(ROOT), *([str(site)] if site else [])]
    done = subprocess.run(
        [sys.executable, "-m", "benchmark", *words.split(), "--json"],
        cwd=here,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"bench {words}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    found: dict = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a part of every kind."""
    folder = tmp_path_factory.mktemp("mine")
    for kind, name in PARTS.items():
        bench(f"new {kind} {name} --package mine", folder)
    return folder


@pytest.fixture(scope="module")
def site(project: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where it is installed."""
    target = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(target), str(project)], check=True)
    return target


def test_what_is_in_the_way_is_refused(project: Path) -> None:
    """Write over nothing, and take no name twice."""
    command = [sys.executable, "-m", "benchmark", "new"]
    for words, says in (
        ("task clover --package mine", "exists; choose another name"),
        ("task circle", "there is a task named 'circle'"),
        ("tsak clover", "Did you mean 'task'?"),
        ("task Clover", "allowed: small letters"),
        ("task rose --package tasks", "none of Stickbench's"),
    ):
        done = subprocess.run(
            [*command, *words.split()],
            cwd=project,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 2 and says in " ".join(done.stderr.split())


@pytest.mark.slow
def test_every_command_takes_its_parts(site: Path, tmp_path: Path) -> None:
    """List all four, train with them, view the run, and record a log that has the effect."""
    listed = bench("list", tmp_path, site)
    assert all(name in listed[kind] for kind, name in PARTS.items())
    of = "--task clover --observation touch-area --algo my-a2c --effects magnet-askew=0.5deg@J3"
    row = bench(f"run --backend mujoco {of} --smoke --out run", tmp_path, site)
    assert (row["task"], row["algo"], row["status"]) == ("clover", "my-a2c", "done")
    bench("view run --out paths.png", tmp_path, site)
    board = bench("leaderboard run --include-smoke --out board", tmp_path, site)
    assert "clover" in (tmp_path / "board/leaderboard.md").read_text() and not board["problems"]


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTS.values())
def test_its_parts_pass_their_checks(name: str, site: Path, tmp_path: Path) -> None:
    """Pass `bench test`, with nothing of Stickbench edited."""
    assert bench(f"test {name}", tmp_path, site)["ok"]


@pytest.mark.slow
def test_its_effect_is_found_in_a_log(site: Path, tmp_path: Path) -> None:
    """Name the effect, or say that it and the one of the same law cannot be told apart."""
    effect = "--effects magnet-askew=1.5deg@J3"
    of = "--protocol steps,triangle,multisine --channels command,position"
    bench(f"record --backend mujoco {effect} {of} --out log", tmp_path, site)
    found = bench("diagnose log --nominal mujoco --out answer", tmp_path, site)
    ties = (one for tie in found["indistinguishable"] for one in (*tie["effects"], *tie["or"]))
    tied = {one.partition("@")[0] for one in ties}
    assert "magnet-askew" in {*found["verdict"], *tied}
    assert found["joints"] == ["J3"]
