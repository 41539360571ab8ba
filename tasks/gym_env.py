"""Gymnasium environments on the batched environment, single and vector; they know no engine."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from backends.state import Array
from tasks.batch import BatchEnv, Step

RENDER_MODES = ("rgb_array",)


class Painter(Protocol):
    """Draws worlds of a batched environment."""

    def paint(self, world: int) -> Array:
        """A picture of a world as it is now, shape (height, width, 3), uint8."""
        ...

    def close(self) -> None:
        """Free what draws; a second call is harmless."""
        ...


MakeBatch = Callable[[int, int], BatchEnv]
"""Makes a batched environment, given a number of worlds and a seed."""
MakePainter = Callable[[BatchEnv], Painter]


def _fresh_seed() -> int:
    """A random seed for a reset that is given none."""
    return int(np.random.SeedSequence().generate_state(1)[0])


def _spaces(env: BatchEnv) -> tuple[gym.spaces.Box, gym.spaces.Box]:
    observation = gym.spaces.Box(-np.inf, np.inf, (env.observation.width,), np.float32)
    return observation, gym.spaces.Box(-1.0, 1.0, (env.action_width,), np.float32)


def _metadata(env: BatchEnv) -> dict[str, Any]:
    return {"render_modes": list(RENDER_MODES), "render_fps": round(1 / env.policy_s)}


def _info(step: Step) -> dict[str, Array]:
    return {
        "p_err_cm": 100 * step.end_error_m,
        "q_err_deg": np.degrees(step.axis_error_rad),
        "tracked": step.tracked,
    }


def _refuse(options: dict[str, Any] | None, allowed: Sequence[str] = ()) -> None:
    """Raise ValueError for an option of a reset that would be ignored."""
    for name in set(options or {}) - set(allowed):
        known = ", ".join(allowed) or "none"
        raise ValueError(f"reset has no option {name!r}; allowed: {known}")


class StickEnv(gym.Env[Array, Array]):
    """One world as a Gymnasium environment; `info` holds p_err_cm, q_err_deg and tracked.

    It ends when the stick falls; the time limit is Gymnasium's, `max_episode_steps`.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES)}

    def __init__(self, make: MakeBatch, painter: MakePainter | None = None) -> None:
        """`painter` makes what draws; without it nothing is drawn."""
        self._env = make(1, _fresh_seed())
        self.metadata = _metadata(self._env)
        self.render_mode = RENDER_MODES[0] if painter else None
        self._painter = painter(self._env) if painter else None
        self.observation_space, self.action_space = _spaces(self._env)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """See `gymnasium.Env.reset`; no option is known."""
        _refuse(options)
        super().reset(seed=seed)
        if seed is not None:
            self._env.seed(seed)
        return self._env.reset()[0], {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """See `gymnasium.Env.step`."""
        step = self._env.step(np.asarray(action)[None])
        info = {key: value[0].item() for key, value in _info(step).items()}
        return step.observation[0], float(step.reward[0]), bool(step.terminated[0]), False, info

    def render(self) -> Array | None:
        """The hand and the stick as they are, shape (height, width, 3), uint8."""
        return self._painter.paint(0) if self._painter else None

    def close(self) -> None:
        """Free the engine."""
        self._env.close()
        if self._painter:
            self._painter.close()


class StickVectorEnv(VectorEnv[Array, Array, Array]):
    """N worlds as a Gymnasium vector environment."""

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES)}

    def __init__(
        self,
        make: MakeBatch,
        num_envs: int,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        painter: MakePainter | None = None,
    ) -> None:
        """`painter` makes what draws; without it nothing is drawn."""
        self._env, self.num_envs = make(num_envs, _fresh_seed()), num_envs
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**_metadata(self._env), "autoreset_mode": self._mode}
        self.render_mode = RENDER_MODES[0] if painter else None
        self._painter = painter(self._env) if painter else None
        self.single_observation_space, self.single_action_space = _spaces(self._env)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._over = np.ones(num_envs, dtype=bool)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """See `gymnasium.vector.VectorEnv.reset`; the one option is `reset_mask`.

        One seed decides the draws of all worlds together; of a list, each those of its own world,
        whatever the others are.
        """
        _refuse(options, ["reset_mask"])
        mask = self._mask((options or {}).get("reset_mask"))
        if isinstance(seed, int | np.integer):
            self._env.seed(int(seed))
        elif seed is not None:
            if len(seed) != self.num_envs:
                raise ValueError(f"{len(seed)} seeds were given; allowed: {self.num_envs}, or one")
            self._env.seed([_fresh_seed() if one is None else int(one) for one in seed])
        if not mask.all():
            _ = self._env.state  # raises where no world was ever reset
        self._over[mask] = False
        return self._env.reset(mask), {}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """See `gymnasium.vector.VectorEnv.step`."""
        waiting = np.flatnonzero(self._over)
        if waiting.size and self._mode == AutoresetMode.DISABLED:
            raise ValueError(
                f"the episode of world {waiting[0]} is over; reset it first: "
                "reset(options={'reset_mask': terminated | truncated})"
            )
        step = self._env.step(np.where(self._over[:, None], 0.0, actions))
        if self._mode == AutoresetMode.NEXT_STEP:
            return self._restarted(step)
        self._over = step.done & (self._mode == AutoresetMode.DISABLED)
        observation, info = step.observation, dict[str, Any](_info(step))
        if self._mode == AutoresetMode.SAME_STEP and step.done.any():
            info |= {"final_obs": _each(observation, step.done), "_final_obs": step.done}
            observation = self._env.reset(step.done)
        return observation, step.reward, step.terminated, step.truncated, info

    def _restarted(self, step: Step) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """A step in which the worlds whose episode was over begin again."""
        new = self._over
        observation = self._env.reset(new) if new.any() else step.observation
        info = {name: np.where(new, 0, value) for name, value in _info(step).items()}
        self._over = step.done & ~new
        ended = step.terminated & ~new, step.truncated & ~new
        return observation, np.where(new, 0.0, step.reward), *ended, info

    def render(self) -> tuple[Array, ...] | None:
        """A picture of every world, each of shape (height, width, 3), uint8."""
        painter = self._painter
        return tuple(map(painter.paint, range(self.num_envs))) if painter else None

    def close(self, **kwargs: Any) -> None:
        """See `gymnasium.vector.VectorEnv.close`."""
        super().close(**kwargs)  # here with a type

    def close_extras(self, **kwargs: Any) -> None:
        """Free the engine."""
        self._env.close()
        if self._painter:
            self._painter.close()

    def _mask(self, given: Any) -> Array:
        """Which worlds are reset; raises ValueError."""
        mask = np.ones(self.num_envs, dtype=bool) if given is None else np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise ValueError(
                f"reset_mask is {given!r}; allowed: {self.num_envs} booleans, one of them True"
            )
        return mask


def _each(observation: Array, mask: Array) -> Array:
    """Rows as objects where the mask is, None elsewhere, as Gymnasium has final observations."""
    rows = np.empty(len(mask), dtype=object)
    for i in np.flatnonzero(mask):
        rows[i] = observation[i]
    return rows
