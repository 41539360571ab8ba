"""Every effect there is, by name: nobody keeps a list of them."""

import importlib
from collections.abc import Mapping
from functools import cache

from backends.effect import Effect
from files.plugins import KINDS, parts

Catalogue = Mapping[str, type[Effect]]
"""Effect classes by name."""


@cache
def catalogue() -> Catalogue:
    """All effect classes by their names on the command line."""
    return {
        name: getattr(importlib.import_module(part.module), part.attribute)
        for name, part in parts(KINDS["effect"]).items()
    }


def of_part(catalogue: Catalogue, *parts: str) -> dict[str, str]:
    """Names of the effects that change numbers of some parts of the spec, by number."""
    return {
        number: name
        for name, kind in catalogue.items()
        for number in kind.spec_fields()
        if number.split(".")[0] in parts
    }
