"""What all commands share: their settings of a run, --json, -v and -q, and how they end.

A command returns its result, alone or with a table; printing it and the exit code are done here.
"""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import typer

from benchmark import console
from benchmark.cli.options import SHARED
from benchmark.errors import Interrupted, UsageError, was_interrupt
from benchmark.parts import registry
from benchmark.settings.kinds import File, Setting, Switch, settings_of
from benchmark.settings.run_spec import SETTINGS

OF_RUN = "the run's"
"""Default of a setting that a policy's own run has."""
NOTHING_KEPT = "nothing was written"


def command(
    settings: Sequence[str] = (),
    required: Sequence[str] = (),
    default: str | None = None,
    defaults: Mapping[str, str] | None = None,
    kept: str = NOTHING_KEPT,
) -> Callable[[Callable[..., Any]], Callable[..., None]]:
    """Make a command of a function.

    Fields of a dataclass that it takes, and its parameters, each annotated with a `Setting`, are
    its options. `settings` of a run come as its argument `settings`, by name, None where not given;
    those that are `required` must be, unless a `config` is. `default` is what the help says of
    settings that are not given, `defaults` what it says of other options; `kept` is said after an
    interrupt.
    """

    def declare(function: Callable[..., Any]) -> Callable[..., None]:
        hints = get_type_hints(function, include_extras=True)
        grouped: dict[str, Any] = {n: hint for n, hint in hints.items() if is_dataclass(hint)}
        single = _declared(function, hints)

        @wraps(function)
        def call(**given: Any) -> None:
            as_json, verbose, quiet = (bool(given.pop(one.name)) for one in SHARED)
            console.set_level(verbose=verbose, quiet=quiet)
            if settings:
                given["settings"] = {name: given.pop(_word(name)) for name in settings}
                _refuse_missing(given, required)
            for name, one in single.items():
                given[name] = one.default if given[name] is None else one.read(given[name])
            for name, kind in grouped.items():
                asked = {one: given.pop(_word(one.name)) for one in settings_of(kind).values()}
                read = {one.field: one.read(v) for one, v in asked.items() if v is not None}
                given[name] = kind(**read)
            try:
                _finish(function(**given), as_json)
            except (KeyboardInterrupt, SystemError) as error:
                if not was_interrupt(error):
                    raise
                raise Interrupted(f"interrupted; {kept}") from error

        run = {name: _of_run(one, default) for name, one in SETTINGS.items() if name in settings}
        signature = _signature(
            _own(function, single, grouped, defaults or {}),
            [_parameter(_word(name), one, name in required) for name, one in run.items()],
        )
        call.__doc__ = re.sub(r"(?<=\S)\n *(?=\S)", " ", function.__doc__ or "")
        call.__signature__ = signature  # type: ignore[attr-defined]
        call.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
        del call.__wrapped__
        return call

    return declare


def _finish(result: Any, as_json: bool) -> None:
    """Print what a command gives; exit code 1 where it says that something failed."""
    data, table = result if isinstance(result, tuple) else (result, None)
    console.emit(data, as_json, table)
    if data.get("status") == "failed" or data.get("ok") is False:
        raise typer.Exit(1)


def _refuse_missing(given: Mapping[str, Any], required: Sequence[str]) -> None:
    for name in required:
        if given["settings"][name] is None and not given.get("config"):
            raise UsageError(f"Missing option '--{name}'. Allowed: {SETTINGS[name].kind.allowed}.")


def _declared(function: Callable[..., Any], hints: Mapping[str, Any]) -> dict[str, Setting]:
    """The options that annotate parameters, by parameter."""
    found = {}
    for p in inspect.signature(function).parameters.values():
        for one in get_args(hints[p.name]):
            if isinstance(one, Setting):
                default = ... if p.default is inspect.Parameter.empty else p.default
                name = one.name or p.name.replace("_", "-")
                found[p.name] = replace(one, name=name, field=p.name, default=default)
    return found


def _of_run(one: Setting, shown: str | None) -> Setting:
    """A setting of a run, which a file may give instead."""
    default = None if one.default is ... else one.default
    return replace(one, default=default, shown=shown or one.shown)


def _own(
    function: Callable[..., Any],
    single: Mapping[str, Setting],
    grouped: Mapping[str, Any],
    shown: Mapping[str, str],
) -> dict[str, Setting]:
    """What declares the command's own parameters, by parameter, in order."""
    found: dict[str, Setting] = {}
    for name in inspect.signature(function).parameters:
        if name in single:
            found[name] = single[name]
        elif name in grouped:
            found |= {_word(one.name): one for one in settings_of(grouped[name]).values()}
    return {word: replace(one, shown=shown.get(word, one.shown)) for word, one in found.items()}


def _signature(own: Mapping[str, Setting], run: Sequence[inspect.Parameter]) -> inspect.Signature:
    """Arguments, settings of a run, other options, and those that every command takes."""
    made = {word: _parameter(word, one) for word, one in own.items()}
    arguments = [made[word] for word, one in own.items() if one.argument]
    options = [made[word] for word, one in own.items() if not one.argument]
    shared = [_parameter(one.name, one) for one in SHARED]
    return inspect.Signature([*arguments, *run, *options, *shared])


def _parameter(word: str, one: Setting, required: bool = False) -> inspect.Parameter:
    """The parameter of an option; None is passed where it is not given."""
    kind, text = one.kind, one.said
    value: Any = {Switch: bool, File: Path}.get(type(kind), str)
    value = list[value] | None if one.many else value | None
    if one.argument:
        info: Any = typer.Argument(help=text, metavar=kind.metavar, show_default=one.shown or False)
    else:
        if required:
            text += " [dim](required)[/dim]"
        elif one.shown is None and one.default is not False and one.shown_default is not None:
            text += f" [dim]\\[default: {one.shown_default}][/dim]"
        info = typer.Option(
            *one.flags,
            help=text,
            metavar=kind.metavar or None,
            show_default=one.shown or False,
            autocompletion=_completes(kind),
        )
    return inspect.Parameter(
        word,
        inspect.Parameter.KEYWORD_ONLY,
        default=... if one.default is ... else None,
        annotation=Annotated[value, info],
    )


def _completes(kind: object) -> Callable[[str], list[str]] | None:
    """Completes the names of plug-ins in a shell."""
    parts = getattr(kind, "completed_by", "")

    def names(incomplete: str) -> list[str]:
        return [name for name in registry.names(parts) if name.startswith(incomplete)]

    return names if parts else None


def _word(name: str) -> str:
    """A setting's name as Python takes it."""
    return name.replace("-", "_")
