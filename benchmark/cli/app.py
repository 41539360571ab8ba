"""The `bench` command: its commands in the order of its help, and what it exits with.

Nothing heavy is imported up here: `bench --help` and `bench list` load no engine and no learner.
"""

import gc
import os
import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer
from typer.main import get_command

from benchmark import console, errors
from benchmark.cli import blind, doctor
from benchmark.cli.check import list_parts, measure_speed, submit, verify
from benchmark.cli.demo import demo
from benchmark.cli.gap import calibrate, check, diagnose
from benchmark.cli.grid import leaderboard, sweep, transfer
from benchmark.cli.log import excite, import_logs, record
from benchmark.cli.own import new, test
from benchmark.cli.run import evaluate, run, view
from benchmark.provenance import version
from benchmark.settings.variables import in_effect, name_variables
from files.bounded import FileError

INTERRUPTED = errors.Interrupted.exit_code
"""Exit code after Ctrl-C; typer gives it back as a command's result."""
LONGEST = 1000
"""Characters of a message that are printed."""
HELP = {"help_option_names": ["-h", "--help"]}
COMMANDS: dict[str, dict[str, Callable[..., None]]] = {
    "A first look": {"demo": demo},
    "One policy": {"run": run, "eval": evaluate, "view": view},
    "Many runs": {
        "sweep": sweep,
        "transfer": transfer,
        "leaderboard": leaderboard,
        "verify": verify,
        "submit": submit,
    },
    "Logs": {"record": record, "excite": excite, "import": import_logs},
    "Parts of your own": {"new": new, "test": test},
    "The gap": {"check": check, "calibrate": calibrate, "diagnose": diagnose},
    "This machine": {"speed": measure_speed, "list": list_parts},
}
"""By panel of the help."""


def _assembled() -> typer.Typer:
    made = typer.Typer(
        name="bench",
        no_args_is_help=True,
        context_settings=HELP,
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
    )
    made.callback()(_bench)
    for panel, commands in COMMANDS.items():
        for name, command in commands.items():
            made.command(name, rich_help_panel=panel)(command)
    made.add_typer(blind.app, name="blind", rich_help_panel="The gap")
    made.add_typer(doctor.app, name="doctor", rich_help_panel="This machine")
    return made


def _show_version(asked: bool) -> None:
    if asked:
        print(f"stickbench {version('stickbench')}")
        raise typer.Exit


def _bench(
    show_version: Annotated[
        bool,
        typer.Option("--version", help="Print the version.", callback=_show_version, is_eager=True),
    ] = False,
    log_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Append what is printed on standard error, as plain lines with their time.",
        ),
    ] = None,
) -> None:
    """Stickbench: one tactile hand, one stick, the same tasks in every physics engine."""
    console.log_to(log_file)


app = _assembled()
RARELY = 20_000, 10, 10
"""When garbage is looked for: libraries make half a million objects that stay, and to go through
them as often as Python does by itself takes a twentieth of a short command."""


def main() -> None:
    """Entry point: run a command and turn every failure into one message and an exit code."""
    gc.set_threshold(*RARELY)
    console.open_closed_streams()
    signal.signal(signal.SIGTERM, console.stop)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, console.stop)
    asks = {"-h", "--help", "--version", "--show-completion", "--install-completion"}
    if len(sys.argv) > 1 and asks.isdisjoint(sys.argv) and "_BENCH_COMPLETE" not in os.environ:
        console.divert_stdout()
    sys.exit(call(sys.argv[1:]))


def call(arguments: list[str]) -> int:
    """Run a command; its exit code."""
    commands = name_variables(get_command(app))
    try:
        _refuse_no_text(arguments)
        code = commands(arguments, prog_name="bench", standalone_mode=False)
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        return code if isinstance(code, int) else 0
    except errors.CommandError as error:
        _trace()
        message, code = str(error), error.exit_code
    except FileError as error:
        message, code = str(error), errors.UsageError.exit_code
    except MemoryError:
        message, code = "the memory is full; take less at a time, or fewer --workers", 1
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        message, code = f"cannot use{where}: {error.strerror or error}", 1
    except (KeyboardInterrupt, typer.Abort):
        message, code = "interrupted", INTERRUPTED
    except typer.TyperException as error:
        message, code = _usage(error), errors.UsageError.exit_code
    except Exception as error:  # noqa: BLE001 - the net below all that was not foreseen
        _trace()
        message, code = _unforeseen(error), 1
    return _fail(message, code, in_effect(commands, arguments), "--json" in arguments)


def _trace() -> None:
    """Print the trace of the error that is handled, with -v."""
    if console.is_verbose():
        console.say(traceback.format_exc().rstrip())


def _refuse_no_text(arguments: list[str]) -> None:
    """Raise UsageError for an argument that is no text: it could be neither kept nor printed."""
    for word in arguments:
        try:
            word.encode()
        except UnicodeEncodeError:
            raise errors.UsageError(f"{ascii(word)} is no UTF-8; write it in UTF-8") from None


def _unforeseen(error: Exception) -> str:
    """What to say of a fault of the program: what, where, and how to report it."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    first = str(error).split("\n", 1)[0][:200]
    return (
        f"this should not happen: {type(error).__name__}: {first} (in {Path(last.filename).name}, "
        f"line {last.lineno}); the same command with -v shows the trace: please report both"
    )


def _usage(error: typer.TyperException) -> str:
    """What was wrong with the words, and where the right ones are told."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "bench"
    message = error.format_message().rstrip()
    stop = "" if message.endswith((".", "?", "!")) else "."
    return f"{message}{stop} See `{command} --help`."


def _fail(message: str, code: int, variables: list[str], as_json: bool) -> int:
    """Say what failed, and with wrong usage which environment variables had a part in it."""
    if code == errors.UsageError.exit_code and variables:
        message = f"{message} (from the environment: {', '.join(variables)})"
    message = _printable(message)
    with suppress(OSError):  # nobody reads it
        console.fail(message)
        if as_json or any(name.endswith("_JSON") for name in variables):
            status = "interrupted" if code == INTERRUPTED else "error"
            console.emit({"status": status, "error": message}, True)
    return code


def _printable(message: str) -> str:
    """A message without signs that steer a terminal, of bounded length."""
    text = "".join(c if c.isprintable() or c == "\n" else "?" for c in message)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} ... ({len(text)} characters)"
