"""The robot, its effects and the physics engines; all other packages import this one."""

from pathlib import Path

from backends._compiled import forget_stale

_ROOT = Path(__file__).resolve().parents[1]
forget_stale(_ROOT / name for name in ("backends", "tasks", "diagnosis"))
