"""Sweeps: what a grid file may say, and that no cell takes another with it."""

import csv
import fcntl
import inspect
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmark.cli import app as cli
from benchmark.errors import UsageError
from benchmark.settings.run_spec import RunSpec
from benchmark.sweep import _cell
from benchmark.sweep._cell import Cell, finished, run_cell
from benchmark.sweep._estimate import START_S, Rates, makespan
from benchmark.sweep._grid import Settings, read_grid

BENCH = [sys.executable, "-c", "from benchmark.cli.app import main; main()"]
SHIPPED = sorted((Path(__file__).parents[2] / "sweeps").glob("*.yaml"))
STILL = "{task: line, algo: hold-still, smoke: true}"
ENDLESS = "{task: line, steps: 1e9}"


def write(folder: Path, text: str) -> Path:
    """A grid file with this text."""
    file = folder / "grid.yaml"
    file.write_text(text)
    return file


def cell(folder: Path, **changes: object) -> Cell:
    """A cell of a few seconds."""
    options = {"backend": "mujoco", "task": "line", "algo": "hold-still", "smoke": True, **changes}
    fixed = {} if options["algo"] != "hold-still" else {"steps": 0, "randomize": False}
    worlds = {"worlds": 8} if options["smoke"] else {}
    return Cell(options=options, spec=RunSpec(**{**options, **fixed, **worlds}), out=folder)


def children(pid: int) -> list[int]:
    """Processes that a process has started and that have not ended."""
    lists = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for file in lists for child in file.read_text().split()]


def start(*arguments: str) -> subprocess.Popen:
    """The command in a process of its own."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    # A suite that runs in the background is told to ignore Ctrl-C, and its children with it.
    hears = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    return subprocess.Popen([*BENCH, *arguments], **pipes, **hears)


def wait_for(condition, timeout_s: float = 3600) -> None:
    """Wait until a condition holds; fail where it never does."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def result(process: subprocess.Popen, code: int) -> dict:
    """What a sweep printed, once it has ended with the exit code."""
    out, err = process.communicate()
    assert process.returncode == code, err
    assert "Traceback" not in err
    return json.loads(out)


def sweep(file: Path, out: Path, *arguments: str, code: int = 0) -> dict:
    """Run a sweep to its end."""
    return result(start("sweep", str(file), "--out", str(out), "--json", *arguments), code)


def states(found: dict) -> dict[str, str]:
    """State by algorithm."""
    return {row["algo"]: row["state"] for row in found["rows"]}


def test_cells_take_the_options_of_bench_run():
    """Offer every option of `bench run` that decides its result, and no other."""
    elsewhere = {"out", "resume", "force", "dry_run", "workers", "config", "start", "logger"}
    shared = {"json", "verbose", "quiet"}
    options = inspect.signature(cli.run).parameters.keys() - elsewhere - shared
    assert Settings.model_fields.keys() == options - {"overrides"} | {"set"}


