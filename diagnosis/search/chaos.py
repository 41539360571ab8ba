"""Motion that no replay predicts: play that rattles, and light joints that are thrown about.

A joint in its play goes its own way after the smallest change of its start, and where a joint is
thrown about, every step of the integration tells: half as long, it shows another motion. No world
then shows what the real one did, however right it is. So residuals are counted in what a world
itself cannot predict.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import Evidence, squared_gaps
from diagnosis.models.world import World
from diagnosis.motion.columns import PLAY
from diagnosis.search.fit import Fit, Fitter
from diagnosis.verdict.ordinary import Ordinary

NUDGES_RAD = (-1e-5, -3e-6, 3e-6, 1e-5)
"""Shifts of the start that no sensor shows [rad; of a slide a share of its travel]."""
NEARBY = (-3e-3, -1e-3, 1e-3, 3e-3)
"""A play that rattles is not known more closely than these shares of it: one that is a thousandth
off leaves 12 floors (`tests/unit/test_rattle.py`)."""
BY_STEP = 0.02
"""A replay in half the steps may differ by this share of a joint's motion: the loop of its drive
then ticks twice as often."""


def prediction_spread(world: World, u: Mapping[int, float], plays: Sequence[int] = ()) -> Array:
    """What a world cannot predict of its readings (M,) [squared floors].

    `plays`: the numbers of those that are not known more closely than `NEARBY`.
    """
    here = world.shown(u)
    others = [world.shown(u, nudge) for nudge in NUDGES_RAD]
    others += [world.shown({**u, k: u[k] * (1.0 + near)}) for k in plays for near in NEARBY]
    return np.nan_to_num(np.mean([(other - here) ** 2 for other in others], axis=0))


def with_prediction_spread(fitter: Fitter, fit: Fit, ordinary: Ordinary) -> Fit:
    """The fit of causes that leave more than is ordinary, in what its world itself can predict."""
    if not fit.freed or fit.worst <= ordinary.floors:
        return fit
    plays = [k for k in fit.freed if fitter.parameters[k].place == PLAY]
    residual = fit.residual / np.sqrt(1.0 + prediction_spread(fitter, fit.u, plays))
    return replace(fit, gap2=squared_gaps(fitter.evidence, residual))


def step_spread(world: World) -> Array:
    """What the nominal world's own steps may hide (M,) [squared floors], beyond `BY_STEP`."""
    evidence, limb = world.evidence, world.evidence.limb
    here = world.shown({})
    apart = evidence.pack(limb.in_half_steps().simulate(limb.nominal)) - here
    usual = [np.full(p.stop - p.start, BY_STEP * np.std(here[p])) for p in evidence.parts]
    return np.maximum(np.nan_to_num(apart) ** 2 - np.concatenate(usual) ** 2, 0.0)


def spreading(world: World) -> Evidence:
    """A limb's evidence, counted in what its nominal world can predict."""
    evidence = world.evidence
    if evidence.limb.rigid:
        return replace(evidence, spread=step_spread(world))
    if not evidence.limb.nominal[:, PLAY].any():
        return evidence
    return replace(evidence, spread=prediction_spread(world, {}))
