"""What the command line takes, refuses and prints."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer

from backends.sticks import STICKS
from benchmark import console
from benchmark.cli import app as cli
from benchmark.cli.command import command
from benchmark.errors import Interrupted, UsageError
from benchmark.parts import registry
from benchmark.runs.plan import typical_s
from benchmark.settings import quantities
from benchmark.settings.kinds import File, Number, Setting, setting

RUN = ["run", "--backend", "mujoco", "--task", "line"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "--backend", "bulet", "--task", "eight"], "Did you mean 'bullet'?"),
        (["run", "--backend", "mujoco", "--task", "cirle"], "Did you mean 'circle'?"),
        ([*RUN, "--algo", "sb3"], f"known: {', '.join(registry.names('algo'))}"),
        ([*RUN, "--observation", "pos"], "Did you mean 'pose'?"),
        ([*RUN, "--stick", "wood"], f"known: {', '.join(sorted(STICKS))}"),
        ([*RUN, "--effects", "backlsh=1deg"], "Did you mean 'backlash'?"),
        ([*RUN, "--effects", "backlash=1deg@J9"], "known: J0, J1, J3, J4, J6, J7"),
        ([*RUN, "--effects", "backlash=1deg@J2"], "no driven joint named 'J2'"),
        ([*RUN, "--effects", "backlash=1"], "has no unit; allowed: mrad, deg, rad"),
        ([*RUN, "--effects", "backlash=-1deg"], "out of range; allowed: 0 to 10 deg"),
        ([*RUN, "--effects", "backlash=1deg,backlash=2deg"], "an effect twice"),
        ([*RUN, "--radius", "-1cm"], "allowed: 0.1 to 5"),
        ([*RUN, "--radius", "nancm"], "allowed: 0.1 to 5"),
        ([*RUN, "--radius", "3"], "a number with its unit (m, cm, mm)"),
        ([*RUN, "--start-spread", "2"], "allowed: 0 to 1"),
        ([*RUN, "--spread", "contact-friction=-20%"], "is negative; allowed: from 0"),
        ([*RUN, "--pace", "nan"], "allowed: 0.05 to 5"),
        ([*RUN, "--pace", "-1"], "allowed: 0.05 to 5"),
        ([*RUN, "--steps", "-5"], "a whole number from 0"),
        ([*RUN, "--steps", "nan"], "a whole number from 0"),
        ([*RUN, "--steps", "0"], "--steps is 0"),
        ([*RUN, "--seed", "-1"], "--seed is '-1'"),
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
    parts = [registry.part(k, n).module for k in ("backend", "algo") for n in registry.names(k)]
    heavy = ",".join(["mujoco", "torch", "pandas", "numba", "scipy", *parts])
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


def test_dry_run_shows_settings_as_they_are_typed(tmp_path, capfd):
    """Name the options with values and units that could be given again."""
    words = [*RUN, "--dry-run", "--radius", "3cm", "--pace", "0.5", "--set", "lr=1e-4"]
    assert cli.call([*words, "--out", str(tmp_path / "run"), "--workers", "1"]) == 0
    rows = [[cell.strip() for cell in line.split("│")[1:3]] for line in said(capfd)]
    assert ["radius", "3cm"] in rows and ["pace", "0.5"] in rows and ["set lr", "0.0001"] in rows


def said(capfd) -> list[str]:
    """The lines of a table on standard output."""
    return [line for line in capfd.readouterr().out.splitlines() if "│" in line]


def test_help_shows_every_default_alike(capfd):
    """Show values as they are typed; in parentheses stands what is said in words."""
    assert cli.call(["run", "-h"]) == 0
    found = " ".join(capfd.readouterr().out.replace("│", " ").split())
    assert "[default: 2cm]" in found and "[default: 1e6]" in found and "[default: (all)]" in found


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


@pytest.mark.parametrize(
    ("first", "raised"), [(KeyboardInterrupt, Interrupted), (ValueError, SystemError)]
)
def test_an_interrupt_within_compiled_code_is_one(first, raised):
    """Say that a command was stopped, and what is kept, where compiled code made other errors."""

    @command(kept="the rows are kept")
    def measure() -> dict:
        try:
            try:
                raise first
            except first as error:
                raise SystemError("unpickle returned a result with an exception set") from error
        except SystemError as error:
            raise SystemError("dispatcher returned a result with an exception set") from error

    with pytest.raises(raised) as stopped:
        measure(json=False, verbose=False, quiet=False)
    if raised is Interrupted:
        assert str(stopped.value) == "interrupted; the rows are kept"


COMMANDS = typer.main.get_command(cli.app)


ALIKE = {"NAMES": "NAME", "NUMBERS": "N", "FILE": "PATH", "DIR": "PATH"}
"""Values of one kind: several between commas, a file or a folder."""


def declared() -> Iterator[tuple[str, Any]]:
    """Every command with each of its options."""
    for words, one in below(COMMANDS, ("bench",)):
        yield from ((" ".join(words), p) for p in one.params if p.opts[0].startswith("--"))


def below(group: Any, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command that does something, with its words."""
    for name, one in group.commands.items():
        path = (*words, name)
        yield from below(one, path) if hasattr(one, "commands") else [(path, one)]


