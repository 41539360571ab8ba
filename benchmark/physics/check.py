"""What a physics check returns: a figure, what is expected of it, and how far off it may lie.

Checks see an engine through its public surface alone: constructor, reset, advance, state, support.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from backends.engine import Engine


@dataclass(frozen=True, kw_only=True)
class Check:
    """One figure that an engine was measured by."""

    name: str
    """What was measured."""
    figure: float
    """The figure, in `unit`; not finite where the engine diverged."""
    unit: str
    expected: float
    """The figure of a closed form, a conservation law or another engine."""
    bound: float
    """How far the figure may lie from the expected one."""
    why: str
    """Where the expectation and its bound come from."""

    @property
    def passed(self) -> bool:
        """Whether the figure lies within its bound."""
        return bool(abs(self.figure - self.expected) <= self.bound)


Measure = Callable[[type[Engine]], Iterable[Check]]
"""Measures one engine."""
Compare = Callable[[type[Engine], type[Engine]], Iterable[Check]]
"""Measures an engine beside a second one, the reference."""


def rounding(engine: type[Engine]) -> float:
    """Largest relative error of one rounding in an engine, by its own answer for the masses."""
    return 2.0**-24 if "32-bit" in engine.support["body.mass_kg"] else 2.0**-53
