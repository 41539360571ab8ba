"""What both PPO implementations share: the hyperparameters and the export to ONNX.

Torch is imported only here and in the learners' files.
"""

import contextlib
import logging
import random
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import torch

REWARD_SCALE = 0.1
"""Rewards are scaled by a tenth, because rsl-rl clips changes of the value at an absolute 0.2."""


@dataclass(frozen=True, kw_only=True)
class PpoSettings:
    """Hyperparameters of PPO, the same for every library, engine and task."""

    steps_per_world: int = 64
    epochs: int = 5
    minibatches: int = 4
    discount: float = 0.99
    gae_lambda: float = 0.95
    clip: float = 0.2
    learning_rate: float = 5e-4
    desired_kl: float = 0.01
    """Target of the KL divergence of an update; the learning rate adapts to it."""
    value_weight: float = 1.0
    entropy_weight: float = 0.0
    max_gradient: float = 1.0
    hidden: tuple[int, ...] = (128, 128)
    initial_std: float = 0.4


SETTINGS = PpoSettings()


def seed_everything(seed: int) -> None:
    """Seed torch, numpy and random, and limit torch to one thread so that sums keep their order."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    np.random.seed(seed % 2**32)
    random.seed(seed)


class Deterministic(torch.nn.Module):
    """The deployed policy: normalised observation, network, action clipped to [-1, 1]."""

    def __init__(
        self, mean: torch.Tensor, std: torch.Tensor, network: torch.nn.Module, clip: float
    ) -> None:
        super().__init__()
        self.mean = torch.nn.Buffer(mean.reshape(1, -1).float())
        self.std = torch.nn.Buffer(std.reshape(1, -1).float())
        self.network = network
        self.clip = clip

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions (N, J) from observations (N, W)."""
        normal = torch.clamp((observation - self.mean) / self.std, -self.clip, self.clip)
        return torch.clamp(self.network(normal), -1.0, 1.0)


def export_onnx(policy: Deterministic, width: int, path: Path) -> None:
    """Write `policy` for observations of the given width, any batch size, one file."""
    policy.eval()
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    batch = torch.export.Dim("batch")
    with warnings.catch_warnings(), contextlib.redirect_stdout(None):
        warnings.simplefilter("ignore")
        torch.onnx.export(
            policy,
            (torch.zeros(2, width),),
            str(path),
            input_names=["observation"],
            output_names=["action"],
            dynamic_shapes=({0: batch},),
            dynamo=True,
            external_data=False,
            verbose=False,
        )
    _anonymize(path)


def _anonymize(path: Path) -> None:
    """Remove stack traces with paths of this machine, which the export writes into a policy."""
    model = onnx.load(path)
    graph = model.graph
    for part in (graph, *graph.node, *graph.input, *graph.output, *graph.value_info):
        del part.metadata_props[:]
    for tensor in graph.initializer:
        del tensor.metadata_props[:]
    onnx.save(model, path)
