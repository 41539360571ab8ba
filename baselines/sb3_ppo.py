"""Stable-Baselines3's PPO on the batched environment."""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from backends.state import Array
from baselines.baseline import Learner, Monitor, Progress
from baselines.ppo import (
    REWARD_SCALE,
    SEEN,
    Deployed,
    PpoSettings,
    annealed_kl,
    export_onnx,
    read_trained,
    seed_everything,
    watch,
)
from tasks.batch import BatchEnv

_RATE_RANGE, _RATE_FACTOR = (1e-5, 1e-2), 1.5
_CLIP_OBSERVATION = 10.0


class Sb3Env(VecEnv):
    """The batched environment as a Stable-Baselines3 VecEnv; finished worlds restart at once."""

    def __init__(self, env: BatchEnv, monitor: Monitor) -> None:
        width = env.shown.width
        super().__init__(
            env.worlds,
            gym.spaces.Box(-np.inf, np.inf, (width,), np.float32),
            gym.spaces.Box(-1.0, 1.0, (env.action_width,), np.float32),
        )
        self._env, self._monitor = env, monitor
        self._action = np.zeros((env.worlds, env.action_width))

    def reset(self) -> Array:
        """Begin new episodes in all worlds, cut at staggered lengths."""
        return self._env.reset(stagger=True)

    def step_async(self, actions: Array) -> None:
        """Store the actions for the next step."""
        self._action = actions

    def step_wait(self) -> tuple[Array, Array, Array, list[dict]]:
        """See `VecEnv.step_wait`."""
        step, observation = self._env.step_and_restart(self._action)
        self._monitor.add(step)
        infos: list[dict] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(step.done):
            infos[i] = {
                "terminal_observation": step.observation[i],
                "TimeLimit.truncated": bool(step.truncated[i]),
            }
        return observation, (REWARD_SCALE * step.reward).astype(np.float32), step.done, infos

    def close(self) -> None:
        """Do nothing: the environment is closed by its creator."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list:
        """See `VecEnv.get_attr`."""
        return [getattr(self, attr_name, None)] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not supported: the worlds are defined by their spec."""
        raise NotImplementedError("worlds are set up by their spec")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list:
        """Not supported: there is no environment object per world."""
        raise NotImplementedError("there is no environment object per world")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """False for every world."""
        return [False] * len(self._rows(indices))

    def _rows(self, indices: Any) -> Sequence[int]:
        return list(self._get_indices(indices))


class _Extractor(MlpExtractor):
    """Hidden layers of a policy that sees the first `seen` features and a critic that sees all."""

    def __init__(self, width: int, seen: int, hidden: Any, elu: type[torch.nn.Module]) -> None:
        super().__init__(width, hidden, elu)
        self._seen = seen
        if seen < width:
            self.policy_net[0] = torch.nn.Linear(seen, hidden[0])

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """The policy's last hidden layer."""
        return self.policy_net(features[:, : self._seen])


class ActorCritic(ActorCriticPolicy):
    """SB3's policy with a critic that sees more than the actor."""

    def __init__(self, *args: Any, seen: int, **kwargs: Any) -> None:
        self._seen = seen
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        arch, elu = self.net_arch, self.activation_fn
        self.mlp_extractor = _Extractor(self.features_dim, self._seen, arch, elu)


class _Report(BaseCallback):
    """Reports, and adapts the learning rate to the last update's KL divergence, as rsl-rl does."""

    def __init__(
        self, monitor: Monitor, report: Callable[[Progress], None], targets: Iterator[float]
    ) -> None:
        super().__init__()
        self._monitor, self._report, self._targets = monitor, report, targets

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self.adapt()

    def _on_rollout_end(self) -> None:
        self._report(self._monitor.drain())

    def adapt(self) -> None:
        """Adapt the learning rate if there was an update."""
        kl = self.logger.name_to_value.get("train/approx_kl")
        if kl is None:
            return
        rate, target = self.model.policy.optimizer.param_groups[0]["lr"], next(self._targets)
        if kl > 2 * target:
            rate = max(_RATE_RANGE[0], rate / _RATE_FACTOR)
        elif 0 < kl < target / 2:
            rate = min(_RATE_RANGE[1], rate * _RATE_FACTOR)
        _set_rate(self.model, rate)


