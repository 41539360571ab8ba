"""The interface of everything that acts: learners and scripted baselines."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from backends.state import Array
from tasks.batch import BatchEnv, Step


class Scripted(ABC):
    """Base class of a baseline that acts without learning; its subclass is named `Baseline`."""

    trains = False
    hyperparameters: ClassVar[type | None] = None

    def __init__(self, action_width: int, seed: int) -> None:
        self.action_width = action_width
        self.rng = np.random.default_rng(seed)

    @abstractmethod
    def __call__(self, observation: Array) -> Array:
        """Actions (N, J) in [-1, 1] from observations (N, width)."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """The result of one training iteration."""

    steps: int
    """Environment steps of the iteration, all worlds together."""
    reward: float
    """Mean reward per step."""
    p_err_cm: float
    """Mean error of the lower end over the iteration [cm]."""
    q_err_deg: float
    """Mean error of the axis over the iteration [deg]."""
    dropped: float
    """Share of the finished episodes in which the stick fell; NaN if none finished."""


class Learner(ABC):
    """Base class of a learning algorithm; its subclass is named `Baseline`.

    Training is a chain of segments. A segment is a pure function of the saved learner state and a
    seed: all worlds start new episodes and every random stream is restarted. So a training that is
    killed and resumed at its last checkpoint gives the same result.
    """

    trains = True
    package: ClassVar[str | None] = None
    """The installed package whose version `bench doctor` shows."""
    hyperparameters: ClassVar[type]
    """A frozen dataclass with defaults; its fields can be set on the command line."""

    @abstractmethod
    def __init__(self, env: BatchEnv, seed: int, settings: Any) -> None:
        """A new learner with these hyperparameters; `seed` sets the initial weights."""

    @staticmethod
    @abstractmethod
    def steps_per_iteration(worlds: int, settings: Any) -> int:
        """Environment steps between two updates, all worlds together."""

    @abstractmethod
    def start_from(self, policy: Path) -> None:
        """Begin with a saved policy's network and normalisation; raises PolicyError."""

    @abstractmethod
    def learn(self, done: Sequence[float], report: Callable[[Progress], None]) -> None:
        """Train for some iterations and report after each.

        `done`: the share of the training's budget that is spent before each of them.
        """

    @abstractmethod
    def save(self, path: Path) -> None:
        """Write the learner's state: tensors and numbers, which load without unpickling code."""

    @abstractmethod
    def load(self, path: Path) -> None:
        """Read the state that `save` wrote."""

    @abstractmethod
    def export(self, path: Path) -> None:
        """Write the deterministic policy as ONNX: 'observation' (N, W) to 'action' (N, J)."""


class Monitor:
    """Collects the steps of one iteration into a `Progress`."""

    def __init__(self) -> None:
        self._steps: list[tuple[float, float, float, int, int]] = []
        self._worlds = 0

    def add(self, step: Step) -> None:
        """Add one batched step."""
        self._worlds = len(step.reward)
        self._steps.append(
            (
                float(step.reward.mean()),
                float(step.end_error_m.mean()),
                float(step.axis_error_rad.mean()),
                int(step.terminated.sum()),
                int(step.done.sum()),
            )
        )

    def drain(self) -> Progress:
        """The record since the last call."""
        table = np.array(self._steps)
        self._steps = []
        reward, end, axis = table[:, :3].mean(axis=0)
        dropped, finished = table[:, 3:].sum(axis=0)
        return Progress(
            steps=len(table) * self._worlds,
            reward=float(reward),
            p_err_cm=float(end) * 100,
            q_err_deg=float(np.degrees(axis)),
            dropped=float(dropped / finished) if finished else float("nan"),
        )
