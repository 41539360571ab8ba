"""Draw the run of any engine off-screen in a child process, frame by frame.

The OpenGL platform is chosen once per process, so each one is tried in its own child process: first
EGL, then OSMesa.
"""

import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from backends.spec import Spec
from backends.state import Array, State
from benchmark.errors import CommandError

LIMIT_S = 300
"""A child that takes longer than this for one frame counts as hanging [s]."""
PLATFORMS = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
"""OpenGL's platforms by MuJoCo's names, and Debian's packages of each."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is drawn: T steps of one episode, and the numbers of the frames."""

    spec: Spec
    states: State
    """Arrays (T, ...)."""
    active: Array
    """Active taxels, shape (T, F, taxels), bool."""
    reference_m: Array
    """Drawn point [m], world frame, shape (T, 3)."""
    lower_m: Array
    """Lower end of the stick [m], world frame, shape (T, 3)."""
    first: int
    """Step from which the reference is shown as a line."""
    frames: tuple[int, ...]
    """Steps to draw."""
    size: tuple[int, int]
    """Width and height [pixels]."""


class _DrawingError(CommandError):
    """The child process gave no frame."""


def render(scene: Scene) -> Iterator[Array]:
    """Each frame, shape (height, width, 3), uint8.

    Raises CommandError that names the packages where no OpenGL works.
    """
    reasons = []
    for platform in PLATFORMS:
        drawn = _in_child(scene, platform)
        try:
            first = next(drawn)
        except _DrawingError as error:
            reasons.append(f"{platform}: {error}")
            continue
        yield first
        yield from drawn
        return
    packages = " or ".join(f"apt-get install {name}" for name in PLATFORMS.values())
    raise CommandError(
        f"cannot draw off-screen ({'; '.join(reasons)}); on Debian install a package: {packages}"
    )


def _in_child(scene: Scene, platform: str) -> Iterator[Array]:
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(
            [sys.executable, "-P", "-m", "benchmark._scene"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            env={**os.environ, "MUJOCO_GL": platform, "PYOPENGL_PLATFORM": platform},
        )
        try:
            yield from _frames(scene, child)
        except (EOFError, BrokenPipeError) as error:
            errors.seek(0)
            lines = errors.read().decode(errors="replace").strip().splitlines()
            reason = lines[-1] if lines else f"no frame within {LIMIT_S} s"
            raise _DrawingError(reason) from error
        finally:
            child.kill()
            child.communicate()


def _frames(scene: Scene, child: subprocess.Popen) -> Iterator[Array]:
    """The frames of the child process; raises EOFError or BrokenPipeError if it ends early."""
    assert child.stdin is not None and child.stdout is not None
    pickle.dump(scene, child.stdin)
    child.stdin.flush()
    width, height = scene.size
    for _ in scene.frames:
        watchdog = threading.Timer(LIMIT_S, child.kill)
        watchdog.start()
        pixels = child.stdout.read(width * height * 3)
        watchdog.cancel()
        if len(pixels) < width * height * 3:
            raise EOFError
        yield np.frombuffer(pixels, np.uint8).reshape(height, width, 3)