def test_a_grid_is_the_product_of_its_lists(tmp_path):
    """Multiply the lists, add the cells, fill in the defaults, and keep no cell twice."""
    text = "defaults: {backend: mujoco, task: line, steps: 2e6, radius: 3cm}\n"
    text += "grid: {algo: [sb3-ppo, hold-still], seed: [0, 1]}\n"
    text += "cells: [{task: eight, steps: 5}, {seed: 1}]\n"
    specs = [choice.spec for choice in read_grid(write(tmp_path, text)).choices]
    found = [(spec.task, spec.algo, spec.seed, spec.steps) for spec in specs]
    assert found == [
        *(("line", "sb3-ppo", seed, 2_000_000) for seed in (0, 1)),
        *(("line", "hold-still", seed, 0) for seed in (0, 1)),
        ("eight", "sb3-ppo", 0, 5),
    ]
    assert {spec.radius_m for spec in specs} == {0.03}


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_shipped_grids_are_valid(file):
    """Read every grid that the repository ships."""
    assert read_grid(file).choices


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no cell; give 'grid', 'cells' or both"),
        ("[1]", "the file is [1]; allowed: "),
        ("grid: {seed: [0}", "cannot be read as YAML: line 1"),
        ("gird: {seed: [0]}", "gird is not a setting; allowed: cells, defaults, grid"),
        ("gird: {seed: [0]}", "Did you mean 'grid'?"),
        ("grid: {sed: [0]}", "Did you mean 'seed'?"),
        ("grid: {seed: []}", "grid.seed is []; allowed: "),
        ("grid: {seed: [0, x]}", "grid.seed.1: --seed is 'x'; allowed: a whole"),
        ("cells: [{backend: mujoco, task: line, calibration: absent.yaml}]", "absent.yaml"),
        ("grid: {calibration: [3]}", "grid.calibration.0 is 3; allowed: "),
        ("grid: {smoke: [yes, 2]}", "grid.smoke.1: --smoke is 2; allowed: true or false"),
        (
            "defaults: {pace: .nan}\ncells: [{}]",
            "defaults.pace: --pace is nan; allowed: 0.05 to 5",
        ),
        ("cells: [{backend: mujoco}]", "task is missing (required)"),
        ("cells: [{backend: bulet, task: line}]", "Did you mean 'bullet'?"),
        ("cells: [{backend: mujoco, task: line, steps: x}]", "--steps is 'x'; allowed: a whole"),
        (
            "cells: [{backend: mujoco, task: line, radius: 9cm}]",
            "--radius is 9 cm; allowed: 0.1 to 5",
        ),
        ("cells: [{backend: mujoco, task: line}]\ntime_limit: 3", "time_limit is 3; allowed: "),
        ("cells: [{backend: mujoco, task: line}]\ntime_limit: 0s", "allowed: a time above 0"),
        ("cells: [{backend: mujoco, task: line}]\nslurm: {cpus: 0}", "slurm.cpus is 0; allowed: "),
        ("cells: [{backend: mujoco, task: line}]\nslurm: {mem: 4}", "slurm.mem is not a setting"),
    ],
)
def test_bad_grids_are_refused(tmp_path, text, words, capfd):
    """Name field, value and what is allowed, with exit code 2, and run nothing."""
    out = tmp_path / "out"
    assert cli.call(["sweep", str(write(tmp_path, text)), "--out", str(out)]) == 2
    err = capfd.readouterr().err
    assert words in err
    assert "Traceback" not in err
    assert not out.exists()


def test_absent_grid_and_stray_partition_are_refused(tmp_path, capfd):
    """Refuse a file that is not there, and a partition without a cluster."""
    assert cli.call(["sweep", str(tmp_path / "absent.yaml")]) == 2
    assert "no sweep file at" in capfd.readouterr().err
    file = write(tmp_path, "cells: [{backend: mujoco, task: line}]")
    assert cli.call(["sweep", str(file), "--partition", "main"]) == 2
    assert "without --slurm" in capfd.readouterr().err


@pytest.mark.parametrize(("text", "value"), [("2h", 7200), ("1.5min", 90), ("3 S", 3)])
def test_times_are_read_with_their_unit(tmp_path, text, value):
    """Convert to seconds, and refuse what is no time above 0."""
    cells = "cells: [{backend: mujoco, task: line}]\ntime_limit: "
    assert read_grid(write(tmp_path, cells + text)).time_limit_s == value
    for bad in (text + "x", "-" + text, "0s", "nans", "infh"):
        with pytest.raises(UsageError, match="time_limit is"):
            read_grid(write(tmp_path, cells + bad))


def test_a_cell_takes_hyperparameters(tmp_path):
    """Give a cell's settings of the learner to its run, one word each."""
    text = "cells: [{backend: mujoco, task: line, start_spread: 0.5, set: {lr: 0.001, gamma: 0.9}}]"
    (choice,) = read_grid(write(tmp_path, text)).choices
    assert choice.spec.overrides == {"lr": 0.001, "gamma": 0.9}
    words = _cell.Cell(options=choice.options, spec=choice.spec, out=tmp_path).command(1)
    assert words[words.index("--start-spread") + 1] == "0.5"
    assert [w for w in words if w.startswith(("lr=", "gamma="))] == ["lr=0.001", "gamma=0.9"]


@pytest.fixture(scope="module")
def crashed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """A sweep's folder and result; one of its cells was shot while it trained."""
    folder = tmp_path_factory.mktemp("sweep")
    file = write(folder, f"defaults: {{backend: mujoco}}\ncells: [{ENDLESS}, {STILL}]")
    process = start("sweep", str(file), "--out", str(folder / "runs"), "--json", "-j", "1")
    wait_for(lambda: list((folder / "runs").glob("*sb3-ppo*/run.json")))
    (child,) = children(process.pid)
    os.kill(child, signal.SIGSEGV)
    return folder, result(process, 1)


