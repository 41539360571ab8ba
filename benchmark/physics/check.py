"""The result of a physics check: a figure, its expected value, and the allowed distance.

Checks use only the public interface of an engine: constructor, reset, advance, state, support.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from backends.engine import Engine


@dataclass(frozen=True, kw_only=True)
class Check:
    """One measured figure of an engine."""

    name: str
    """What was measured."""
    figure: float
    """The figure, in `unit`; not finite where the engine diverged."""
    unit: str
    expected: float
    """The figure by a closed form, a conservation law or another engine."""
    bound: float
    """Largest allowed distance of the figure from the expected one."""
    why: str
    """The source of the expected figure and its bound."""

    @property
    def passed(self) -> bool:
        """Whether the figure is within its bound."""
        return bool(abs(self.figure - self.expected) <= self.bound)


Measure = Callable[[type[Engine]], Iterable[Check]]
"""Measures one engine."""
Compare = Callable[[type[Engine], type[Engine]], Iterable[Check]]
"""Measures an engine against a second one, the reference."""


def rounding(engine: type[Engine]) -> float:
    """Largest relative error of one rounding in an engine, from its `support` of masses."""
    return 2.0**-24 if "32-bit" in engine.support["body.mass_kg"] else 2.0**-53
