"""What a command says when it cannot go on: one message, one exit code, no traceback."""

import difflib
from collections.abc import Iterable


class CommandError(Exception):
    """Something failed that the user should know of; the message is complete."""

    exit_code = 1


class UsageError(CommandError):
    """The command was given something it cannot take."""

    exit_code = 2


class Interrupted(CommandError):
    """The user stopped the command."""

    exit_code = 130


def was_interrupt(error: BaseException | None) -> bool:
    """Whether an error began as an interrupt: compiled code makes others of it."""
    if error is None or isinstance(error, KeyboardInterrupt):
        return error is not None
    return was_interrupt(error.__cause__)


def unknown(kind: str, given: str, known: Iterable[str]) -> UsageError:
    """No such name: what was given, what is known, and the near one."""
    names = sorted(known)
    text = f"no {kind} named '{given}'; known: {', '.join(names)}."
    near = difflib.get_close_matches(given, names, n=1, cutoff=0.5)
    return UsageError(f"{text} Did you mean '{near[0]}'?" if near else text)
