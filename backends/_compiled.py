"""Clear numba's cache on disk when a source file changes.

Numba caches compiled code per function and checks only whether that function's own file has
changed. Code that it calls is compiled into it and may come from another file. Without this module,
the old code would still run after an update of that other file.
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path

NOTE = "__pycache__/compiled-from.sha256"


def forget_stale(folders: Iterable[Path]) -> bool:
    """Delete the compiled code in these folders if a Python file in them has changed.

    "Changed" means since the last call.

    Returns whether it deleted anything. A folder that cannot be written holds no cache either.
    """
    folders = list(folders)
    stats = ((path, path.stat()) for folder in folders for path in sorted(folder.rglob("*.py")))
    lines = "".join(f"{path} {stat.st_mtime_ns} {stat.st_size}\n" for path, stat in stats)
    digest, note = hashlib.sha256(lines.encode()).hexdigest(), folders[0] / NOTE
    try:
        if note.exists() and note.read_text() == digest:
            return False
        for index in (path for folder in folders for path in folder.rglob("*.nbi")):
            index.unlink(missing_ok=True)
        note.parent.mkdir(exist_ok=True)
        note.write_text(digest)
    except OSError:
        return False
    return True
