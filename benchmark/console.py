"""Output of commands: one JSON object or a table on stdout, everything else on stderr."""

import json
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, TracebackType

from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

ERR = Console(stderr=True, highlight=False, soft_wrap=True)
UNKNOWN_WIDTH = 160
"""Width of an output that is no terminal, in characters."""
EVERY_S = 10.0
"""Time between two lines of a progress bar on an output that is no terminal [s]."""
ROW_WIDTH = 140
"""Width that a row with its folder needs, in characters."""
_real_stdout: int | None = None
_level = logging.WARNING
_stopping = False
_log: list[logging.Handler] = []
"""The log file, if there is one."""


def log_to(path: Path | None) -> None:
    """From now on, append to a file what is printed on standard error, line by line with times."""
    _log[:] = [] if path is None else [logging.FileHandler(path, encoding="utf-8")]
    for handler in _log:
        handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s"))
    logging.captureWarnings(bool(_log))


def _note(text: str) -> None:
    for handler in _log:
        for line in text.splitlines():
            handler.handle(logging.LogRecord("bench", logging.INFO, "", 0, line, None, None))


def set_level(verbose: bool, quiet: bool) -> None:
    """Set how much is printed on standard error besides errors: everything, or no progress."""
    global _level
    _level = logging.DEBUG if verbose else logging.ERROR if quiet else logging.WARNING
    handlers = [logging.StreamHandler(sys.stderr), *_log]
    logging.basicConfig(handlers=handlers, format="%(name)s: %(message)s", force=True)
    logging.getLogger().setLevel(logging.INFO if verbose else _level)


def is_verbose() -> bool:
    """Whether -v was given."""
    return _level == logging.DEBUG


def say(text: str) -> None:
    """Print a progress message, unless -q was given."""
    if _level < logging.ERROR:
        warn(text)


def warn(text: str) -> None:
    """Print what a user has to know about the result, also under -q."""
    ERR.print(text, markup=False)
    _note(text)


def fail(text: str) -> None:
    """Print why the command failed."""
    warn(f"bench: {text}")


def open_closed_streams() -> None:
    """Give the standard streams that were closed before the start a place that takes everything."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, number)
            setattr(sys, name, os.fdopen(number, mode, closefd=False))


def divert_stdout() -> None:
    """From now on, send everything that libraries print on standard output to standard error."""
    global _real_stdout
    if _real_stdout is None:
        sys.stdout.flush()
        _real_stdout = os.dup(1)
        os.dup2(2, 1)


def emit(result: dict, as_json: bool, table: RenderableType | None = None) -> None:
    """Print a command's result: the JSON object, or the table (else the object's lines)."""
    descriptor = os.dup(1 if _real_stdout is None else _real_stdout)
    with os.fdopen(descriptor, "w") as out:
        if as_json:
            out.write(json.dumps(result, allow_nan=False) + "\n")
            return
        console = Console(file=out, width=_width(), highlight=False)
        console.print(listed(result) if table is None else table)


def listed(result: dict) -> Table:
    """The keys and values of a result; nested ones get the name of their parent."""
    table = Table("what", "value", header_style="bold")
    for key, value in result.items():
        inner = value.items() if isinstance(value, dict) else [("", value)]
        for name, one in inner:
            table.add_row(f"{key} {name}".strip(), Text(_cell(one)))
    return table


def _width() -> int:
    return ERR.width if sys.stderr.isatty() else UNKNOWN_WIDTH


def row_table(row: dict, columns: list[str]) -> Table:
    """Some columns of a row; below each other if the terminal is narrow."""
    if _width() < ROW_WIDTH:
        table = Table("column", "value", header_style="bold")
        for column in columns:
            table.add_row(column, _cell(row.get(column)))
        return table
    table = Table(header_style="bold")
    for column in columns:
        table.add_column(column, overflow="fold")
    table.add_row(*(_cell(row.get(column)) for column in columns))
    return table


def _cell(value: object) -> str:
    if value is None or value == [] or value == {}:
        return "-"
    if isinstance(value, list | tuple):
        return "\n".join(map(_cell, value))
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def stop(number: int, frame: FrameType | None) -> None:
    """Handle a signal that ends the command: raise KeyboardInterrupt, at once and in a `Bar`.

    The first is lost where a library catches whatever comes, as some do while they are imported.
    """
    global _stopping
    _stopping = True
    raise KeyboardInterrupt


@contextmanager
def patient() -> Iterator[Callable[[], bool]]:
    """While something is worth keeping, a first Ctrl-C is only noted: gives whether there was one.

    A second one stops the command as ever.
    """
    noted = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal noted
        if noted:
            stop(number, frame)
        noted = True

    ours = signal.getsignal(signal.SIGINT) is stop
    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield lambda: noted
    finally:
        if ours:
            signal.signal(signal.SIGINT, stop)


class Bar:
    """A progress bar on a terminal; elsewhere a line per twentieth of the work, not too often."""

    def __init__(self, what: str, total: int) -> None:
        self._what, self._total, self._said, self._said_s = what, total, -1, -EVERY_S
        self._bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=10),
            TaskProgressColumn(),
            TimeRemainingColumn(),
            TextColumn("left"),
            TextColumn("{task.fields[note]}"),
            console=ERR,
            disable=not ERR.is_terminal or _level == logging.ERROR,
        )
        self._task: TaskID = self._bar.add_task(what, total=total, note="")

    def __enter__(self) -> "Bar":
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def update(self, done: int, note: str = "") -> None:
        """Show that `done` of the total is finished, with a note; see also `stop`."""
        if _stopping and threading.current_thread() is threading.main_thread():
            raise KeyboardInterrupt
        self._bar.update(self._task, completed=done, note=note)
        part, now_s = 20 * done // max(self._total, 1), time.monotonic()
        due = part == 20 or now_s >= self._said_s + EVERY_S
        if part > self._said and due and _level < logging.ERROR:
            self._said, self._said_s = part, now_s
            line = f"{self._what} {done}/{self._total} {note}"
            _note(line) if ERR.is_terminal else say(line)
