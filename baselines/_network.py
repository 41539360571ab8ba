"""What a policy's network may be: feed-forward, bounded, the same answer to the same question.

The file is checked before it is run: a network may loop, draw at random or fill the memory.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from files.bounded import one_line

MOST_BYTES = 100_000_000
"""Largest policy that is read."""
_OPERATORS = """
Abs Add BatchNormalization Cast Celu Clip Concat Constant Conv Cos Div Elu Erf Exp Flatten Gather
Gelu Gemm HardSigmoid HardSwish Identity LayerNormalization LeakyRelu Log MatMul Max Mean Min Mish
Mul Neg PRelu Pow Reciprocal ReduceMax ReduceMean ReduceMin ReduceSum Relu Reshape Selu Shape
Sigmoid Sign Sin Slice Softmax Softplus Softsign Split Sqrt Squeeze Sub Sum Tanh ThresholdedRelu
Transpose Unsqueeze Where
"""
ALLOWED = frozenset(_OPERATORS.split())
"""Operators without loops, randomness or memory of the past."""
FLOAT = 1
"""ONNX's number for 32-bit floats."""


class PolicyError(Exception):
    """A saved policy cannot be used; the message says why."""


def check_network(path: Path, inputs: int, outputs: int) -> None:
    """Raise PolicyError unless the file is a network from `inputs` numbers to `outputs`."""
    graph = _model(path).graph
    foreign = sorted({node.op_type for node in graph.node} - ALLOWED)
    if foreign:
        said = one_line(", ".join(foreign))
        raise PolicyError(
            f"{path} has the operators {said}; allowed: a feed-forward network without loops, "
            "branches and randomness"
        )
    fixed = {tensor.name for tensor in graph.initializer}
    _check(path, "takes", [one for one in graph.input if one.name not in fixed], "observation")
    _check(path, "gives", list(graph.output), "action")
    for verb, one, width in (
        ("takes", graph.input[0], inputs),
        ("gives", graph.output[0], outputs),
    ):
        given = _shape(one)[-1]
        if given not in (width, None):
            raise PolicyError(f"{path} {verb} {given} numbers, its contract says {width}")


def _model(path: Path) -> Any:
    import onnx

    try:
        if path.stat().st_size > MOST_BYTES:
            raise PolicyError(f"{path} has more than {MOST_BYTES} bytes; no policy is so large")
        return onnx.load(str(path), load_external_data=False)
    except PolicyError:
        raise
    except Exception as error:  # noqa: BLE001 - protobuf raises classes of its own
        said = one_line(str(error))
        raise PolicyError(f"{path} cannot be read as a policy: {said}") from error


def _check(path: Path, verb: str, found: list[Any], name: str) -> None:
    """Raise PolicyError unless there is one tensor of this name: floats, a row per world."""
    said = ", ".join(_described(one) for one in found) or "nothing"
    right = [one.name for one in found] == [name] and _is_rows(found[0])
    if not right:
        raise PolicyError(
            f"{path} {verb} {one_line(said)}; allowed: '{name}', 32-bit floats, a row per world"
        )


def _is_rows(one: Any) -> bool:
    return one.type.tensor_type.elem_type == FLOAT and len(_shape(one)) == 2


def _shape(one: Any) -> list[int | None]:
    """The sizes of a tensor; None for one that is free."""
    sizes: Iterator[Any] = iter(one.type.tensor_type.shape.dim)
    return [size.dim_value if size.HasField("dim_value") else None for size in sizes]


def _described(one: Any) -> str:
    return f"'{one.name}' {['free' if n is None else n for n in _shape(one)]}"
