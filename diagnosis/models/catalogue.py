"""Every effect there is, by name; the solver keeps no list of them."""

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
