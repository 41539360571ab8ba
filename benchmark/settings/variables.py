"""Environment variables that set options: BENCH_RUN_SEED is `--seed` of `bench run`."""

import os
from collections.abc import Sequence
from typing import Any

PREFIX = "BENCH"


def name_variables(command: Any, words: tuple[str, ...] = (PREFIX,)) -> Any:
    """Give every option of a command and of those below it its variable; returns the command."""
    for option in command.params:
        if option.opts[0].startswith("--") and not option.is_eager:
            option.envvar = "_".join((*words, option.opts[0][2:])).upper().replace("-", "_")
            option.show_envvar = False
    for name, below in getattr(command, "commands", {}).items():
        name_variables(below, (*words, name))
    return command


def in_effect(command: Any, arguments: Sequence[str]) -> list[str]:
    """The variables that set options of the command that these arguments name."""
    given = {word.partition("=")[0] for word in arguments}
    found = []
    for one in _named(command, arguments):
        options = [p for p in one.params if p.envvar and given.isdisjoint(p.opts)]
        found += [p.envvar for p in options if os.environ.get(p.envvar)]
    return found


def _named(command: Any, arguments: Sequence[str]) -> list[Any]:
    """A command and those below it that the arguments name, outermost first."""
    found = [command]
    for word in arguments:
        below = getattr(found[-1], "commands", {})
        if word in below:
            found.append(below[word])
    return found


def without_variables() -> dict[str, str]:
    """The environment for a command that was given all that it needs as arguments."""
    return {name: value for name, value in os.environ.items() if not name.startswith(f"{PREFIX}_")}
