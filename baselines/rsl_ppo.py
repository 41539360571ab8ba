"""rsl-rl's PPO on the batched environment."""

import contextlib
import copy
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

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


class RslEnv(VecEnv):
    """The batched environment as an rsl-rl 5 VecEnv; the policy sees the first `seen` numbers."""

    def __init__(self, env: BatchEnv, monitor: Monitor, seen: int) -> None:
        self._env, self._monitor, self._seen = env, monitor, seen
        self.num_envs, self.num_actions = env.worlds, env.action_width
        self.max_episode_length = env.horizon
        self.episode_length_buf = torch.zeros(env.worlds, dtype=torch.long)
        self.device = torch.device("cpu")
        self.cfg: dict = {}
        self._observation = self._pack(env.reset(stagger=True))

    def get_observations(self) -> TensorDict:
        """The current observations. rsl-rl calls this repeatedly, so it never resets."""
        return self._observation

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict]:
        """See `rsl_rl.env.VecEnv.step`; finished worlds restart at once."""
        step, observation = self._env.step_and_restart(actions.numpy())
        self._monitor.add(step)
        self._observation = self._pack(observation)
        reward = torch.from_numpy(REWARD_SCALE * step.reward).float()
        extras = {"time_outs": torch.from_numpy(step.truncated).float()}
        return self._observation, reward, torch.from_numpy(step.done).long(), extras

    def _pack(self, observation: Array) -> TensorDict:
        whole = torch.from_numpy(observation)
        groups = {"policy": whole[:, : self._seen], "critic": whole}
        return TensorDict(groups, batch_size=[self.num_envs])


def _config(settings: PpoSettings) -> dict:
    network = {
        "class_name": "MLPModel",
        "hidden_dims": list(settings.hidden),
        "activation": "elu",
        "obs_normalization": True,
    }
    gaussian = {
        "class_name": "GaussianDistribution",
        "init_std": settings.init_std,
        "std_type": "log",
    }
    return {
        "num_steps_per_env": settings.rollout_steps,
        "save_interval": 10**9,
        "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
        "actor": {**network, "distribution_cfg": gaussian},
        "critic": network,
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": settings.epochs,
            "num_mini_batches": settings.minibatches,
            "clip_param": settings.clip,
            "gamma": settings.gamma,
            "lam": settings.gae_lambda,
            "value_loss_coef": settings.value_coef,
            "entropy_coef": settings.entropy_coef,
            "learning_rate": settings.lr,
            "max_grad_norm": settings.max_grad_norm,
            "schedule": "adaptive",
            "desired_kl": settings.target_kl,
        },
    }


class Baseline(Learner):
    """rsl-rl PPO with the shared hyperparameters; its learning rate adapts per minibatch."""

    package = "rsl-rl-lib"
    hyperparameters = PpoSettings

    def __init__(self, env: BatchEnv, seed: int, settings: PpoSettings) -> None:
        seed_everything(seed)
        self._env, self._monitor, self._settings = env, Monitor(), settings
        with contextlib.redirect_stdout(None):
            vec = RslEnv(env, self._monitor, watch(env, settings))
            self._runner = OnPolicyRunner(vec, copy.deepcopy(_config(settings)))

    @staticmethod
    def steps_per_iteration(worlds: int, settings: PpoSettings) -> int:
        """See `Learner.steps_per_iteration`."""
        return settings.rollout_steps * worlds

    def start_from(self, policy: Path) -> None:
        """See `Learner.start_from`."""
        trained, actor = read_trained(policy), self._runner.alg.get_policy()
        std = torch.clamp(trained.std - actor.obs_normalizer.eps, min=0.0)
        trained.copy_into(actor.mlp, std + actor.obs_normalizer.eps)
        seen = trained.mean.shape[1]
        for normal in (actor.obs_normalizer, self._runner.alg.critic.obs_normalizer):
            normal._mean[:, :seen] = trained.mean
            normal._std[:, :seen] = std
            normal._var[:, :seen] = std**2
            normal.count.fill_(SEEN)

    def learn(self, done: Sequence[float], report: Callable[[Progress], None]) -> None:
        """See `Learner.learn`."""
        for spent in done:
            self._runner.alg.desired_kl = annealed_kl(self._settings, spent)
            self._runner.learn(1)
            report(self._monitor.drain())

    def save(self, path: Path) -> None:
        """See `Learner.save`."""
        torch.save(self._runner.alg.save(), path)

    def load(self, path: Path) -> None:
        """See `Learner.load`."""
        self._runner.alg.load(torch.load(path, weights_only=True), None, strict=True)

    def export(self, path: Path) -> None:
        """See `Learner.export`."""
        actor = self._runner.alg.get_policy()
        normal = actor.obs_normalizer
        std = normal.std + normal.eps
        policy = Deployed(mean=normal.mean, std=std, network=actor.mlp, clip=float("inf"))
        export_onnx(policy, path)
