"""Gymnasium environments on the batched environment, single and vector; they know no engine."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from backends.state import Array
from tasks.batch import BatchEnv, Step

MakeBatch = Callable[[int, int], BatchEnv]
"""Makes a batched environment, given a number of worlds and a seed."""


def _fresh_seed() -> int:
    """A random seed for a reset that is given none."""
    return int(np.random.SeedSequence().generate_state(1)[0])


def _spaces(env: BatchEnv) -> tuple[gym.spaces.Box, gym.spaces.Box]:
    observation = gym.spaces.Box(-np.inf, np.inf, (env.observation.width,), np.float32)
    return observation, gym.spaces.Box(-1.0, 1.0, (env.action_width,), np.float32)


def _info(step: Step) -> dict[str, Array]:
    return {
        "p_err_cm": 100 * step.end_error_m,
        "q_err_deg": np.degrees(step.axis_error_rad),
        "tracked": step.tracked,
    }


class StickEnv(gym.Env):
    """One world as a Gymnasium environment; `info` holds p_err_cm, q_err_deg and tracked."""

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, make: MakeBatch) -> None:
        self._env = make(1, _fresh_seed())
        self.observation_space, self.action_space = _spaces(self._env)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict]:
        """See `gymnasium.Env.reset`."""
        super().reset(seed=seed)
        if seed is not None:
            self._env.seed(seed)
        return self._env.reset()[0], {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict]:
        """See `gymnasium.Env.step`."""
        step = self._env.step(np.asarray(action)[None])
        info = {key: value[0].item() for key, value in _info(step).items()}
        over = bool(step.terminated[0]), bool(step.truncated[0])
        return step.observation[0], float(step.reward[0]), *over, info

    def close(self) -> None:
        """Free the engine."""
        self._env.close()


class StickVectorEnv(VectorEnv):
    """N worlds as a Gymnasium vector environment; finished worlds restart in the same step."""

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}

    def __init__(self, make: MakeBatch, num_envs: int) -> None:
        self._env = make(num_envs, _fresh_seed())
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = _spaces(self._env)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict]:
        """See `gymnasium.vector.VectorEnv.reset`; one seed serves all worlds."""
        if isinstance(seed, list):
            raise TypeError("give one seed for all worlds: they share a random stream")
        if seed is not None:
            self._env.seed(seed)
        return self._env.reset(), {}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict]:
        """See `gymnasium.vector.VectorEnv.step`."""
        step, observation = self._env.step_and_restart(np.asarray(actions))
        info: dict[str, Any] = _info(step)
        if step.done.any():
            final = np.empty(self.num_envs, dtype=object)
            for i in np.flatnonzero(step.done):
                final[i] = step.observation[i]
            info |= {"final_obs": final, "_final_obs": step.done}
        return observation, step.reward, step.terminated, step.truncated, info

    def close_extras(self, **kwargs: Any) -> None:
        """Free the engine."""
        self._env.close()
