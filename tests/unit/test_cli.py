"""What the command line takes, refuses and prints."""

import json
import subprocess
import sys
import time

import pytest

from benchmark import quantities
from benchmark.cli import app as cli
from benchmark.commands import typical_s
from benchmark.errors import UsageError

RUN = ["run", "--backend", "mujoco", "--task", "line"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "--backend", "bulet", "--task", "eight"], "Did you mean 'bullet'?"),
        (["run", "--backend", "mujoco", "--task", "cirle"], "Did you mean 'circle'?"),
        ([*RUN, "--algo", "sb3"], "known: hold-still, random, rsl-ppo, sb3-ppo"),
        ([*RUN, "--observation", "pos"], "Did you mean 'pose'?"),
        ([*RUN, "--stick", "wood"], "known: fabric, reference"),
        ([*RUN, "--effects", "backlsh=1deg"], "Did you mean 'backlash'?"),
        ([*RUN, "--effects", "backlash=1deg@J9"], "known: J0, J1, J3, J4, J6, J7"),
        ([*RUN, "--effects", "backlash=1deg@J2"], "no driven joint named 'J2'"),
        ([*RUN, "--effects", "backlash=1"], "has no unit; allowed: rad, mrad, deg"),
        ([*RUN, "--effects", "backlash=-1deg"], "out of range: 0 to 10 deg"),
        ([*RUN, "--effects", "backlash=1deg,backlash=2deg"], "given twice"),
        ([*RUN, "--radius", "-1cm"], "allowed: 0.1 to 5"),
        ([*RUN, "--radius", "nancm"], "allowed: 0.1 to 5"),
        ([*RUN, "--radius", "3"], "a number with its unit (m, cm, mm)"),
        ([*RUN, "--start-spread", "2"], "allowed: 0 to 1"),
        ([*RUN, "--spread", "contact-friction=-20%"], "is negative; allowed: from 0"),
        ([*RUN, "--speed", "nan"], "allowed: 0.05 to 5"),
        ([*RUN, "--speed", "-1"], "allowed: 0.05 to 5"),
        ([*RUN, "--steps", "-5"], "a whole number from 0"),
        ([*RUN, "--steps", "nan"], "a whole number from 0"),
        ([*RUN, "--steps", "0"], "--steps is 0"),
        ([*RUN, "--seed", "-1"], "--seed is -1"),
        (["run", "--task", "line"], "Missing option '--backend'"),
        ([*RUN, "--workers", "0"], "--workers"),
        (["eval", "absent"], "no run folder at absent"),
        (["jog"], "jog"),
    ],
)
def test_bad_input_gives_one_message_and_exit_code_2(arguments, words, capfd):
    """Refuse what cannot be, say what is allowed, print no traceback."""
    assert cli.call(arguments) == 2
    out, err = capfd.readouterr()
    assert words in err
    assert "Traceback" not in err
    assert out == ""


def test_json_mode_reports_errors_as_one_object(capfd):
    """Print one JSON object on standard output even when refusing."""
    assert cli.call([*RUN, "--steps", "nan", "--json"]) == 2
    assert json.loads(capfd.readouterr().out)["status"] == "error"


def test_nothing_to_rank_exits_1(tmp_path, capfd):
    """Fail with exit code 1 when there is no result to rank."""
    assert cli.call(["leaderboard", str(tmp_path), "--out", str(tmp_path / "board")]) == 1
    assert "nothing to rank" in capfd.readouterr().err


def test_unwritable_folder_gives_one_message(capfd):
    """Name the folder that cannot be written, without a traceback."""
    assert cli.call([*RUN, "--algo", "hold-still", "--out", "/proc/stickbench/run"]) == 1
    assert "/proc/stickbench" in capfd.readouterr().err


@pytest.mark.parametrize("arguments", [["--help"], ["list", "--json"]])
def test_help_and_list_load_no_engine_and_no_learner(arguments):
    """Answer from file names alone."""
    heavy = "mujoco,pybullet,sapien,torch,stable_baselines3,rsl_rl,pandas,numba"
    code = (
        "import sys; from benchmark.cli import app\n"
        "try: app.call(sys.argv[1:])\n"
        "except SystemExit: pass\n"
        f"sys.exit(' '.join(m for m in '{heavy}'.split(',') if m in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
    )
    assert done.stderr.strip() == ""


def test_missing_engine_names_the_install_command(tmp_path):
    """Say which package is missing and how to install it, and record the run as skipped."""
    code = (
        "import sys; sys.modules['pybullet'] = None\n"
        "from benchmark.cli import app; sys.exit(app.call(sys.argv[1:]))"
    )
    arguments = ["run", "--backend", "bullet", "--task", "line", "--algo", "hold-still"]
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments, "--out", str(tmp_path / "run")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "'pybullet', which is not installed" in done.stderr
    assert "pip install" in done.stderr
    assert json.loads((tmp_path / "run/run.json").read_text())["status"] == "skipped"


def test_an_estimate_leaves_out_compilation():
    """Take the usual time of a step, though one of them compiled for long."""
    waits = iter([0.0, 0.0, 0.3])
    assert typical_s(lambda: time.sleep(next(waits, 0.0))) < 0.1


def test_dry_run_writes_nothing(tmp_path, capfd):
    """Say what would be run and for how long, and leave the disk alone."""
    out = tmp_path / "run"
    assert cli.call([*RUN, "--dry-run", "--json", "--out", str(out), "--workers", "1"]) == 0
    plan = json.loads(capfd.readouterr().out)
    assert plan["would_run"]["task"] == "line"
    assert plan["simulation_minutes"] > 0
    assert not out.exists()


@pytest.mark.parametrize(
    ("text", "value"), [("3cm", 0.03), ("20 mm", 0.02), (".5e-1m", 0.05), ("1e1mm", 0.01)]
)
def test_lengths_are_read_with_their_unit(text, value):
    """Convert to metres."""
    assert quantities.quantity(text, "--radius", "cm") == pytest.approx(value)


def test_counts_are_whole_numbers():
    """Read 2e6 and refuse 1.5."""
    assert quantities.count("2e6", "--steps") == 2_000_000
    with pytest.raises(UsageError, match="whole number"):
        quantities.count("1.5", "--steps")


@pytest.mark.parametrize(("first", "code"), [(KeyboardInterrupt, 130), (ValueError, None)])
def test_an_interrupt_within_compiled_code_is_one(first, code, monkeypatch, capfd):
    """Say that a command was stopped where compiled code made other errors of that."""

    def command(*_, **__):
        try:
            try:
                raise first
            except first as error:
                raise SystemError("unpickle returned a result with an exception set") from error
        except SystemError as error:
            raise SystemError("dispatcher returned a result with an exception set") from error

    monkeypatch.setattr(cli, "app", command)
    if code is None:
        with pytest.raises(SystemError):
            cli.call(["list"])
    else:
        assert cli.call(["list"]) == code
        assert "interrupted; what was written is kept" in capfd.readouterr().err
