"""Stickbench from Python.

    import stickbench as sb

    env = sb.make("Eight", engine="bullet", render_mode="rgb_array")
    found = sb.diagnose(sb.read_log("arm"))

Names alone: what they do stands where they are made.
"""

from stickbench import _rooms  # noqa: F401, I001 - first: it names a file that hides a package
from benchmark.errors import CommandError, UsageError
from benchmark.runs.gym import make, make_vec
from benchmark.parts.registry import names
from diagnosis import Cause, Diagnosis, Log, LogError, diagnose, page, read_log
from leaderboard.frame import leaderboard

__all__ = [
    "Cause",
    "CommandError",
    "Diagnosis",
    "Log",
    "LogError",
    "UsageError",
    "diagnose",
    "leaderboard",
    "make",
    "make_vec",
    "names",
    "page",
    "read_log",
]
