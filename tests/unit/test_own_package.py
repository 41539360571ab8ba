"""A package of one's own: written by `bench new`, installed, and used by name everywhere."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.cli import app as cli
from benchmark.parts.registry import ROOT

PARTS = {"task": "clover", "effect": "magnet-askew", "observation": "touch-area", "algo": "my-a2c"}
CHOOSY, BARE, SILENT = "choosy", "bare", "silent"
DECLARED = '    no_contacts = "not written yet"\n'
ENGINE = '''"""choosy: the reference's worlds, but no path of commands is built."""

from backends import mujoco


class Backend(mujoco.Backend):
    """What it refuses, and no more."""

    support = mujoco.Backend.support | {
        name: "refused: not built" for name in mujoco.Backend.support if name.startswith("command.")
    }
'''

Folders = tuple[Path, ...]
"""In which packages are found."""


def called(words: str, here: Path, places: Folders) -> subprocess.CompletedProcess[str]:
    """What a command says, in a folder outside of the checkout."""
    done = subprocess.run(
        [sys.executable, "-m", *words.split()],
        cwd=here,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, places)), "COLUMNS": "200"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{words}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done


def bench(words: str, here: Path, places: Folders) -> dict:
    """The same of `bench`, as JSON."""
    found: dict = json.loads(called(f"benchmark {words} --json", here, places).stdout)
    return found


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a part of every kind."""
    folder = tmp_path_factory.mktemp("mine")
    with contextlib.chdir(folder):
        for kind, name in (*PARTS.items(), *(("backend", name) for name in (CHOOSY, BARE, SILENT))):
            assert cli.call(["new", kind, name, "--package", "mine"]) == 0
    (folder / "mine/choosy.py").write_text(ENGINE)
    silent = folder / "mine/silent.py"
    silent.write_text(silent.read_text().replace(DECLARED, ""))
    return folder


@pytest.fixture(scope="module")
def places(project: Path, unpacked: Path, tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """Where it is installed, beside the wheel: no checkout."""
    site = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(site), str(project)], check=True)
    return unpacked, site


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("task clover --package mine", "exists; choose another name"),
        ("task circle", "there is a task named 'circle'"),
        ("tsak clover", "Did you mean 'task'?"),
        ("task Clover", "allowed: small letters"),
        ("task rose --package tasks", "none of Stickbench's"),
    ],
)
def test_what_is_in_the_way_is_refused(
    project: Path, words: str, says: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Write over nothing, and take no name twice."""
    with contextlib.chdir(project):
        assert cli.call(["new", *words.split()]) == 2
    assert says in " ".join(capfd.readouterr().err.split())


@pytest.mark.slow
def test_every_command_takes_its_parts(places: Folders, tmp_path: Path) -> None:
    """Name all four in lists and helps, run with them, and use the run and its world everywhere."""
    listed = bench("list", tmp_path, places)
    assert all(name in listed[kind] for kind, name in PARTS.items())
    assert bench("list effect", tmp_path, places)["effect"]["magnet-askew"]["unit"] == "deg"
    for command in ("run", "record"):
        said = called(f"benchmark {command} -h", tmp_path, places).stdout
        names = PARTS.values() if command == "run" else ()
        assert all(name in said for name in names if name != PARTS["effect"])
    world = "--effects magnet-askew=0.5deg@J3"
    of = f"--task clover --observation touch-area --algo my-a2c {world}"
    assert bench(f"run --backend mujoco {of} --dry-run", tmp_path, places)["would_run"]
    row = bench(f"run --backend mujoco {of} --smoke --out run", tmp_path, places)
    assert (row["task"], row["algo"], row["status"]) == ("clover", "my-a2c", "done")
    again = bench("eval run --effects magnet-askew=2deg@J3 --episodes 2", tmp_path, places)
    assert (again["task"], again["effects"]) == ("clover", "magnet-askew=2deg@J3")
    moved = "--backend mujoco --effects magnet-askew=2deg@J3 --setting task=clover --episodes 2"
    found = bench(f"transfer run --include-smoke {moved}", tmp_path, places)
    assert found["status"] == "done" and not found["problems"]
    bench("view run --out paths.png", tmp_path, places)
    assert bench("verify run", tmp_path, places)["verified"] == 1
    board = bench("leaderboard run --include-smoke --out board", tmp_path, places)
    text = (tmp_path / "board/leaderboard.md").read_text()
    assert "clover" in text and "my-a2c" in text and not board["problems"]


@pytest.mark.slow
def test_its_engine_is_one_of_the_engines(places: Folders, tmp_path: Path) -> None:
    """Sweep on an engine of the package, time it and examine it; say what it refuses."""
    cell = {"backend": CHOOSY, "task": "clover", "algo": "my-a2c", "observation": "touch-area"}
    grid = {"cells": [cell | {"effects": "magnet-askew=0.5deg@J3", "smoke": True}]}
    (tmp_path / "grid.yaml").write_text(json.dumps(grid))
    (swept,) = bench("sweep grid.yaml --out runs -j 1", tmp_path, places)["rows"]
    assert (swept["state"], swept["backend"], swept["algo"]) == ("done", CHOOSY, "my-a2c")
    of = f"speed --backend {CHOOSY} --worlds 4 --workers 1 --duration 100ms"
    assert [row["backend"] for row in bench(of, tmp_path, places)["rows"]] == [CHOOSY]
    examined = {one["name"]: one for one in bench("doctor", tmp_path, places)["parts"]}
    for name in (CHOOSY, PARTS["algo"]):
        assert examined[name]["state"] == "works"
    with pytest.raises(AssertionError, match="command-delay is refused: not built"):
        bench(f"run --backend {CHOOSY} --task clover --effects command-delay=9ms", tmp_path, places)


@pytest.mark.slow
def test_the_docs_have_a_page_with_each(places: Folders, tmp_path: Path) -> None:
    """Make pages of commands and effects that name the parts, from the program as installed."""
    (tmp_path / "pages.py").write_text(
        "from _pages import commands, effects, parts\n"
        "made = commands.pages() | effects.pages() | parts.pages()\n"
        "print(made['reference/parts.md'], made['reference/effects/index.md'])\n"
        "print(made['reference/commands/run.md'])\n"
    )
    shown = called("pages", tmp_path, (*places, tmp_path, ROOT / "docs")).stdout
    assert all(name in shown for name in (*PARTS.values(), CHOOSY))


@pytest.mark.slow
def test_its_parts_are_made_from_python(places: Folders, tmp_path: Path) -> None:
    """Make the task with the observation and the effect as an environment of Gymnasium."""
    (tmp_path / "use.py").write_text(
        "import stickbench as sb\n"
        "from pathlib import Path\n"
        "made = {'observation': 'touch-area', 'effects': 'magnet-askew=1deg@J3'}\n"
        "env = sb.make('Clover', **made)\n"
        "seen, _ = env.reset(seed=0)\n"
        "print(len(seen), 'my-a2c' in sb.names('algo'), sb.__file__)\n"
    )
    width, known, file = called("use", tmp_path, (*places, tmp_path)).stdout.split()
    assert int(width) > 0 and known == "True"
    assert Path(file).parents[1] == places[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PARTS.values(), CHOOSY, BARE])
def test_its_parts_pass_their_checks(name: str, places: Folders, tmp_path: Path) -> None:
    """Pass `bench test`, with nothing of Stickbench edited; say what an engine has not yet."""
    done = called(f"benchmark test {name} --json", tmp_path, places)
    assert json.loads(done.stdout)["ok"]
    assert ("no contacts: not written yet" in done.stderr) == (name == BARE)


@pytest.mark.slow
def test_what_is_declared_is_checked(places: Folders, tmp_path: Path) -> None:
    """Fail an engine that neither reports contacts nor says so, and name what is to be written."""
    with pytest.raises(AssertionError, match="where fingers press; write them in `_observe`"):
        called(f"benchmark test {SILENT}", tmp_path, places)


@pytest.mark.slow
def test_its_effect_is_found_in_a_log(places: Folders, tmp_path: Path) -> None:
    """Name the effect, or say that it and the one of the same law cannot be told apart."""
    effect = "--effects magnet-askew=1.5deg@J3"
    of = "--protocol steps,triangle,multisine --channels command,position"
    bench(f"record --backend mujoco {effect} {of} --out log", tmp_path, places)
    found = bench("diagnose log --nominal mujoco --out answer", tmp_path, places)
    ties = (one for tie in found["indistinguishable"] for one in (*tie["effects"], *tie["or"]))
    tied = {one.partition("@")[0] for one in ties}
    assert "magnet-askew" in {*found["verdict"], *tied}
    assert found["joints"] == ["J3"]
