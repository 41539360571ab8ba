"""Stable-Baselines3's SAC: off-policy, with its replay buffer in every checkpoint."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from pydantic import Field
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from baselines.baseline import Learner, Monitor, Progress
from baselines.ppo import Count, Deployed, Positive, Share, export_onnx, seed_everything
from baselines.saved import PolicyError
from baselines.sb3_ppo import Sb3Env
from tasks.batch import BatchEnv

_CLIP_OBSERVATION = 10.0
_KEPT = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of the replay buffer."""


@dataclass(frozen=True, kw_only=True)
class SacSettings:
    """Hyperparameters of SAC, the same for every engine and task."""

    rollout_steps: Count = 4
    """Steps of every world between two rounds of updates."""
    updates: Count = 32
    """Gradient steps of a round."""
    batch: Count = 512
    buffer: Count = 200_000
    """Transitions that are kept, all worlds together."""
    gamma: Share = 0.99
    tau: Share = 0.005
    """Share of the critic that its target takes over with every update."""
    lr: Positive = 3e-4
    hidden: Annotated[tuple[Count, ...], Field(min_length=1, max_length=8)] = (128, 128)
    """Widths of the networks' hidden layers."""


class _Report(BaseCallback):
    """Reports after every rollout."""

    def __init__(self, monitor: Monitor, report: Callable[[Progress], None]) -> None:
        super().__init__()
        self._monitor, self._report = monitor, report

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self._report(self._monitor.drain())


class Baseline(Learner):
    """SAC with a learnt temperature; the first iteration acts at random."""

    package = "stable-baselines3"
    hyperparameters = SacSettings

    def __init__(self, env: BatchEnv, seed: int, settings: SacSettings) -> None:
        seed_everything(seed)
        self._env, self._monitor, self._settings = env, Monitor(), settings
        self._vec = VecNormalize(
            Sb3Env(env, self._monitor), norm_reward=False, clip_obs=_CLIP_OBSERVATION
        )
        self._model = SAC(
            "MlpPolicy",
            self._vec,
            learning_rate=settings.lr,
            buffer_size=max(settings.buffer, env.worlds),
            learning_starts=self.steps_per_iteration(env.worlds, settings),
            batch_size=settings.batch,
            tau=settings.tau,
            gamma=settings.gamma,
            train_freq=(settings.rollout_steps, "step"),
            gradient_steps=settings.updates,
            policy_kwargs={"net_arch": list(settings.hidden), "activation_fn": torch.nn.ELU},
            device="cpu",
            seed=seed % 2**32,
        )

    @staticmethod
    def steps_per_iteration(worlds: int, settings: SacSettings) -> int:
        """See `Learner.steps_per_iteration`."""
        return settings.rollout_steps * worlds

    def start_from(self, policy: Path) -> None:
        """Refused: a policy has neither critic nor replay buffer."""
        raise PolicyError("sb3-sac cannot start from a policy, which has no critic; leave it out")

    def learn(self, done: Sequence[float], report: Callable[[Progress], None]) -> None:
        """See `Learner.learn`."""
        steps = len(done) * self.steps_per_iteration(self._env.worlds, self._settings)
        self._model.set_logger(Logger(folder=None, output_formats=[]))  # its own makes a folder
        self._model.learn(steps, callback=_Report(self._monitor, report))

    def save(self, path: Path) -> None:
        """See `Learner.save`."""
        model, moments, buffer = self._model, self._moments, self._buffer
        filled = buffer.buffer_size if buffer.full else buffer.pos
        torch.save(
            {
                "policy": model.policy.state_dict(),
                "temperature": self._temperature.detach(),
                "optimizers": [one.state_dict() for one in self._optimizers],
                "mean": torch.from_numpy(moments.mean),
                "var": torch.from_numpy(moments.var),
                "count": float(moments.count),
                "buffer": {n: torch.from_numpy(getattr(buffer, n)[:filled]) for n in _KEPT},
                "next": buffer.pos,
            },
            path,
        )

    def load(self, path: Path) -> None:
        """See `Learner.load`."""
        saved = torch.load(path, weights_only=True)
        model, moments, buffer = self._model, self._moments, self._buffer
        model.policy.load_state_dict(saved["policy"])
        self._temperature.data.copy_(saved["temperature"])
        for one, state in zip(self._optimizers, saved["optimizers"], strict=True):
            one.load_state_dict(state)
        moments.mean, moments.var = saved["mean"].numpy(), saved["var"].numpy()
        moments.count = saved["count"]
        for name, rows in saved["buffer"].items():
            getattr(buffer, name)[: len(rows)] = rows.numpy()
        buffer.pos, buffer.full = saved["next"], len(rows) == buffer.buffer_size
        model.learning_starts = 0

    def export(self, path: Path) -> None:
        """See `Learner.export`."""
        actor, moments = self._model.actor, self._moments
        network = torch.nn.Sequential(actor.latent_pi, actor.mu, torch.nn.Tanh())
        mean = torch.from_numpy(moments.mean)
        std = torch.from_numpy(np.sqrt(moments.var + self._vec.epsilon))
        deployed = Deployed(mean=mean, std=std, network=network, clip=_CLIP_OBSERVATION)
        export_onnx(deployed, path)

    @property
    def _moments(self) -> RunningMeanStd:
        moments = self._vec.obs_rms
        assert isinstance(moments, RunningMeanStd)
        return moments

    @property
    def _buffer(self) -> ReplayBuffer:
        buffer = self._model.replay_buffer
        assert buffer is not None
        return buffer

    @property
    def _temperature(self) -> torch.Tensor:
        temperature = self._model.log_ent_coef
        assert temperature is not None
        return temperature

    @property
    def _optimizers(self) -> tuple[torch.optim.Optimizer, ...]:
        temperature = self._model.ent_coef_optimizer
        assert temperature is not None
        return self._model.actor.optimizer, self._model.critic.optimizer, temperature
