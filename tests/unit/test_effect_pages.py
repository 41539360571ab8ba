"""Every effect says in its docstring what the docs promise of it."""

import pytest

from backends.effect import POINTS, UNITS, Effect, description, magnitudes
from benchmark.parts import registry

NAMES = registry.names("effect")


def kind(name: str) -> type[Effect]:
    """The class of an effect."""
    return registry.load("effect", name)


@pytest.mark.parametrize("name", NAMES)
def test_docstring_says_every_point_in_order(name: str) -> None:
    """Say what the magnitude is, then the law, its source, hardware, log and what looks alike."""
    meaning, points = description(kind(name))
    assert meaning.endswith(".")
    assert tuple(points) == POINTS, "write 'Law: ...' to 'Confused with: ...' in the docstring"
    assert all(text.endswith(".") for text in points.values())


@pytest.mark.parametrize("name", NAMES)
def test_effect_has_a_group_and_bounds_in_its_unit(name: str) -> None:
    """Name the page that describes the effect, and bounds of its dimension."""
    assert kind(name).group.replace(" ", "").isalpha()
    assert UNITS[kind(name).unit][0] == kind(name).dimension
    assert magnitudes(kind(name)).endswith(kind(name).unit)