def _set_rate(model: Any, rate: float) -> None:
    model.learning_rate = rate
    model.lr_schedule = lambda _: rate
    for group in model.policy.optimizer.param_groups:
        group["lr"] = rate


class Baseline(Learner):
    """Stable-Baselines3 PPO with the shared hyperparameters; its rate adapts per update."""

    package = "stable-baselines3"
    hyperparameters = PpoSettings

    def __init__(self, env: BatchEnv, seed: int, settings: PpoSettings) -> None:
        seed_everything(seed)
        self._env, self._monitor, self._settings = env, Monitor(), settings
        self._seen = watch(env, settings)
        self._vec = VecNormalize(
            Sb3Env(env, self._monitor), norm_reward=False, clip_obs=_CLIP_OBSERVATION
        )
        self._model: OnPolicyAlgorithm = PPO(
            ActorCritic,
            self._vec,
            n_steps=settings.rollout_steps,
            batch_size=settings.rollout_steps * env.worlds // settings.minibatches,
            n_epochs=settings.epochs,
            gamma=settings.gamma,
            gae_lambda=settings.gae_lambda,
            clip_range=settings.clip,
            learning_rate=settings.lr,
            vf_coef=settings.value_coef,
            ent_coef=settings.entropy_coef,
            max_grad_norm=settings.max_grad_norm,
            policy_kwargs={
                "seen": self._seen,
                "net_arch": list(settings.hidden),
                "activation_fn": torch.nn.ELU,
                "log_std_init": math.log(settings.init_std),
            },
            device="cpu",
            seed=seed % 2**32,
        )

    @staticmethod
    def steps_per_iteration(worlds: int, settings: PpoSettings) -> int:
        """See `Learner.steps_per_iteration`."""
        return settings.rollout_steps * worlds

    @property
    def _moments(self) -> RunningMeanStd:
        moments = self._vec.obs_rms
        assert isinstance(moments, RunningMeanStd)
        return moments

    def start_from(self, policy: Path) -> None:
        """See `Learner.start_from`."""
        trained, actor = read_trained(policy), self._model.policy
        network = torch.nn.ModuleList([actor.mlp_extractor.policy_net, actor.action_net])
        trained.copy_into(network, trained.std)
        moments = self._moments
        moments.mean[: self._seen] = trained.mean.numpy().ravel()
        moments.var[: self._seen] = (
            trained.std.numpy().ravel().astype(float) ** 2 - self._vec.epsilon
        )
        moments.count = SEEN

    def learn(self, done: Sequence[float], report: Callable[[Progress], None]) -> None:
        """See `Learner.learn`."""
        steps = len(done) * self.steps_per_iteration(self._env.worlds, self._settings)
        targets = (annealed_kl(self._settings, spent) for spent in done)
        self._model.set_logger(Logger(folder=None, output_formats=[]))  # its own makes a folder
        reporting = _Report(self._monitor, report, targets)
        self._model.learn(steps, callback=reporting)
        reporting.adapt()

    def save(self, path: Path) -> None:
        """See `Learner.save`."""
        moments = self._moments
        torch.save(
            {
                "policy": self._model.policy.state_dict(),
                "optimizer": self._model.policy.optimizer.state_dict(),
                "mean": torch.from_numpy(moments.mean),
                "var": torch.from_numpy(moments.var),
                "count": float(moments.count),
            },
            path,
        )

    def load(self, path: Path) -> None:
        """See `Learner.load`."""
        saved = torch.load(path, weights_only=True)
        self._model.policy.load_state_dict(saved["policy"])
        self._model.policy.optimizer.load_state_dict(saved["optimizer"])
        moments = self._moments
        moments.mean, moments.var = saved["mean"].numpy(), saved["var"].numpy()
        moments.count = saved["count"]
        _set_rate(self._model, saved["optimizer"]["param_groups"][0]["lr"])

    def export(self, path: Path) -> None:
        """See `Learner.export`."""
        policy, moments = self._model.policy, self._moments
        network = torch.nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net)
        mean = torch.from_numpy(moments.mean[: self._seen])
        std = torch.from_numpy(np.sqrt(moments.var[: self._seen] + self._vec.epsilon))
        deployed = Deployed(mean=mean, std=std, network=network, clip=_CLIP_OBSERVATION)
        export_onnx(deployed, path)
