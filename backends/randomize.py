"""Domain randomisation: effects of random magnitude make a new world for every draw.

As in the paper, gains and gear are drawn from normal distributions (the spread of a calibration),
and the stick's mass, radius and friction from uniform ones.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from backends.effect import Effect
from backends.spec import Spec

CLIP_STD = 2.0
"""Normal draws are cut off at this number of standard deviations."""


def randomize(spec: Spec, spread: Sequence[Effect], rng: np.random.Generator) -> Spec:
    """A world drawn around `spec`.

    The magnitude of an effect in `spread` is the standard deviation of a normal draw or half the
    width of a uniform one. An effect that names no joint is drawn independently for each joint.
    """
    for effect in spread:
        for joint in effect.joints(spec) or (None,):
            magnitude = _draw(effect, rng)
            spec = dataclasses.replace(effect, magnitude=magnitude, joint=joint).on_spec(spec)
    return spec


def _draw(effect: Effect, rng: np.random.Generator) -> float:
    if effect.spread == "uniform":
        unit = rng.uniform(-1, 1)
    else:
        unit = np.clip(rng.normal(), -CLIP_STD, CLIP_STD)
    return float(np.clip(unit * effect.magnitude, *effect.bounds))