def test_an_option_means_the_same_everywhere():
    """Give options of one name one kind of value, the same short form, and no other name."""
    kinds: dict[str, set] = {}
    for _, option in declared():
        value = ALIKE.get(option.metavar, option.metavar)
        kinds.setdefault(option.opts[0], set()).add((value, option.is_flag, tuple(option.opts)))
    assert not {name: found for name, found in kinds.items() if len(found) > 1}


def test_arguments_are_named_alike():
    """Name a repeatable argument by one word."""
    arguments = [p for _, one in below(COMMANDS, ()) for p in one.params if p.nargs == -1]
    assert {p.metavar for p in arguments} == {"RUN", "DIR", "SET"}


def test_every_command_takes_the_shared_options():
    """Have --json, -v and -q everywhere, and a help text for every option."""
    for name in {name for name, _ in declared()}:
        flags = {flag for other, option in declared() if other == name for flag in option.opts}
        assert {"--json", "-v", "-q"} <= flags, name
    assert not [(name, option.opts) for name, option in declared() if not option.help]


def test_help_fits_a_terminal(capfd):
    """Cut no word in 80 columns, and wrap paragraphs where the terminal ends."""
    for words, one in below(COMMANDS, ()):
        assert cli.call([*words, "-h"]) == 0
        assert "…" not in capfd.readouterr().out, words
        assert all("\n" not in paragraph for paragraph in one.help.split("\n\n")), words


@pytest.mark.parametrize("words", [["--version"], ["-h"], ["run", "-h"], ["blind", "make", "-h"]])
def test_help_and_version_answer(words, capfd):
    """Answer on standard output, with exit code 0."""
    assert cli.call(words) == 0
    assert capfd.readouterr().out.strip()


@pytest.mark.parametrize(
    ("command", "option", "says", "wrong", "refused"),
    [
        ("excite", "--rate", "20 to 1000 Hz", "9Hz", "--rate is 9 Hz; allowed: 20 to 1000 Hz"),
        ("record", "--rate", "50 to 1000 Hz", "9Hz", "--rate is 9 Hz; allowed: 50 to 1000 Hz"),
        ("transfer", "--episodes", "2 to 10000", "1", "--episodes is 1; allowed: 2 to 10000"),
        ("eval", "--episodes", "1 to 100", "0", "--episodes is 0; allowed: 1 to 100"),
        ("view", "--port", "0 to 65535", "65536", "--port is 65536; allowed: 0 to 65535"),
        ("run", "--workers", "1 to 10000", "0", "--workers is 0; allowed: 1 to 10000"),
        ("speed", "--worlds", "1 to 100000", "4,0", "--worlds is 0; allowed: 1 to 100000"),
        ("blind make", "--times", "LOW:HIGH", "9", "--times is '9'; allowed: LOW:HIGH"),
    ],
)
def test_the_help_says_the_range_that_is_checked(
    command, option, says, wrong, refused, capfd, monkeypatch
):
    """Show what an option allows, and refuse everything else before any work."""
    monkeypatch.setenv("COLUMNS", "300")
    assert cli.call([*command.split(), "-h"]) == 0
    lines = [line for line in capfd.readouterr().out.splitlines() if line.startswith("│")]
    (line,) = [line for line in lines if f"{option} " in line]
    assert says in line
    needed = {"run": RUN[1:], "record": ["--backend", "mujoco"]}.get(command, [])
    places = {"transfer": ["x"], "eval": ["x"], "view": ["x"], "blind make": ["--answers", "x"]}
    where = [] if command == "eval" else ["--out", "new"]
    words = [*command.split(), *places.get(command, []), *needed, *where]
    assert cli.call([*words, option, wrong]) == 2
    assert refused in capfd.readouterr().err


