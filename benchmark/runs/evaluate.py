"""Evaluation: fixed episodes, the same for every policy and world, and their scores."""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from backends.state import Array
from tasks.batch import BatchEnv, Step
from tasks.initial_states import sample_initial_states

EVALUATION_SEED = 20260101
"""Seed of initial states and headings in the evaluation; training seeds are hashed."""


@dataclass(frozen=True, kw_only=True)
class Episodes:
    """Scores of E episodes."""

    p_err_cm: Array
    """Mean error of the lower end while the stick was held [cm], shape (E,)."""
    q_err_deg: Array
    """Mean error of the axis while the stick was held [deg], shape (E,)."""
    held: Array
    """Fraction of the episode before the stick fell, shape (E,)."""
    tracked: Array
    """Fraction of all reference steps held within 1.0 cm and 5 degrees, shape (E,)."""

    def scores(self) -> dict[str, float]:
        """Means over the episodes, and their count."""
        means = {name: float(np.mean(values)) for name, values in asdict(self).items()}
        return {**means, "episodes": len(self.held)}


def evaluate(
    env: BatchEnv,
    act: Callable[[Array], Array],
    on_step: Callable[[BatchEnv, Step], None] = lambda env, step: None,
    seed: int = EVALUATION_SEED,
) -> Episodes:
    """Run one episode per world of `env` from the fixed initial states, with the actions of `act`.

    Another `seed` gives other initial states and headings. A world whose stick has fallen is still
    stepped to keep the batch together, but no longer counts.
    """
    rng = np.random.default_rng(seed)
    start = sample_initial_states(env.simulator.specs, rng)
    env.seed(seed)
    observation = env.reset(start=start)
    held = np.ones(env.worlds, dtype=bool)
    steps_held, tracked, end, axis = (np.zeros(env.worlds) for _ in range(4))
    for _ in range(env.horizon):
        step = env.step(act(observation))
        observation = step.observation
        held &= ~step.terminated
        steps_held += held
        tracked += held & step.tracked
        end += np.where(held, step.end_error_m, 0)
        axis += np.where(held, step.axis_error_rad, 0)
        on_step(env, step)
    some = np.maximum(steps_held, 1)
    return Episodes(
        p_err_cm=100 * end / some,
        q_err_deg=np.degrees(axis / some),
        held=steps_held / env.horizon,
        tracked=tracked / env.horizon,
    )
