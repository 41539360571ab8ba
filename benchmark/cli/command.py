"""What all commands share: their settings of a run, --json, -v and -q, and how they end.

A command returns its result, alone or with a table; printing it and the exit code are done here.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, get_args, get_type_hints

import typer
from typer.models import OptionInfo

from benchmark import console
from benchmark.cli.options import Json, Quiet, Verbose, completes
from benchmark.errors import Interrupted, UsageError, was_interrupt
from benchmark.settings.kinds import Name, Number, Setting, Switch
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

    The fields of a dataclass that it takes are its options, see `benchmark.settings.options`.
    `settings` of a run come as its argument `settings`, by name, None where not given; those that
    are `required` must be, unless a `config` is. `default` is what the help says of settings that
    are not given, `defaults` what it says of other options; `kept` is said after an interrupt.
    """

    def declare(function: Callable[..., Any]) -> Callable[..., None]:
        hints = get_type_hints(function, include_extras=True)
        grouped: dict[str, Any] = {n: hint for n, hint in hints.items() if is_dataclass(hint)}

        @wraps(function)
        def call(**given: Any) -> None:
            as_json = given.pop("as_json")
            console.set_level(verbose=given.pop("verbose"), quiet=given.pop("quiet"))
            if settings:
                given["settings"] = {name: given.pop(_word(name)) for name in settings}
                _refuse_missing(given, required)
            for name, kind in grouped.items():
                given[name] = kind(**{one.name: given.pop(one.name) for one in fields(kind)})
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
    own = [
        one
        for p in inspect.signature(function).parameters.values()
        if p.name != "settings"
        for one in (
            _of_fields(hints[p.name])
            if is_dataclass(hints[p.name])
            else [p.replace(annotation=_shown(hints[p.name], defaults.get(p.name)))]
        )
    ]
    asked = [_of_setting(SETTINGS[name], name in required, default) for name in settings]
    shared = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in {"as_json": Json, "verbose": Verbose, "quiet": Quiet}.items()
    ]
    arguments = [p for p in own if not _is_option(p.annotation)]
    options = [p for p in own if _is_option(p.annotation)]
    keyword = inspect.Parameter.KEYWORD_ONLY
    return [p.replace(kind=keyword) for p in (*arguments, *asked, *options, *shared)]


def _of_fields(kind: Any) -> list[inspect.Parameter]:
    """The options that are the fields of a dataclass."""
    hints, found = get_type_hints(kind), []
    for one in fields(kind):
        said = {key: one.metadata[key] for key in ("help", "metavar")}
        flag = f"--{(one.metadata['option'] or one.name).replace('_', '-')}"
        info = (
            typer.Argument(**said, show_default=False)
            if one.metadata["argument"]
            else typer.Option(flag, **said, show_default=one.metadata["shown"] or True)
        )
        found.append(
            inspect.Parameter(
                one.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=one.default,
                annotation=Annotated[hints[one.name], info],
            )
        )
    return found


def _of_setting(one: Setting, required: bool, default: str | None) -> inspect.Parameter:
    """The option of a setting."""
    flags = [one.flag, *([f"--{one.alias}"] if one.alias else [])]
    if isinstance(one.kind, Switch) and one.default is True:
        flags = [f"{one.flag}/--no-{one.name}"]
    plain = isinstance(one.kind, Switch) and one.default is False
    between = ", " if isinstance(one.kind, Number) else ": "
    text = between.join(filter(None, [one.help.rstrip("."), one.kind.allowed])) + "."
    if required:
        text += " [dim](required)[/dim]"
    elif not (default or plain):
        text += f" [dim]\\[default: {one.shown_default}][/dim]"
    option = typer.Option(
        *flags,
        help=text,
        metavar=one.kind.metavar or None,
        show_default=default or False,
        autocompletion=completes(one.kind.kind) if isinstance(one.kind, Name) else None,
    )
    value: Any = bool if isinstance(one.kind, Switch) else str
    return inspect.Parameter(
        _word(one.name),
        inspect.Parameter.KEYWORD_ONLY,
        default=None,
        annotation=Annotated[value | None, option],
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
