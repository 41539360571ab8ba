"""What numba keeps on disk, forgotten when a source changes.

Numba keeps compiled code by function and looks whether its file has changed. What a function calls
is compiled into it, though, and may stand in another file: after an update the old one would run.
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path

NOTE = "__pycache__/compiled-from.sha256"


def forget_stale(folders: Iterable[Path]) -> bool:
    """Forget compiled code in folders if a Python file in them has changed since the last call.

    Says whether it did. Where nothing can be written, nothing was kept either.
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
