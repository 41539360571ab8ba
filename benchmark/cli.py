"""The `bench` command: its commands in the order of its help, and what it exits with.

Nothing heavy is imported up here: `bench --help` and `bench list` load no engine and no learner.
"""

import signal
import sys
from collections.abc import Callable
from types import FrameType

import typer

from benchmark import blind_cli, errors
from benchmark.check_cli import doctor, list_parts, measure_speed
from benchmark.console import ERR, divert_stdout, emit
from benchmark.gap_cli import calibrate, diagnose
from benchmark.grid_cli import leaderboard, sweep, transfer
from benchmark.log_cli import excite, import_logs, record
from benchmark.run_cli import evaluate, run, view

INTERRUPTED = 130
"""Exit code after Ctrl-C; typer gives it back as a command's result."""
COMMANDS: dict[str, dict[str, Callable[..., None]]] = {
    "One policy": {"run": run, "eval": evaluate, "view": view},
    "Many runs": {"sweep": sweep, "transfer": transfer, "leaderboard": leaderboard},
    "Logs": {"record": record, "excite": excite, "import": import_logs},
    "The gap": {"calibrate": calibrate, "diagnose": diagnose},
    "This machine": {"speed": measure_speed, "list": list_parts, "doctor": doctor},
}
"""By panel of the help."""


def _assembled() -> typer.Typer:
    made = typer.Typer(
        name="bench",
        help="Stickbench: one tactile hand, one stick, the same tasks in every physics engine.",
        no_args_is_help=True,
        add_completion=False,
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
    )
    for panel, commands in COMMANDS.items():
        for name, command in commands.items():
            made.command(name, rich_help_panel=panel)(command)
    made.add_typer(blind_cli.app, name="blind", rich_help_panel="The gap")
    return made


app = _assembled()


def _stop(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """Entry point: run a command and turn every failure into one message and an exit code."""
    signal.signal(signal.SIGTERM, _stop)
    if "--help" not in sys.argv and len(sys.argv) > 1:
        divert_stdout()
    sys.exit(_run(sys.argv[1:]))


def _run(arguments: list[str]) -> int:
    as_json = "--json" in arguments
    try:
        code = app(arguments, standalone_mode=False)
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        return code if isinstance(code, int) else 0
    except errors.CommandError as error:
        return _fail(str(error), error.exit_code, as_json)
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        return _fail(f"cannot use{where}: {error.strerror or error}", 1, as_json)
    except (KeyboardInterrupt, typer.Abort):
        return _interrupted(as_json)
    except SystemError as error:
        if not _was_interrupt(error):
            raise
        return _interrupted(as_json)
    except typer.TyperException as error:
        return _fail(f"{error.format_message()} See `bench --help`.", 2, as_json)


def _was_interrupt(error: BaseException | None) -> bool:
    """Whether an error began as an interrupt: compiled code makes others of it."""
    if error is None or isinstance(error, KeyboardInterrupt):
        return error is not None
    return _was_interrupt(error.__cause__)


def _interrupted(as_json: bool) -> int:
    kept = "interrupted; what was written is kept, --resume continues a run"
    return _fail(kept, INTERRUPTED, as_json)


def _fail(message: str, code: int, as_json: bool) -> int:
    ERR.print(f"bench: {message}", markup=False)
    if as_json:
        status = "interrupted" if code == INTERRUPTED else "error"
        emit({"status": status, "error": message}, True)
    return code
