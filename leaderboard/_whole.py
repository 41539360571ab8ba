"""Files that are written whole or not at all."""

import os
from collections.abc import Mapping
from pathlib import Path


def write_all(files: Mapping[str, bytes], folder: Path) -> list[Path]:
    """Write files into a folder, each to a neighbour that is then renamed; their paths."""
    for name, data in files.items():
        write_whole(folder / name, data)
    return [folder / name for name in files]


def write_whole(path: Path, data: bytes) -> None:
    """Write the whole file or none of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    neighbour = path.with_name(f".{path.name}.tmp")
    try:
        neighbour.write_bytes(data)
        os.replace(neighbour, path)
    finally:
        neighbour.unlink(missing_ok=True)
