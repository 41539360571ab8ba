"""Keep numba's compiled code on disk as long as its sources stay, and no longer.

Numba caches compiled code per function and checks only whether that function's own file has
changed. Code that it calls is compiled into it and may come from another file. Without this module,
the old code would still run after an update of that other file. A file's code is deleted when the
file, or one that it imports directly or not, has changed.

Compiled functions copy arrays in loops: to assign an array to a slice compiles numba's message
about shapes as well, which takes longer than most functions here.
"""

import ast
import atexit
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

NOTE = "__pycache__/compiled-from.json"


def forget_stale(folders: Iterable[Path]) -> bool:
    """Delete the compiled code in these folders whose sources have changed since the last call.

    Returns whether there was any. A folder that cannot be written holds no cache either.
    """
    folders = list(folders)
    root = folders[0].parent
    files = [path for folder in folders for path in sorted(folder.rglob("*.py"))]
    stats = "".join(f"{p} {s.st_mtime_ns} {s.st_size}\n" for p in files for s in [p.stat()])
    seen, note = hashlib.sha256(stats.encode()).hexdigest(), folders[0] / NOTE
    try:
        before = _read(note)
        if before.get("") == seen:
            return False
        sources = {str(p.relative_to(root)): d for p, d in _sources(files, root).items()}
        stale = [name for name in sources if before.get(name) != sources[name]]
        for index in (index for name in stale for index in _indices(root / name)):
            index.unlink(missing_ok=True)
        note.parent.mkdir(exist_ok=True)
        note.write_text(json.dumps({"": seen, **sources}))
    except OSError:
        return False
    return bool(stale)


def use_writable_cache(folder: Path) -> None:
    """Let numba cache in a temporary folder if it can write neither here nor for the user."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    places = (folder / "__pycache__", Path(home) / "numba")
    if "NUMBA_CACHE_DIR" in os.environ or any(map(_is_writable, places)):
        return
    temporary = tempfile.mkdtemp(prefix="stickbench-compiled-")
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = temporary


def _read(note: Path) -> dict[str, str]:
    try:
        return dict(json.loads(note.read_text()))
    except (FileNotFoundError, ValueError, TypeError):
        return {}


def _indices(path: Path) -> Iterator[Path]:
    """Numba's index files for the functions of a source file."""
    return (path.parent / "__pycache__").glob(f"{path.stem}.*.nbi")


def _sources(files: Iterable[Path], root: Path) -> dict[Path, str]:
    """A digest of each file with all files that it imports, directly or not."""
    named = {_module(path, root): path for path in files}
    texts = {path: path.read_bytes() for path in named.values()}
    imports = {path: set(_imports(texts[path], named)) for path in texts}
    return {
        path: hashlib.sha256(
            b"\0".join(texts[p] for p in sorted(_closed(path, imports)))
        ).hexdigest()
        for path in texts
    }


def _module(path: Path, root: Path) -> str:
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imports(text: bytes, named: Mapping[str, Path]) -> Iterator[Path]:
    """The files among those that are named, by module, that a source imports."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            modules = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        yield from (named[module] for module in modules if module in named)


def _closed(path: Path, imports: Mapping[Path, set[Path]]) -> set[Path]:
    found, waiting = {path}, [path]
    while waiting:
        new = imports[waiting.pop()] - found
        found |= new
        waiting.extend(new)
    return found


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
