"""The packages that `stickbench` takes names from are those beside it, not a user's files."""

import importlib.util
import sys
from pathlib import Path

_ROOMS = ("files", "backends", "tasks", "baselines", "diagnosis", "leaderboard", "benchmark")
_HERE = Path(__file__).parent.parent


def _home(room: str) -> Path | None:
    """The folder or the file that `import room` takes."""
    loaded = sys.modules.get(room)
    spec = importlib.util.find_spec(room) if loaded is None else loaded.__spec__
    origin = getattr(loaded, "__file__", None) if spec is None else spec.origin
    return Path(origin) if origin else None


def check() -> None:
    """Raise ImportError that names a file which hides one of the packages."""
    for room in _ROOMS:
        home = _home(room)
        if home is None or home.resolve() != (_HERE / room / "__init__.py").resolve():
            raise ImportError(
                f"{home or room} hides the package '{room}' of Stickbench; rename that file or "
                f"folder, or start the program with `python -P`, which leaves its folder out"
            )


check()
