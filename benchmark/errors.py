"""Errors of commands: one message, one exit code, no traceback."""

import difflib
from collections.abc import Iterable


class CommandError(Exception):
    """Something failed; the message is complete."""

    exit_code = 1


class UsageError(CommandError):
    """The command was given something that is not allowed."""

    exit_code = 2


class Interrupted(CommandError):
    """The user stopped the command."""

    exit_code = 130


def was_interrupt(error: BaseException | None) -> bool:
    """Whether an error was caused by an interrupt, which compiled code turns into other errors."""
    if error is None or isinstance(error, KeyboardInterrupt):
        return error is not None
    return was_interrupt(error.__cause__)


def unknown(kind: str, given: str, known: Iterable[str]) -> UsageError:
    """An unknown name: the message says what was given, what is known, and a similar name."""
    names = sorted(known)
    text = f"no {kind} named '{given}'; known: {', '.join(names)}."
    near = difflib.get_close_matches(given, names, n=1, cutoff=0.5)
    return UsageError(f"{text} Did you mean '{near[0]}'?" if near else text)
