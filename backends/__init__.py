"""The robot, its effects and the physics engines; all other packages import this one."""

from pathlib import Path

from backends._compiled import forget_stale, use_writable_cache

_ROOT = Path(__file__).resolve().parents[1]
forget_stale(_ROOT / name for name in ("backends", "tasks", "diagnosis"))
use_writable_cache(Path(__file__).parent)
