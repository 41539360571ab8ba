"""What all commands share: their settings of a run, --json, -v and -q, and how they end.

A command returns its result, alone or with a table; printing it and the exit code are done here.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import is_dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import typer
from typer.models import OptionInfo

from benchmark import console
from benchmark.cli.options import Json, Quiet, Verbose, completes
from benchmark.errors import Interrupted, UsageError, was_interrupt
from benchmark.settings.kinds import File, Name, Setting, Switch, settings_of
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

    Fields of a dataclass that it takes, and annotations that are a `Setting`, are its options.
    `settings` of a run come as its argument `settings`, by name, None where not given; those that
    are `required` must be, unless a `config` is. `default` is what the help says of settings that
    are not given, `defaults` what it says of other options; `kept` is said after an interrupt.
    """

    def declare(function: Callable[..., Any]) -> Callable[..., None]:
        hints = get_type_hints(function, include_extras=True)
        grouped: dict[str, Any] = {n: hint for n, hint in hints.items() if is_dataclass(hint)}
        single = {name: one for name, hint in hints.items() if (one := _declared(name, hint))}

        @wraps(function)
        def call(**given: Any) -> None:
            as_json = given.pop("as_json")
            console.set_level(verbose=given.pop("verbose"), quiet=given.pop("quiet"))
            if settings:
                given["settings"] = {name: given.pop(_word(name)) for name in settings}
                _refuse_missing(given, required)
            for name, one in single.items():
                if given[name] is None:
                    given[name] = inspect.signature(function).parameters[name].default
                else:
                    given[name] = one.read(given[name])
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

        parameters = _parameters(function, hints, settings, required, default, defaults or {})
        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        call.__annotations__ = {p.name: p.annotation for p in parameters}
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


def _parameters(
    function: Callable[..., Any],
    hints: Mapping[str, Any],
    settings: Sequence[str],
    required: Sequence[str],
    default: str | None,
    defaults: Mapping[str, str],
) -> list[inspect.Parameter]:
    """The command's own parameters, with the settings after its arguments, and the shared ones."""
    own = []
    for p in inspect.signature(function).parameters.values():
        said = defaults.get(p.name)
        if is_dataclass(hints[p.name]):
            own += [_of_setting(one, defaults) for one in settings_of(hints[p.name]).values()]
        elif one := _declared(p.name, hints[p.name]):
            own.append(_of_setting(replace(one, default=p.default, shown=said)))
        elif p.name != "settings":
            own.append(p.replace(annotation=_shown(hints[p.name], said)))
    asked = [
        _of_setting(replace(one, shown=default or one.shown), required=name in required)
        for name, one in SETTINGS.items()
        if name in settings
    ]
    shared = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in {"as_json": Json, "verbose": Verbose, "quiet": Quiet}.items()
    ]
    arguments = [p for p in own if not _is_option(p.annotation)]
    options = [p for p in own if _is_option(p.annotation)]
    keyword = inspect.Parameter.KEYWORD_ONLY
    return [p.replace(kind=keyword) for p in (*arguments, *asked, *options, *shared)]


def _declared(name: str, annotation: Any) -> Setting | None:
    """The option that annotates a parameter, if one does."""
    found = [part for part in get_args(annotation) if isinstance(part, Setting)]
    return replace(found[0], name=found[0].name or name.replace("_", "-")) if found else None


def _of_setting(
    one: Setting, defaults: Mapping[str, str] | None = None, required: bool = False
) -> inspect.Parameter:
    """The parameter of an option; None is passed where it is not given."""
    word, kind = _word(one.name), one.kind
    flags = [one.flag, *([f"--{one.alias}"] if one.alias else [])]
    if isinstance(kind, Switch) and one.default is True:
        flags = [f"{one.flag}/--no-{one.name}"]
    text = one.said
    said = (defaults or {}).get(word, one.shown)
    default: Any = None
    value: Any = {Switch: bool, File: Path}.get(type(kind), str)
    value = list[value] | None if one.many else value | None
    if one.argument:
        info = typer.Argument(help=text, metavar=kind.metavar, show_default=False)
        return _parameter(word, value, info, ... if one.default is ... else None)
    if required:
        text += " [dim](required)[/dim]"
    elif said is None and one.default is not False and one.shown_default is not None:
        text += f" [dim]\\[default: {one.shown_default}][/dim]"
    option = typer.Option(
        *flags,
        help=text,
        metavar=kind.metavar or None,
        show_default=said or False,
        autocompletion=completes(kind.kind) if isinstance(kind, Name) else None,
    )
    return _parameter(word, value, option, default)


def _parameter(name: str, value: Any, info: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[value, info],
    )


def _shown(annotation: Any, default: str | None) -> Any:
    """An option whose help says a default in words."""
    if default is None:
        return annotation
    value, info = get_args(annotation)
    info = copy(info)
    info.show_default = default
    return Annotated[value, info]


def _is_option(annotation: Any) -> bool:
    return any(isinstance(part, OptionInfo) for part in get_args(annotation))


def _word(name: str) -> str:
    """A setting's name as Python takes it."""
    return name.replace("-", "_")