def test_python_m_benchmark_is_bench():
    """Run as a module, too."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmark", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("stickbench ")


def test_a_shell_completes_names():
    """Complete the names of plug-ins."""
    asks = {
        "_BENCH_COMPLETE": "complete_bash",
        "COMP_WORDS": "bench run --task ei",
        "COMP_CWORD": "3",
    }
    done = subprocess.run(
        [sys.executable, "-m", "benchmark"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **asks},
    )
    assert done.stdout.split() == ["eight"]


def test_quiet_says_nothing_on_the_way(tmp_path, capfd):
    """Print the result alone with -q."""
    words = ["run", "--backend", "mujoco", "--task", "line", "--algo", "hold-still", "--smoke"]
    assert cli.call([*words, "--out", str(tmp_path / "run"), "--json", "-q"]) == 0
    assert capfd.readouterr().err == ""


def test_a_usage_error_names_the_command_that_helps(capfd):
    """Point to the help of the command that was given, in whole sentences."""
    assert cli.call(["run", "--bogus"]) == 2
    assert capfd.readouterr().err.endswith(". See `bench run --help`.\n")


@pytest.mark.parametrize(("kind", "word"), [("effects", "bounds"), ("task", "eight")])
def test_list_takes_a_kind(kind, word, capfd):
    """List one kind of part; effects with unit and bounds."""
    assert cli.call(["list", kind, "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert list(found) == [kind.removesuffix("s")]
    assert word in json.dumps(found)


def test_a_stop_that_a_library_swallows_comes_again_with_the_progress(monkeypatch):
    """Interrupt at the next step where something caught the first, and no thread but the main."""
    monkeypatch.setattr(console, "_stopping", False)
    with console.Bar("work", 2) as bar:
        with contextlib.suppress(BaseException):
            console.stop(signal.SIGTERM, None)
        with ThreadPoolExecutor() as pool:
            pool.submit(bar.update, 1).result()
        with pytest.raises(KeyboardInterrupt):
            bar.update(2)


def test_a_progress_bar_off_a_terminal_says_its_start_and_its_end(monkeypatch, capsys):
    """Say no line in between where the work takes less than the time between two lines."""
    monkeypatch.setattr(console, "EVERY_S", 1e9)
    with console.Bar("work", 300) as bar:
        for done in range(301):
            bar.update(done)
    assert capsys.readouterr().err.split("\n")[:2] == ["work 0/300 ", "work 300/300 "]


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What a command asks."""

    place: Path = setting("Where.", File("DIR"), argument=True)
    size_m: float = setting("How large.", Number(1, 5, "cm"), 0.02, "size")
    extra: tuple[Path, ...] = setting("More.", File("FILE"), (), shown="none", many=True)


@pytest.fixture
def asks(monkeypatch) -> None:
    """A command `ask` whose options are said once: as fields, and as an annotation."""

    @command()
    def ask(
        asked: Asked,
        rate: Annotated[float, Setting(help="How often.", kind=Number(1, 9, "Hz"))] = 2.0,
    ) -> dict[str, Any]:
        """Say what was asked."""
        extra = [str(path) for path in asked.extra]
        return {"place": str(asked.place), "size": asked.size_m, "extra": extra, "rate": rate}

    made = typer.Typer()
    made.command("ask")(ask)
    made.command("other")(lambda: None)
    monkeypatch.setattr(cli, "app", made)


@pytest.mark.parametrize(
    ("words", "size", "extra", "rate"),
    [
        ([], 0.02, [], 2.0),
        (["--size", "3cm", "--rate", "5Hz"], 0.03, [], 5.0),
        (["--extra", "a", "--extra", "b"], 0.02, ["a", "b"], 2.0),
    ],
)
def test_one_declaration_is_an_option(words, size, extra, rate, asks, capfd):
    """Read values and defaults of options that are declared once, whatever command has them."""
    assert cli.call(["ask", "here", *words, "--json"]) == 0
    asked = {"place": "here", "size": pytest.approx(size), "extra": extra, "rate": rate}
    assert json.loads(capfd.readouterr().out) == asked


def test_one_declaration_is_its_help_and_its_bounds(asks, capfd, monkeypatch):
    """Show help, bounds and defaults of such options; refuse what is out of bounds or missing."""
    monkeypatch.setenv("COLUMNS", "200")
    assert cli.call(["ask", "--help"]) == 0
    shown = " ".join(capfd.readouterr().out.split())
    assert "--size LENGTH How large, 1 to 5 cm. [default: 2cm]" in shown
    assert "--rate RATE How often, 1 to 9 Hz. [default: 2Hz]" in shown
    assert "--extra FILE More. [default: (none)]" in shown
    for words, said in (
        (["here", "--size", "9cm"], "--size is 9 cm; allowed: 1 to 5 cm"),
        (["here", "--rate", "5"], "--rate is '5'; allowed: a number with its unit"),
        ([], "Missing argument"),
    ):
        assert cli.call(["ask", *words]) == 2
        assert said in capfd.readouterr().err