@pytest.mark.parametrize(
    ("jobs", "cells", "stop"),
    [("1", [ENDLESS, STILL], signal.SIGTERM), ("2", [ENDLESS], signal.SIGINT)],
)
def test_a_sweep_stops_when_asked(jobs, cells, stop, tmp_path):
    """End with 130 on a signal, leave no cell running, and say how to go on with each."""
    file = write(tmp_path, f"defaults: {{backend: mujoco}}\ncells: [{', '.join(cells)}]")
    process = start("sweep", str(file), "--out", str(tmp_path / "runs"), "--json", "-j", jobs)
    wait_for(lambda: list((tmp_path / "runs").glob("*/run.json")))
    running = children(process.pid)
    process.send_signal(stop)
    found = result(process, 130)
    assert found["status"] == "interrupted"
    assert "the same command goes on" in found["error"]
    assert running and not [pid for pid in running if Path(f"/proc/{pid}").exists()]
    with (tmp_path / "runs/sweep.csv").open(newline="") as table:
        listed = [(row["state"], row["reason"]) for row in csv.DictReader(table)]
    assert listed == [("interrupted", _cell.STOPPED), ("waiting", "")][: len(cells)]


def test_a_crash_leaves_the_other_cells_alone(crashed):
    """Run the next cell after one has crashed; say what killed it, there and in its run.json."""
    folder, found = crashed
    assert states(found) == {"sb3-ppo": "crashed", "hold-still": "done"}
    assert found["status"] == "failed" and found["done"] == 1
    (name,) = found["failed"]
    (row,) = [row for row in found["rows"] if row["name"] == name]
    assert "SIGSEGV" in row["reason"] and row["log"] in row["reason"]
    run = json.loads((folder / "runs" / name / "run.json").read_text())
    assert run["status"] == "interrupted" and "SIGSEGV" in run["reason"]


def test_a_cell_is_the_run_that_was_asked_for(crashed):
    """Write the run folder that `bench run` with the same options would write."""
    folder, found = crashed
    (row,) = [row for row in found["rows"] if row["state"] == "done"]
    run = json.loads((Path(row["dir"]) / "run.json").read_text())
    assert run["digest"] == cell(folder).spec.digest
    assert run["scores"]["tracked"] == row["tracked"]
    assert run["provenance"]["command"].startswith("bench run --backend mujoco --task line")


