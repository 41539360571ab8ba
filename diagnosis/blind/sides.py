"""The real sides: plants and engines, each a file with its name.

A plant is a file in `mechanics` with its own equations (see `plant.Mechanics`); it has joints, but
no stick. A file in `engines` is an engine that is no backend: free air only.
"""

import importlib
from pathlib import Path

import numpy as np

from backends.engine import Engine
from backends.spec import Spec
from diagnosis.blind.plant import IMPLEMENTED, Mechanics, Plant

SAMPLE_S = 0.01
"""Of a motion by which a plant shows what it can move."""
HERE = Path(__file__).parent


def _names(folder: str) -> tuple[str, ...]:
    """Plug-ins of a folder: its files that are not private."""
    found = sorted(path.stem for path in (HERE / folder).glob("*.py"))
    return tuple(name for name in found if not name.startswith("_"))


PLANTS, ENGINES = _names("mechanics"), _names("engines")
STICKLESS = (*PLANTS, *ENGINES)
"""Real sides that hold no stick."""
TUNED = ("plant",)
"""Those on which a solver may be tuned; the others are only in sets that name them."""


def engine(name: str) -> type[Engine]:
    """One of ENGINES."""
    return importlib.import_module(f"diagnosis.blind.engines.{name}").Backend


def mechanics(name: str) -> type[Mechanics]:
    """The equations of one of PLANTS; without arguments they are those of a typical robot."""
    return importlib.import_module(f"diagnosis.blind.mechanics.{name}").Mechanics


def carries(name: str, spec: Spec) -> bool:
    """Whether a real side can move a mechanism: a plant what its equations hold for."""
    if name not in PLANTS:
        return True
    still, rng = np.zeros((2, len(spec.hand.driven))), np.random.default_rng(0)
    try:
        Plant(spec, mechanics(name)()).run(still, still, SAMPLE_S, rng)
    except ValueError:
        return False
    return True


def has(name: str, effect: str) -> bool:
    """Whether a real side knows an effect of the catalogue: engines know all."""
    return name not in PLANTS or effect in IMPLEMENTED
