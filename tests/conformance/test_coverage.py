"""A diagnosis looks for every effect of the catalogue, or says that it does not."""

import pytest

from backends.catalogue import catalogue
from backends.effect import NumberEffect
from diagnosis.verdict.sensors import not_looked_for


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_every_effect_that_is_drawn_is_looked_for(name):
    """Look for each effect that the blind check draws, and say of each other that nothing does.

    Of one that shows in the hand the report on grasps says so.
    """
    kind = catalogue()[name]
    assert (not_looked_for({name: kind}) == ()) == (kind.drawn or kind.shows_in_hand())


@pytest.mark.parametrize("number", ["encoder.noise_share", "drive.new_number", "joint.axis"])
def test_what_nothing_looks_for_is_said(number):
    """Name an effect on a number that no replay and no sensor's test knows."""

    class Foreign(NumberEffect):
        group, dimension, unit, bounds = "drive", "share", "%", (0.0, 1.0)
        least = 0.1

    Foreign.number = number
    (said,) = not_looked_for({"foreign": Foreign})
    assert said.startswith("foreign: not looked for")