def test_the_table_has_every_cell(crashed):
    """Keep state, settings and scores of every cell in sweep.csv."""
    folder, found = crashed
    with (folder / "runs/sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["state"] for row in rows] == [row["state"] for row in found["rows"]]
    assert float(rows[1]["tracked"]) == found["rows"][1]["tracked"] and rows[0]["tracked"] == ""


def test_finished_cells_are_skipped(crashed):
    """Start no process for a cell whose run is done, and end well when all are."""
    folder, _ = crashed
    file = write(folder, f"defaults: {{backend: mujoco}}\ncells: [{STILL}]")
    (log,) = (folder / "runs/logs").glob("*hold-still*.log")
    before = log.stat().st_mtime_ns
    found = sweep(file, folder / "runs")
    assert (found["status"], found["was_done"], found["done"]) == ("done", 1, 0)
    assert log.stat().st_mtime_ns == before


def test_a_damaged_run_is_no_finished_cell(crashed, tmp_path):
    """Run a cell again, and report why it fails, when its run.json has been changed."""
    shutil.copytree(crashed[0] / "runs", tmp_path / "runs")
    (run,) = (tmp_path / "runs").glob("*hold-still*/run.json")
    run.write_text(run.read_text().replace('"seed": 0', '"seed": 1'))
    assert finished(cell(tmp_path / "runs")) is None
    outcome = run_cell(cell(tmp_path / "runs"), limit_s=100)
    assert outcome.state == "failed" and "digest does not fit" in outcome.reason


@pytest.mark.slow
def test_a_hanging_cell_is_killed(tmp_path, monkeypatch):
    """Kill a cell that stands still and hears no signal, and write down why it ended."""
    monkeypatch.setattr(_cell, "GRACE_S", 0.5)
    endless = cell(tmp_path, algo="sb3-ppo", smoke=False)
    others, stopped = children(os.getpid()), []

    def freeze(cell: Cell) -> bool:
        if not stopped and (cell.path / "run.json").exists():
            stopped.extend(pid for pid in children(os.getpid()) if pid not in others)
            os.kill(stopped[0], signal.SIGSTOP)
        return False

    limit_s = 20.0
    outcome = run_cell(endless, limit_s, beat=freeze)
    assert len(stopped) == 1 and not Path(f"/proc/{stopped[0]}").exists()
    assert outcome.state == "timed out" and outcome.wall_s >= limit_s
    run = json.loads((endless.path / "run.json").read_text())
    assert run["status"] == "interrupted" and "time limit" in run["reason"]


def test_a_cell_is_run_once_at_a_time(tmp_path, monkeypatch):
    """Leave a cell alone that another process is running."""
    monkeypatch.setattr(_cell, "GRACE_S", 0.0)
    mine = cell(tmp_path)
    mine.log.parent.mkdir(parents=True)
    with mine.log.open("ab") as log:
        fcntl.flock(log, fcntl.LOCK_EX)
        outcome = run_cell(mine, limit_s=100)
    assert outcome.state == "busy" and not mine.path.exists()


def test_a_cell_waits_for_one_that_is_ending(tmp_path):
    """Run a cell whose sweep was killed as soon as that sweep's own cell has ended."""
    mine, beats = cell(tmp_path), []
    mine.log.parent.mkdir(parents=True)
    with mine.log.open("ab") as log:
        fcntl.flock(log, fcntl.LOCK_EX)

        def beat(_):
            beats.append(None)
            if len(beats) == 3:
                fcntl.flock(log, fcntl.LOCK_UN)
            return len(beats) > 4

        assert run_cell(mine, limit_s=100, beat=beat).state == "interrupted"


def test_an_unwritable_folder_fails_the_cell_alone():
    """Turn a folder that cannot be written into that cell's outcome."""
    outcome = run_cell(cell(Path("/proc/stickbench")), limit_s=100)
    assert outcome.state == "failed" and "/proc/stickbench" in outcome.reason


@pytest.mark.slow
def test_an_interrupted_sweep_goes_on_where_it_stopped(tmp_path):
    """Stop every cell at Ctrl-C with exit code 130, and finish them when called again."""
    text = "cells: [{backend: mujoco, task: line, smoke: true}]"
    file, out = write(tmp_path, text), tmp_path / "runs"
    process = start("sweep", str(file), "--out", str(out), "--json", "-j", "2")
    wait_for(lambda: list(out.glob("*/run.json")))
    running = children(process.pid)
    process.send_signal(signal.SIGINT)
    assert result(process, 130)["status"] == "interrupted"
    assert running and not any(Path(f"/proc/{pid}").exists() for pid in running)
    with (out / "sweep.csv").open(newline="") as table:
        assert [row["state"] for row in csv.DictReader(table)] == ["interrupted"]
    assert sweep(file, out, "-j", "1")["done"] == 1


def test_cells_end_with_a_sweep_that_is_killed(tmp_path):
    """Leave no cell running when the sweep itself is killed."""
    file = write(tmp_path, f"defaults: {{backend: mujoco}}\ncells: [{ENDLESS}]")
    process = start("sweep", str(file), "--out", str(tmp_path / "runs"))
    wait_for(lambda: list((tmp_path / "runs").glob("*/run.json")))
    (child,) = children(process.pid)
    process.kill()
    process.communicate()
    wait_for(lambda: not Path(f"/proc/{child}").exists())


def test_dry_run_names_cells_and_their_time(tmp_path, capfd):
    """Measure and estimate, and leave the disk alone."""
    text = "defaults: {backend: mujoco, task: line}\ngrid: {steps: [1e6, 2e6]}"
    arguments = ["--out", str(tmp_path / "runs"), "--dry-run", "--json", "-j", "2"]
    assert cli.call(["sweep", str(write(tmp_path, text)), *arguments]) == 0
    plan = json.loads(capfd.readouterr().out)
    first, second = (row["minutes"] for row in plan["cells"])
    assert 0 < first < second == plan["minutes"]
    assert plan["core_minutes"] == pytest.approx(first + second)
    assert not (tmp_path / "runs").exists()


def test_time_is_the_sum_of_its_parts(tmp_path):
    """Add simulation, learning, evaluation and start of a cell."""
    one = cell(tmp_path, algo="sb3-ppo", smoke=False)
    learning = {("sb3-ppo", "contact-centers"): 1e-4}
    rates = Rates(steps_per_s={"mujoco": 1000.0}, learning_s=learning, problems={})
    assert rates.seconds(one) == pytest.approx(START_S + 1000 + 100 + 100 * 300 / 1000)
    assert rates.seconds(cell(tmp_path, backend="bullet")) is None


def test_cells_wait_for_a_free_place():
    """Start each cell, in order, as soon as a place is free."""
    assert makespan([3, 1, 1, 1], jobs=2) == 3
    assert makespan([1, 1, 1, 3], jobs=2) == 4
    assert makespan([], jobs=2) == 0


def test_slurm_is_refused_where_there_is_none(tmp_path, capfd, monkeypatch):
    """Say what is missing on a machine without Slurm."""
    monkeypatch.setenv("PATH", "")
    file = write(tmp_path, "cells: [{backend: mujoco, task: line}]")
    assert cli.call(["sweep", str(file), "--slurm", "--out", str(tmp_path / "runs")]) == 1
    assert "sbatch, which is not on this machine" in capfd.readouterr().err


def _no_slurm() -> str:
    if shutil.which("sbatch") is None:
        return "sbatch is not installed"
    done = subprocess.run(["sinfo"], capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else f"Slurm does not answer: {done.stderr.strip()}"


@pytest.fixture
def slurm() -> None:
    """Skip where no Slurm runs."""
    if reason := _no_slurm():
        pytest.skip(reason)


@pytest.mark.slow
def test_slurm_runs_the_cells(slurm, tmp_path):
    """Run cells as jobs of a real Slurm, with a time limit each, and skip them when done."""
    text = f"defaults: {{backend: mujoco}}\ncells: [{STILL}, {ENDLESS}]\ntime_limit: 30s\n"
    file = write(tmp_path, text + "slurm: {memory_gb: 1, setup: ['export STICK=1']}\n")
    found = sweep(file, tmp_path / "runs", "--slurm", code=1)
    assert states(found) == {"hold-still": "done", "sb3-ppo": "timed out"}
    file = write(tmp_path, f"defaults: {{backend: mujoco}}\ncells: [{STILL}]")
    assert sweep(file, tmp_path / "runs", "--slurm")["was_done"] == 1


@pytest.mark.slow
def test_slurm_jobs_survive_the_sweep_and_may_be_lost(slurm, tmp_path):
    """Wait for jobs of an earlier call instead of submitting twice; report a cancelled one."""
    text = f"defaults: {{backend: mujoco}}\ncells: [{ENDLESS}, {STILL}]\ntime_limit: 90s\n"
    file, out = write(tmp_path, text + "slurm: {memory_gb: 1}\n"), tmp_path / "runs"
    arguments = ("sweep", str(file), "--out", str(out), "--json", "--slurm", "-j", "1")
    process = start(*arguments)
    wait_for(lambda: len(list((out / "logs/slurm").glob("*.job"))) == 2)
    process.send_signal(signal.SIGINT)
    assert result(process, 130)["status"] == "interrupted"
    again = start(*arguments)
    assert any("waiting for 2 jobs" in line for line in again.stderr)
    (waiting,) = (out / "logs/slurm").glob("*hold-still*.job")
    subprocess.run(["scancel", waiting.read_text().strip()], check=True)
    found = result(again, 1)
    assert states(found) == {"sb3-ppo": "timed out", "hold-still": "crashed"}
    assert len(list((out / "logs/slurm").glob("*_submission.sh"))) == 1
    assert "left the queue without a result" in found["rows"][1]["reason"]


@pytest.mark.slow
def test_slurm_refusals_are_passed_on(slurm, tmp_path, capfd):
    """Print what sbatch says of a partition that does not exist."""
    file = write(tmp_path, f"defaults: {{backend: mujoco}}\ncells: [{STILL}]")
    arguments = ["--out", str(tmp_path / "runs"), "--slurm", "--partition", "nowhere"]
    assert cli.call(["sweep", str(file), *arguments]) == 1
    assert "invalid partition" in capfd.readouterr().err
