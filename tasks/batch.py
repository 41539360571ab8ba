"""The batched environment: N worlds of one task without engine or learner code."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np

from backends.engine import Simulator
from backends.state import Array, InitialState, State, is_finite, quat_z_axis
from backends.touch import Skin, Touch
from tasks.initial_states import Draws, OwnDraws, SharedDraws
from tasks.observation import Observation, Percept
from tasks.task import EPISODE_S, Figure

ALIVE, AXIS_WEIGHT, END_WEIGHT, FORCE_WEIGHT = 0.5, 1.5, 2.0, 0.005
"""The paper's reward: [C, w0, w1 per m, w2 per N], see `judge`."""
DROP_M = 0.03
"""An episode ends when the stick's centre is this far below its nominal height [m]."""
TRACKED_M, TRACKED_RAD = 0.01, math.radians(5)
"""A step counts as tracked while the errors of lower end and axis are within these."""


@numba.njit(cache=True)
def _axes(offset, lever, out):
    for n in range(len(offset)):
        x, y = -offset[n, 0] / lever[n], -offset[n, 1] / lever[n]
        out[n, 0], out[n, 1], out[n, 2] = x, y, math.sqrt(1 - (x * x + y * y))


def desired_axis(offset_m: Array, lever_m: Array) -> Array:
    """Unit vectors (N, 3) from the reference points to the pivot; levers (N,) are end to pivot."""
    axis = np.empty((len(offset_m), 3))
    _axes(offset_m, lever_m, axis)
    return axis


@numba.njit(cache=True)
def _judge(pos, quat, force, desired, grip, lever, half):
    w, x, y, z = quat
    axis = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    low, top, turned, press, length = 0.0, 0.0, 0.0, 0.0, 2 * half
    for i in range(3):
        lower = pos[i] - half * axis[i]
        drawn = grip[i] - lever * desired[i]
        low += (lower - drawn) ** 2
        top += ((lower + length * axis[i]) - (drawn + length * desired[i])) ** 2
        turned += (axis[i] - desired[i]) ** 2
    for f in range(len(force)):
        a, b, c = force[f]
        press += math.sqrt(a * a + b * b + c * c)
    low, top, turned = math.sqrt(low), math.sqrt(top), math.sqrt(turned)
    reward = ALIVE - AXIS_WEIGHT * turned - END_WEIGHT * (low + top)
    return reward - FORCE_WEIGHT * press, low, 2 * math.asin(min(turned / 2, 1.0))


@numba.njit(cache=True)
def judge(pos, quat, force, axes, steps, last_step, grip, lever, half, floor, desired, out, over):
    """Write u_d of all worlds, their rewards and errors, and whether they are over.

    Shapes are (N, 3), (3, N) for reward, lower end [m] and axis [rad], and (2, N) for a stick that
    has fallen and time that is over. Returns the most steps of an episode.

    The reward is the paper's, C - w0 |u - u_d| - w1 (|e_low| + |e_top|) - w2 sum |f|: u is the
    stick's axis, u_d the desired one, e_low and e_top the distances [m] of the stick's ends from
    those of a stick at the drawn point along u_d, f the forces on the fingertips [N].

    The stick's grip is `lever` from its lower end and to be at `grip` (3,); it is 2 `half` long.
    """
    most = 0
    for n in range(len(pos)):
        for i in range(3):
            desired[n, i] = axes[n, steps[n], i]
        world = desired[n], grip, lever[n], half[n]
        out[0, n], out[1, n], out[2, n] = _judge(pos[n], quat[n], force[n], *world)
        over[0, n] = pos[n, 2] < floor[n]
        over[1, n] = steps[n] >= last_step[n] and not over[0, n]
        most = max(most, steps[n])
    return most


class SimulationDivergedError(Exception):
    """A signal became NaN or infinite; the message names it and the time."""


class NotFiniteActionError(SimulationDivergedError, ValueError):
    """An action is NaN or infinite; the message names the world and its step."""


