"""A saved policy: an ONNX file and its contract. Running it needs no torch, learner or pickle.

The file is checked before it is run: a network may loop, draw at random or fill the memory.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime

from backends.state import Array
from files.atomic import write_atomically
from files.bounded import FileError, one_line, read_json
from tasks.observation import Observation

POLICY_FILE, CONTRACT_FILE = "policy.onnx", "contract.json"
_MOST_BYTES = 100_000_000
"""Largest policy that is read."""
_OPERATORS = """
Abs Add BatchNormalization Cast Celu Clip Concat Constant Conv Cos Div Elu Erf Exp Flatten Gather
Gelu Gemm HardSigmoid HardSwish Identity LayerNormalization LeakyRelu Log MatMul Max Mean Min Mish
Mul Neg PRelu Pow Reciprocal ReduceMax ReduceMean ReduceMin ReduceSum Relu Reshape Selu Shape
Sigmoid Sign Sin Slice Softmax Softplus Softsign Split Sqrt Squeeze Sub Sum Tanh ThresholdedRelu
Transpose Unsqueeze Where
"""
_ALLOWED = frozenset(_OPERATORS.split())
"""Operators without loops, randomness or memory of the past."""
_FLOAT = 1
"""ONNX's number for 32-bit floats."""


class PolicyError(Exception):
    """A saved policy cannot be used; the message says why."""


class SavedPolicy:
    """A deterministic policy read from a run folder.

    Raises PolicyError if a file is missing or damaged, or if the policy was trained on another
    observation than the given one.
    """

    def __init__(self, folder: Path, observation: Observation) -> None:
        contract, wanted = read_contract(folder), observation.contract()
        if "schema" not in contract:  # before it had one, all actions were those of the paper
            contract = wanted | contract | {"action": wanted["action"]}
        if contract != wanted:
            raise PolicyError(_difference(contract, wanted))
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        path = folder / POLICY_FILE
        one = _check_network(path, observation.width, len(observation.hand.driven))
        self._input, self._rows = one.name, _shape(one)[0]
        try:
            self._session = onnxruntime.InferenceSession(str(path), options)
        except Exception as error:  # noqa: BLE001 - onnxruntime raises bare classes of its own
            said = one_line(str(error))
            raise PolicyError(f"{path} cannot be read as a policy: {said}") from error
        self._path, self._order = path, list(observation.order)

    def __call__(self, observation: Array) -> Array:
        """Actions (N, J), joints in the hand's order, from observations (N, width)."""
        parts = [observation] if self._rows is None else observation[:, None]
        try:
            given = [self._session.run(None, {self._input: part})[0] for part in parts]
            action = np.concatenate(given)
        except Exception as error:  # noqa: BLE001 - onnxruntime raises bare classes of its own
            said = one_line(str(error))
            raise PolicyError(f"{self._path} gives no actions: {said}") from error
        wanted = (len(observation), len(self._order))
        if action.shape != wanted:
            raise PolicyError(
                f"{self._path} gives actions of shape {action.shape}; allowed: {wanted}, a row per "
                "observation"
            )
        return action[:, self._order]


def write_contract(folder: Path, observation: Observation) -> None:
    """Write the contract of the policy in this folder."""
    text = json.dumps(observation.contract(), indent=2)
    write_atomically(folder / CONTRACT_FILE, text + "\n")


def read_contract(folder: Path) -> dict:
    """The contract of a saved policy; raises PolicyError when it is missing or damaged."""
    path = folder / CONTRACT_FILE
    try:
        contract = read_json(path)
    except FileNotFoundError:
        raise PolicyError(f"no policy here: {path} does not exist") from None
    except FileError as error:
        raise PolicyError(str(error)) from error
    channels = contract.get("observation")
    if not isinstance(channels, list) or not all(isinstance(c, dict) for c in channels):
        raise PolicyError(f"{path} is no contract: it lists no observation, channel by channel")
    return contract


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _difference(policy: dict, wanted: dict) -> str:
    if policy.get("observation") == wanted["observation"]:
        return (
            "the policy's contract has other joints or actions than this hand; evaluate it by its "
            "contract: bench eval, from a folder without run.json"
        )

    def layout(contract: dict) -> str:
        channels = contract.get("observation", [])
        return ", ".join(f"{c.get('name')} ({c.get('width')})" for c in channels)

    return (
        f"the policy does not fit this observation: it was trained on [{layout(policy)}], "
        f"this observation gives [{layout(wanted)}]; use the observation it was trained on"
    )


def _check_network(path: Path, inputs: int, outputs: int) -> Any:
    """The input of a network of so many inputs and outputs; raises PolicyError for another."""
    graph = _model(path).graph
    foreign = sorted({node.op_type for node in graph.node} - _ALLOWED)
    if foreign:
        said = one_line(", ".join(foreign))
        raise PolicyError(
            f"{path} has the operators {said}; allowed: a feed-forward network without loops, "
            "branches and randomness"
        )
    fixed = {tensor.name for tensor in graph.initializer}
    taken = [one for one in graph.input if one.name not in fixed]
    for verb, found, width in (("takes", taken, inputs), ("gives", list(graph.output), outputs)):
        _check(path, verb, found)
        given = _shape(found[0])[-1]
        if given not in (width, None):
            raise PolicyError(f"{path} {verb} {given} numbers, its contract says {width}")
    return taken[0]


def _model(path: Path) -> Any:
    import onnx

    try:
        if path.stat().st_size > _MOST_BYTES:
            raise PolicyError(f"{path} has more than {_MOST_BYTES} bytes; no policy is so large")
        return onnx.load(str(path), load_external_data=False)
    except PolicyError:
        raise
    except Exception as error:  # noqa: BLE001 - protobuf raises classes of its own
        said = one_line(str(error))
        raise PolicyError(f"{path} cannot be read as a policy: {said}") from error


def _check(path: Path, verb: str, found: list[Any]) -> None:
    """Raise PolicyError unless there is one tensor: floats, a row per world, or one row."""
    said = ", ".join(_described(one) for one in found) or "nothing"
    if len(found) != 1 or not _is_rows(found[0]):
        raise PolicyError(
            f"{path} {verb} {one_line(said)}; allowed: one tensor of 32-bit floats, a row per "
            "world, or one row"
        )


def _is_rows(one: Any) -> bool:
    shape = _shape(one)
    return one.type.tensor_type.elem_type == _FLOAT and len(shape) == 2 and shape[0] in (None, 1)


def _shape(one: Any) -> list[int | None]:
    """The sizes of a tensor; None for one that is free."""
    sizes: Iterator[Any] = iter(one.type.tensor_type.shape.dim)
    return [size.dim_value if size.HasField("dim_value") else None for size in sizes]


def _described(one: Any) -> str:
    return f"'{one.name}' {['free' if n is None else n for n in _shape(one)]}"
