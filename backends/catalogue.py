"""Every effect there is, by name: its file in `backends.effects`; nobody keeps a list of them."""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache

from backends import effects
from backends.effect import Effect


@cache
def catalogue() -> Mapping[str, type[Effect]]:
    """All effect classes by their names on the command line."""
    names = sorted(module.name for module in pkgutil.iter_modules(effects.__path__))
    return {
        name.replace("_", "-"): importlib.import_module(f"backends.effects.{name}").Effect
        for name in names
        if not name.startswith("_")
    }


def of_part(catalogue: Mapping[str, type[Effect]], *parts: str) -> dict[str, str]:
    """Names of the effects that change numbers of some parts of the spec, by number."""
    return {
        number: name
        for name, kind in catalogue.items()
        for number in kind.spec_fields()
        if number.split(".")[0] in parts
    }