class Step(NamedTuple):
    """The result of one policy step for N worlds."""

    observation: Array
    """Observation after the step, shape (N, width), float32."""
    reward: Array
    """The paper's reward, shape (N,)."""
    terminated: Array
    """Whether the stick has fallen, shape (N,), bool."""
    truncated: Array
    """Whether the episode's time is over, shape (N,), bool."""
    end_error_m: Array
    """Distance of the lower end from the drawn point [m], shape (N,)."""
    axis_error_rad: Array
    """Angle between the stick and u_d [rad], shape (N,)."""

    @property
    def done(self) -> Array:
        """Whether the episode is over, shape (N,), bool."""
        return self.terminated | self.truncated

    @property
    def tracked(self) -> Array:
        """Whether the stick is held and both errors are within their bounds, shape (N,), bool."""
        near = (self.end_error_m < TRACKED_M) & (self.axis_error_rad < TRACKED_RAD)
        return near & ~self.terminated


class BatchEnv:
    """N worlds of one task with one observation; learners see it through thin adapters."""

    def __init__(
        self,
        simulator: Simulator,
        task: Figure,
        observation: Observation,
        seed: int,
        start_spread: float = 1.0,
        episode_steps: int | None = None,
    ) -> None:
        """`start_spread` scales the spread of initial states; 0 gives a single initial state.

        An episode takes `episode_steps`, by default 6 s.
        """
        spec = simulator.specs[0]
        self.simulator, self.task, self.observation = simulator, task, observation
        self.shown = observation
        """What the vectors hold: the observation of the policy, or more for a critic."""
        self.worlds, self._start_spread = len(simulator.specs), start_spread
        self.policy_s = spec.timing.policy_s
        self.horizon = episode_steps or round(EPISODE_S / self.policy_s)
        self.seed(seed)
        hand = spec.hand
        self._skin = Skin(simulator.specs)
        self._grip = np.array(hand.grip_m)
        self._preload = np.array(hand.preload_rad)
        self._half = np.array([s.stick.length_m / 2 for s in simulator.specs])
        self._lever = np.array([s.stick.grip_to_lower_end_m for s in simulator.specs])
        self._floor = self._grip[2] + self._half - self._lever - DROP_M
        self._target = np.zeros((self.worlds, len(hand.driven)))
        self._steps = np.zeros(self.worlds, dtype=np.int64)
        self._last_step = np.full(self.worlds, self.horizon)
        self._all, self._heading = np.arange(self.worlds), np.zeros(self.worlds)
        self._axes = np.full((self.worlds, self.horizon + 2, 3), (0.0, 0.0, 1.0))
        self._state: State | None = None
        self._touch: Touch | None = None

    @property
    def action_width(self) -> int:
        """Length of the action vector."""
        return self._target.shape[1]

    @property
    def state(self) -> State:
        """The engine's latest state."""
        if self._state is None:
            raise RuntimeError("reset the environment first")
        return self._state

    @property
    def touch(self) -> Touch:
        """The latest readings of the skin."""
        if self._touch is None:
            raise RuntimeError("reset the environment first")
        return self._touch

    @property
    def time_s(self) -> Array:
        """Time since the start of each episode [s], shape (N,)."""
        return self._steps * self.policy_s

    @property
    def target_rad(self) -> Array:
        """Commanded joint angles [rad], shape (N, J)."""
        return self._target

    def seed(self, seed: int | Sequence[int]) -> None:
        """Restart the draws of episodes: one stream for all worlds, or a seed and one for each."""
        specs, spread, horizon = self.simulator.specs, self._start_spread, self.horizon
        if isinstance(seed, Sequence):
            self._draws: Draws = OwnDraws(specs, seed, spread, horizon)
        else:
            self._draws = SharedDraws(specs, seed, spread, horizon)

    def reset(
        self, mask: Array | None = None, start: InitialState | None = None, stagger: bool = False
    ) -> Array:
        """Begin new episodes in the masked worlds (default: all); returns all observations.

        `start` replaces the drawn initial states. `stagger` cuts these episodes at random lengths,
        so that worlds that start together do not all end at the same time.
        """
        mask = np.ones(self.worlds, dtype=bool) if mask is None else mask
        drawn = self._draws.episodes(mask, start)
        worlds = np.flatnonzero(mask)
        self._heading[worlds] = drawn.heading_rad[worlds]
        self._axes[worlds] = self._desired_axes(worlds, self._axes.shape[1])
        self._last_step[worlds] = drawn.cut[worlds] if stagger else self.horizon
        self._steps[worlds] = 0
        self._state = self.simulator.reset(drawn.start, mask)
        self._target[worlds] = drawn.start.joint_rad[worlds] + self._preload
        return self._observe(self._state, self._desired_axis(), worlds)

    def step(self, action: Array) -> Step:
        """Displace the targets by `action` (N, J) in [-1, 1] and advance by one policy period.

        Raises ValueError (shape), NotFiniteActionError, and SimulationDivergedError when the
        engine returns a number that is not finite.
        """
        action = np.asarray(action)
        if action.shape != self._target.shape:
            raise ValueError(
                f"actions have the shape {action.shape}; allowed: {self._target.shape}"
            )
        self._refuse_not_finite(action)
        self.observation.law.displace(self._target, self.state.measured_rad, action)
        self._state = self.simulator.advance(self._target)
        self._steps += 1
        self._refuse_nan(self._state)
        return self._judge(self._state)

    def step_and_restart(self, action: Array) -> tuple[Step, Array]:
        """`step`, then begin new episodes where one is over.

        Returns the step and the observations to act on.
        """
        step = self.step(action)
        done = step.done
        return step, self.reset(done) if done.any() else step.observation

    def close(self) -> None:
        """Free the engine."""
        self.simulator.close()

    def reference(self) -> tuple[Array, Array]:
        """Current reference point (N, 3) [m] and desired axis u_d (N, 3), world frame."""
        axis = self._desired_axis()
        return self._grip - self._lever[:, None] * axis, axis

    def _desired_axis(self) -> Array:
        return self._axes[self._all, self._steps]

    def _desired_axes(self, worlds: Array, steps: int) -> Array:
        """u_d of some worlds at the first steps of their episodes, (len(worlds), steps, 3)."""
        heading, lever = (np.repeat(a[worlds], steps) for a in (self._heading, self._lever))
        time_s = np.tile(self.policy_s * np.arange(steps), len(worlds))
        axis = desired_axis(self.task.offset_m(time_s, heading), lever)
        return axis.reshape(len(worlds), steps, 3)

    def path(self, world: int) -> Array:
        """The points that a world draws in its episode [m], world frame, shape (T, 3)."""
        return self._grip - self._lever[world] * self._axes[world, : self.horizon + 1]

    def lower_end(self) -> Array:
        """Lower end of the stick [m], world frame, shape (N, 3)."""
        axis = quat_z_axis(self.state.stick_quat_wxyz)
        return self.state.stick_pos_m - self._half[:, None] * axis

    def _observe(self, state: State, axis: Array, worlds: Array | None = None) -> Array:
        """Observations of all worlds; only `worlds` (None: all) are read again."""
        touch = self._touch = self._skin.feel(state, self.time_s, worlds)
        percept = Percept(
            state=state,
            touch=touch,
            desired_axis=axis,
            target_rad=self._target,
            axes=self._axes,
            steps=self._steps,
        )
        return self.shown.read(percept)

    def _judge(self, state: State) -> Step:
        axis, figures = np.empty((self.worlds, 3)), np.empty((3, self.worlds))
        over = np.empty((2, self.worlds), dtype=bool)
        pose = state.stick_pos_m, state.stick_quat_wxyz
        time = self._axes, self._steps, self._last_step
        sticks = self._grip, self._lever, self._half, self._floor
        most = judge(*pose, state.contact_force_n, *time, *sticks, axis, figures, over)
        if most + 1 == self._axes.shape[1]:  # nobody ends the episode
            self._axes = self._desired_axes(self._all, 2 * self._axes.shape[1])
        return Step(
            observation=self._observe(state, axis),
            reward=figures[0],
            terminated=over[0],
            truncated=over[1],
            end_error_m=figures[1],
            axis_error_rad=figures[2],
        )

    def _refuse_not_finite(self, action: Array) -> None:
        if not is_finite(action):
            world = int(np.flatnonzero(~np.isfinite(action).all(axis=1))[0])
            raise NotFiniteActionError(
                f"the action of world {world} is not finite at step {self._steps[world] + 1} of "
                "its episode: the policy gave NaN or infinity"
            )

    def _refuse_nan(self, state: State) -> None:
        bad = state.first_bad_signal()
        if bad is not None:
            time_s = self.time_s.max()
            raise SimulationDivergedError(f"{bad} is not finite at {time_s:.2f} s or before")
