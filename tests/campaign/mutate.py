"""Spoil what a person may have written: bytes, text, data, tables, XML and networks.

Every function takes a random generator and the good thing, and gives a bad one (or one that is
merely odd: whether it is refused or taken is up to the reader).
"""

import copy
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np
import onnx
import pandas as pd

WORDS = [
    *("", " ", "-1", "0", "1", "nan", "inf", "1e999", "-1e-400", "9" * 400, "1_0", "0x10", "1,2"),
    *("x" * 5000, "=1+1", "@a", "--", ",,,", ":", "null", "true", "2026-02-30", "../../x", "%s%n"),
    *(
        "/dev/zero",
        "/dev/null",
        "/proc/self/mem",
        ".",
        "a=b",
        "[31m",
        "é",
        "\u202ea",
        "1e6",
        "none",
    ),
    *("all", "1cm", "-3deg", "1e30", "0.5", "1000000000", "~", "*", "'", '"'),
]
"""Texts in the place of any value."""
VALUES: list[Any] = [
    *WORDS,
    *(None, True, -1, 0, 1, 1e308, -1e308, float("nan"), float("inf"), 10**30, 1e-300, 1e9, 7),
    *([], {}, [[]], [1, 2, 3], {"a": 1}, ["a"] * 50, [None], {"": {"": {"": 0}}}),
]
"""Values in the place of any value."""
Rng = np.random.Generator


def pick(rng: Rng, values: Any) -> Any:
    """One of some values."""
    return values[int(rng.integers(len(values)))]


def spoil_bytes(rng: Rng, data: bytes) -> bytes:
    """Bytes with some changed, taken away, put in or repeated."""
    start, stop = sorted(rng.integers(len(data) + 1, size=2).tolist())
    kind = rng.integers(6)
    if kind == 0:
        return data[:start]
    if kind == 1:
        return data[:start] + data[stop:]
    if kind == 2:
        return data[:stop] + data[start:stop] * int(rng.integers(1, 20)) + data[stop:]
    if kind == 3:
        return data[:start] + rng.bytes(int(rng.integers(1, 9))) + data[start:]
    if kind == 4:
        changed = bytearray(data)
        for place in rng.integers(len(data), size=int(rng.integers(1, 30))):
            changed[place] = int(rng.integers(256))
        return bytes(changed)
    return data[:start] + pick(rng, WORDS).encode() + data[start:]


def spoil_lines(rng: Rng, text: str) -> str:
    """Text with a word, a cell or a line changed, taken away or repeated."""
    lines = text.split("\n")
    k = int(rng.integers(len(lines)))
    kind = rng.integers(5)
    if kind == 0:
        lines[k] = pick(rng, WORDS)
    elif kind == 1:
        lines[k:k] = [lines[k]] * int(rng.integers(1, 200))
    elif kind == 2:
        del lines[k]
    else:
        mark = "," if "," in lines[k] else ":" if ":" in lines[k] else " "
        cells = lines[k].split(mark)
        cells[int(rng.integers(len(cells)))] = pick(rng, WORDS)
        lines[k] = mark.join(cells)
    return "\n".join(lines)


def _places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every place in nested lists and dictionaries: what holds it, and its key there."""
    inner = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in list(inner):
        yield data, key
        if isinstance(value, dict | list):
            yield from _places(value)


def spoil_data(rng: Rng, data: Any) -> Any:
    """Data with one value replaced, one taken away, or one key renamed."""
    data = copy.deepcopy(data)
    holder, key = pick(rng, list(_places(data)))
    kind = rng.integers(5)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder, dict):
        holder[pick(rng, WORDS)] = holder.pop(key)
    elif kind == 2:
        holder[key] = [holder[key]]
    else:
        holder[key] = pick(rng, VALUES)
    return data


def spoil_table(rng: Rng, frame: pd.DataFrame) -> pd.DataFrame:
    """A table with a cell, a column or its rows changed."""
    frame = frame.copy()
    name = pick(rng, list(frame.columns))
    kind = rng.integers(9)
    if kind == 0:
        return frame.drop(columns=name)
    if kind == 1:
        return frame.rename(columns={name: pick(rng, WORDS)})
    if kind == 2:
        return frame.iloc[: int(rng.integers(3))]
    if kind == 3:
        return frame.sample(frac=1.0, random_state=int(rng.integers(1000)))
    if kind == 4:
        return pd.concat([frame] * 3, ignore_index=True)
    if kind == 5:
        frame[name] = [str(pick(rng, WORDS)) for _ in range(len(frame))]
    elif kind == 6:
        frame[name] = pick(rng, [0.0, 1e30, np.nan, np.inf, True, -1, pd.Timestamp(0), None])
    elif kind == 7:
        frame[name] = [[1.0]] * len(frame)
    else:
        column = frame[name].astype(object).tolist()
        column[int(rng.integers(len(column)))] = pick(rng, [1e30, np.nan, np.inf, -1e9, 0.0])
        frame[name] = column
    return frame


def spoil_xml(rng: Rng, text: str) -> str:
    """XML with an attribute changed or taken away, or an element repeated, renamed or moved."""
    root = ElementTree.fromstring(text)
    element = pick(rng, list(root.iter()))
    kind = rng.integers(6)
    if kind <= 2 and element.attrib:
        element.set(pick(rng, list(element.attrib)), pick(rng, WORDS))
    elif kind == 3 and element.attrib:
        del element.attrib[pick(rng, list(element.attrib))]
    elif kind == 4:
        element.extend(copy.deepcopy(list(element)) * int(rng.integers(1, 4)))
    else:
        element.tag = pick(rng, ["include", "replicate", "body", "joint", "geom", "size", "x"])
    return ElementTree.tostring(root, encoding="unicode")


def spoil_network(rng: Rng, data: bytes) -> bytes:
    """A network with names, sizes, types or operators changed."""
    model = onnx.load_from_string(data)
    graph, kind = model.graph, rng.integers(7)
    node = pick(rng, graph.node)
    if kind == 0:
        node.op_type = pick(rng, ["Loop", "RandomNormal", "Add", "MatMul", "Tanh", "Shape", "No"])
    elif kind == 1:
        graph.input[0].name = pick(rng, WORDS)
    elif kind == 2:
        shape = pick(rng, [graph.input[0], graph.output[0]]).type.tensor_type.shape
        pick(rng, shape.dim).dim_value = int(rng.integers(100))
    elif kind == 3:
        pick(rng, [graph.input[0], graph.output[0]]).type.tensor_type.elem_type = pick(rng, [7, 11])
    elif kind == 4:
        tensor = pick(rng, graph.initializer)
        tensor.raw_data = rng.bytes(len(tensor.raw_data))
    elif kind == 5:
        graph.node.remove(node)
    else:
        tensor = pick(rng, graph.initializer)
        if tensor.dims:
            tensor.dims[0] = int(rng.integers(10**9))
    return model.SerializeToString()
