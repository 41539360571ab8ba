"""What both PPO implementations share: the hyperparameters and the export to ONNX.

Torch is imported only here and in the learners' files.
"""

import random
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from onnx.helper import (
    make_graph,
    make_model,
    make_node,
    make_opsetid,
    make_tensor_value_info,
)
from pydantic import Field

from baselines.saved import PolicyError
from tasks.batch import BatchEnv
from tasks.privileged import Privileged

OPSET, IR_VERSION = 20, 10
"""Versions of the operators and the format that policies are written in."""
REWARD_SCALE = 0.1
"""Rewards are scaled by a tenth, because rsl-rl clips changes of the value at an absolute 0.2."""


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]


@dataclass(frozen=True, kw_only=True)
class PpoSettings:
    """Hyperparameters of PPO, the same for every library, engine and task."""

    rollout_steps: Count = 64
    """Steps of every world between two updates."""
    epochs: Count = 5
    minibatches: Count = 4
    gamma: Share = 0.99
    gae_lambda: Share = 0.95
    clip: Positive = 0.2
    lr: Positive = 5e-4
    """Learning rate to begin with."""
    target_kl: Positive = 0.01
    """Target of the KL divergence of an update; the learning rate adapts to it."""
    anneal: Share = 0.0
    """Share of the training at whose end `target_kl` has fallen to a thirtieth; 0: it stays."""
    value_coef: NotNegative = 1.0
    entropy_coef: NotNegative = 0.0
    max_grad_norm: Positive = 1.0
    critic: Literal["observation", "state"] = "observation"
    """What the critic sees: the policy's observation, or the simulator's state with it."""
    hidden: Annotated[tuple[Count, ...], Field(min_length=1, max_length=8)] = (128, 128)
    """Widths of the networks' hidden layers."""
    init_std: Positive = 0.4
    """Standard deviation of the actions to begin with."""


def annealed_kl(settings: PpoSettings, done: float) -> float:
    """Target of the KL divergence when a share of the training's budget is spent."""
    left = (1 - done) / settings.anneal if settings.anneal else 1.0
    return settings.target_kl * min(max(left, 1 / 30), 1.0)


def watch(env: BatchEnv, settings: PpoSettings) -> int:
    """Let the environment show what the critic sees; returns how much of it the policy sees."""
    seen = env.observation
    env.shown = Privileged(seen) if settings.critic == "state" else seen
    return seen.width


def seed_everything(seed: int) -> None:
    """Seed torch, numpy and random, and limit torch to one thread so that sums keep their order."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    np.random.seed(seed % 2**32)
    random.seed(seed)


@dataclass(frozen=True, kw_only=True)
class Deployed:
    """The deployed policy: normalised observation, network, action clipped to [-1, 1]."""

    mean: torch.Tensor
    std: torch.Tensor
    """Of the observations, W numbers."""
    clip: float
    """Bound of normalised observations."""
    network: torch.nn.Module
    """Linear layers with ELU between them, and Tanh at the end where the library has it."""


def export_onnx(policy: Deployed, path: Path) -> None:
    """Write `policy` for any batch size, as one file."""
    parts = policy.network.named_modules(remove_duplicate=False)  # one ELU may stand in many places
    layers = [part for _, part in parts if not list(part.children())]
    linear = [part for part in layers if isinstance(part, torch.nn.Linear)]
    values = {
        "mean": policy.mean.reshape(1, -1),
        "std": policy.std.reshape(1, -1),
        "low": torch.tensor(-policy.clip),
        "high": torch.tensor(policy.clip),
        "least": torch.tensor(-1.0),
        "most": torch.tensor(1.0),
    }
    nodes = [
        make_node("Sub", ["observation", "mean"], ["sub"]),
        make_node("Div", ["sub", "std"], ["div"]),
        make_node("Clip", ["div", "low", "high"], ["normal"]),
    ]
    last = "normal"
    for number, layer in enumerate(layers):
        made, operator, more = _layer(layer, number)
        values |= made
        nodes.append(make_node(operator, [last, *made], [f"layer{number}"], **more))
        last = f"layer{number}"
    nodes.append(make_node("Clip", [last, "least", "most"], ["action"]))
    graph = make_graph(
        nodes,
        "policy",
        [_batch("observation", linear[0].in_features)],
        [_batch("action", linear[-1].out_features)],
        [numpy_helper.from_array(v.detach().float().numpy(), n) for n, v in values.items()],
    )
    version = [make_opsetid("", OPSET)]
    onnx.save(make_model(graph, opset_imports=version, ir_version=IR_VERSION), path)


def _layer(layer: torch.nn.Module, number: int) -> tuple[dict[str, torch.Tensor], str, dict]:
    """The values of a layer by name, its operator and the operator's attributes."""
    if isinstance(layer, torch.nn.Linear):
        weights = {f"weight{number}": layer.weight, f"bias{number}": layer.bias}
        return weights, "Gemm", {"transB": 1}
    if isinstance(layer, torch.nn.ELU):
        return {}, "Elu", {"alpha": layer.alpha}
    if isinstance(layer, torch.nn.Tanh):
        return {}, "Tanh", {}
    raise TypeError(f"a policy's network has no {type(layer).__name__}")


def _batch(name: str, width: int) -> onnx.ValueInfoProto:
    return make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["batch", width])


SEEN = 1_000_000
"""Observations that the normalisation of a policy to start from is taken to rest on."""


@dataclass(frozen=True, kw_only=True)
class Trained:
    """What a saved policy holds."""

    mean: torch.Tensor
    std: torch.Tensor
    """Of the observations, shape (1, W)."""
    layers: tuple[tuple[torch.Tensor, torch.Tensor], ...]
    """Weights (out, in) and biases (out,) of the network, first to last."""

    def copy_into(self, network: torch.nn.Module, std: torch.Tensor) -> None:
        """Give a network that normalises by `std` these layers, so that it acts as this one does.

        Raises PolicyError where it has other layers.
        """
        linear = [part for part in network.modules() if isinstance(part, torch.nn.Linear)]
        shapes = [tuple(part.weight.shape) for part in linear]
        given = [tuple(weight.shape) for weight, _ in self.layers]
        if shapes != given:
            widths = ",".join(str(rows) for rows, _ in given[:-1])
            raise PolicyError(
                f"the policy to start from has layers {given}, this learner {shapes}; use the "
                f"observation it was trained on, and --set hidden={widths},"
            )
        with torch.no_grad():
            for part, (weight, bias) in zip(linear, self.layers, strict=True):
                part.weight.copy_(weight)
                part.bias.copy_(bias)
            linear[0].weight.mul_(std.reshape(1, -1) / self.std)


def read_trained(path: Path) -> Trained:
    """The normalisation and the network of a policy that `export_onnx` wrote; PolicyError."""
    try:
        graph = onnx.load(path).graph
        values = {t.name: torch.tensor(numpy_helper.to_array(t)) for t in graph.initializer}
        steps = [node for node in graph.node if node.op_type == "Gemm"]
        layers = tuple((values[node.input[1]], values[node.input[2]]) for node in steps)
        mean, std = values["mean"], values["std"]
    except Exception as error:  # noqa: BLE001 - onnx raises many classes for a strange file
        raise PolicyError(f"{path} is no policy that a learner here exported: {error}") from error
    return Trained(mean=mean, std=std, layers=layers)
