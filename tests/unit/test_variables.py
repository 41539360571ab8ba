"""Options from environment variables, and the log file."""

import json
import re

import pytest
from typer.main import get_command

from benchmark import console
from benchmark.cli import app as cli
from benchmark.settings.variables import name_variables, without_variables

HOLDING = {"BACKEND": "mujoco", "TASK": "line", "ALGO": "hold-still", "SMOKE": "1", "JSON": "1"}


@pytest.fixture
def holding(monkeypatch, tmp_path):
    """A run that is described by variables alone; its folder."""
    out = tmp_path / "run"
    for name, value in {**HOLDING, "OUT": str(out), "WORKERS": "1"}.items():
        monkeypatch.setenv(f"BENCH_RUN_{name}", value)
    return out


def test_a_run_is_described_by_variables_alone(holding, capfd):
    """Take options, switches and --json from the environment."""
    assert cli.call(["run"]) == 0
    row = json.loads(capfd.readouterr().out)
    assert row["status"] == "done" and row["dir"] == str(holding)


def test_the_command_line_comes_first(holding, capfd):
    """Take an option over its variable, and no longer name the variable."""
    assert cli.call(["run", "--backend", "bulet"]) == 2
    said = capfd.readouterr()
    assert "Did you mean 'bullet'?" in said.err and "BENCH_RUN_BACKEND" not in said.err
    assert "BENCH_RUN_TASK" in said.err
    assert json.loads(said.out)["status"] == "error"


@pytest.mark.parametrize(
    ("variable", "value", "words"),
    [
        ("BENCH_RUN_PACE", "99", "--pace is 99; allowed: 0.05 to 5"),
        ("BENCH_RUN_WORKERS", "many", "--workers is 'many'; allowed: a whole number"),
        ("BENCH_RUN_SET", "lr=fast", "--set lr is 'fast'"),
    ],
)
def test_a_wrong_value_names_its_variable(variable, value, words, monkeypatch, capfd):
    """Say what is allowed and where the value came from."""
    monkeypatch.setenv(variable, value)
    assert cli.call(["run", "--backend", "mujoco", "--task", "line", "--steps", "9"]) == 2
    said = capfd.readouterr().err
    assert words in said and f"(from the environment: {variable})" in said


def test_options_of_every_depth_have_a_variable():
    """Name variables by the words of the command and the option as typed."""
    commands = name_variables(get_command(cli.app))
    found = {p.envvar for p in commands.params}
    found |= {p.envvar for p in commands.commands["run"].params}
    found |= {p.envvar for p in commands.commands["doctor"].commands["physics"].params}
    assert {"BENCH_LOG_FILE", "BENCH_RUN_FROM", "BENCH_RUN_START_SPREAD"} <= found
    assert {"BENCH_RUN_SET", "BENCH_RUN_JSON", "BENCH_DOCTOR_PHYSICS_OUT"} <= found
    assert "BENCH_VERSION" not in found


def test_help_does_not_list_variables(capfd):
    """Keep the help short: the name follows from the option's."""
    assert cli.call(["run", "-h"]) == 0
    assert "BENCH_" not in capfd.readouterr().out


def test_a_command_of_ours_does_not_hear_them(monkeypatch):
    """Start cells of a sweep with their own options alone."""
    monkeypatch.setenv("BENCH_RUN_SEED", "7")
    monkeypatch.setenv("OTHER", "1")
    assert "BENCH_RUN_SEED" not in without_variables() and "OTHER" in without_variables()


def test_the_log_file_has_what_was_said(holding, tmp_path, capfd):
    """Append lines with their time, of progress and of errors, without control codes."""
    log = tmp_path / "bench.log"
    assert cli.call(["--log-file", str(log), "run"]) == 0
    assert cli.call(["--log-file", str(log), "run", "--radius", "9cm"]) == 2
    console.log_to(None)
    lines = log.read_text().splitlines()
    assert all(re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} bench: ", line) for line in lines)
    assert "evaluate mujoco line" in lines[0] and "--radius is 9 cm" in lines[-1]
    assert "\x1b" not in log.read_text()


def test_a_log_file_that_cannot_be_written_is_named(capfd):
    """Refuse before the command begins."""
    assert cli.call(["--log-file", "/proc/stickbench/log", "list"]) == 1
    assert "/proc/stickbench/log" in capfd.readouterr().err
