"""YAML files that people write: plain data, bounded in size and depth, no key given twice.

Whatever cannot be read is one line: what is wrong, where, and what is allowed. Dates stay text.
"""

from pathlib import Path
from typing import Any

import yaml
from yaml.constructor import ConstructorError

from files.bounded import FileError, one_line, read_text

MOST_BYTES = 1_000_000
"""Largest file that is read."""
MOST_VALUES = 100_000
"""Most values in a file, aliases counted as often as they are used."""
MOST_DEPTH = 50
"""Deepest nesting."""
MERGE = "tag:yaml.org,2002:merge"
"""Tag of `<<`, which takes over the keys of another mapping."""


class _Loader(yaml.SafeLoader):
    """Plain data; a key that is given twice is an error, a date is text."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        """The mapping; raises ConstructorError for a key that is given twice, or is no name."""
        seen: set[object] = set()
        for place, _ in node.value:
            if place.tag == MERGE:
                continue
            key = self.construct_object(place, deep=True)
            if isinstance(key, list | dict):
                raise ConstructorError(None, None, "a key is no name", place.start_mark)
            if key in seen:
                said = f"{str(key)[:40]!r} is given twice"
                raise ConstructorError(None, None, said, place.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in found if tag != "tag:yaml.org,2002:timestamp"]
    for first, found in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def read_plain_yaml(path: Path) -> Any:
    """The data of a YAML file; raises FileError, or FileNotFoundError where there is none."""
    try:
        data = yaml.load(read_text(path, MOST_BYTES), Loader=_Loader)  # noqa: S506 - safe
        _refuse_large(path, data)
        return data
    except (FileError, FileNotFoundError):
        raise
    except RecursionError as error:
        raise FileError(f"{path} is nested too deeply") from error
    except yaml.MarkedYAMLError as error:
        where = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        what = one_line(error.problem or str(error))
        raise FileError(f"{path} cannot be read as YAML: {where}{what}") from error
    except (yaml.YAMLError, ValueError) as error:
        raise FileError(f"{path} cannot be read as YAML: {one_line(str(error))}") from error


def _refuse_large(path: Path, data: Any) -> None:
    """Raise FileError where the data has too many values, or nests too deeply."""
    count, waiting = 0, [(data, 0)]
    while waiting:
        value, depth = waiting.pop()
        count += 1
        if count > MOST_VALUES or depth > MOST_DEPTH:
            raise FileError(
                f"{path} has more than {MOST_VALUES} values (aliases counted as often as they are "
                f"used), or more than {MOST_DEPTH} levels"
            )
        inner = value.values() if isinstance(value, dict) else value
        if isinstance(value, list | dict):
            waiting.extend((one, depth + 1) for one in inner)
