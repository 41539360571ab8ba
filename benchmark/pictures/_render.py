"""Draw the hand and the stick of any engine off-screen, in a child process, picture by picture.

The OpenGL platform is chosen once per process, so each one is tried in its own child process: first
EGL, then OSMesa.
"""

import contextlib
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import IO

import numpy as np

from backends.spec import Spec
from backends.state import Array, State
from benchmark.errors import CommandError

LIMIT_S = 300
"""A child that takes longer than this for one frame counts as hanging [s]."""
PLATFORMS = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
"""OpenGL's platforms by MuJoCo's names, and Debian's packages of each."""


@dataclass(frozen=True, kw_only=True)
class Stage:
    """What stays the same from picture to picture."""

    spec: Spec
    size: tuple[int, int]
    """Width and height [pixels]."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """What one picture shows."""

    joint_rad: Array
    """Joint angles [rad], shape (J,)."""
    stick_pos_m: Array
    stick_quat_wxyz: Array
    active: Array
    """Active taxels, shape (F, taxels), bool."""
    reference_m: Array
    """Drawn point [m], world frame, shape (3,)."""
    line_m: Array
    """The figure [m], world frame, shape (L, 3)."""
    trail_m: Array
    """Where the stick's lower end has been, the latest last [m], world frame, shape (K, 3)."""


class _DrawingError(CommandError):
    """The child process gave no frame."""


class Painter:
    """A child process that draws one moment after the other; it lives until it is closed.

    Raises CommandError that names the packages where no OpenGL works.
    """

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._child: _Child | None = None

    def paint(self, moment: Moment) -> Array:
        """The picture, shape (height, width, 3), uint8."""
        if self._child is None:
            return self._first(moment)
        return self._child.paint(moment)

    def paint_all(self, moments: Iterable[Moment]) -> Iterator[Array]:
        """The picture of each moment; while one is looked at, the next is drawn."""
        first, *others = moments
        picture = self.paint(first)
        for moment in others:
            assert self._child is not None
            self._child.ask(moment)
            yield picture
            picture = self._child.picture()
        yield picture

    def close(self) -> None:
        """End the child process; a second call is harmless."""
        if self._child is not None:
            self._child.close()
        self._child = None

    def _first(self, moment: Moment) -> Array:
        """The first picture, by the first platform that gives one."""
        reasons = []
        for platform in PLATFORMS:
            child = _Child(self._stage, platform)
            try:
                pixels = child.paint(moment)
            except _DrawingError as error:
                reasons.append(f"{platform}: {error}")
                continue
            self._child = child
            return pixels
        packages = " or ".join(f"apt-get install {name}" for name in PLATFORMS.values())
        raise CommandError(
            f"cannot draw off-screen ({'; '.join(reasons)}); on Debian install a package: "
            f"{packages}"
        )


class _Child:
    """A process that draws on one platform."""

    def __init__(self, stage: Stage, platform: str) -> None:
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process
        self._size = stage.size
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "benchmark.pictures._scene"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env={**os.environ, "MUJOCO_GL": platform, "PYOPENGL_PLATFORM": platform},
        )
        self._todo: list[object] = [stage]

    def paint(self, moment: Moment) -> Array:
        """The picture; raises _DrawingError, after which the process has ended."""
        self.ask(moment)
        return self.picture()

    def ask(self, moment: Moment) -> None:
        """Let the process draw; `picture` must follow. Raises as `paint` does."""
        with self._guarded():
            assert self._process.stdin is not None
            for one in (*self._todo, moment):
                pickle.dump(one, self._process.stdin)
            self._todo.clear()
            self._process.stdin.flush()

    def picture(self) -> Array:
        """The picture that was asked for; raises as `paint` does."""
        (width, height), out = self._size, self._process.stdout
        with self._guarded():
            assert out is not None
            watchdog = threading.Timer(LIMIT_S, self._process.kill)
            watchdog.start()
            pixels = out.read(width * height * 3)
            watchdog.cancel()
            if len(pixels) < width * height * 3:
                raise EOFError
        return np.frombuffer(pixels, np.uint8).reshape(height, width, 3)

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """End the process with what goes wrong; what it said last is the reason."""
        try:
            yield
        except (EOFError, BrokenPipeError) as error:
            self._errors.seek(0)
            lines = self._errors.read().decode(errors="replace").strip().splitlines()
            self.close()
            raise _DrawingError(lines[-1] if lines else f"no frame within {LIMIT_S} s") from error
        except BaseException:
            self.close()  # half a picture may be on its way
            raise

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()
        self._errors.close()


@dataclass(frozen=True, kw_only=True)
class Scene:
    """T steps of one episode, and which of them are drawn."""

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

    def moment(self, step: int) -> Moment:
        """What the picture of a step shows."""
        return Moment(
            joint_rad=self.states.joint_rad[step],
            stick_pos_m=self.states.stick_pos_m[step],
            stick_quat_wxyz=self.states.stick_quat_wxyz[step],
            active=self.active[step],
            reference_m=self.reference_m[step],
            line_m=self.reference_m[self.first :],
            trail_m=self.lower_m[: step + 1],
        )


def render(scene: Scene) -> Iterator[Array]:
    """Each frame, shape (height, width, 3), uint8; raises as `Painter` does."""
    painter = Painter(Stage(spec=scene.spec, size=scene.size))
    try:
        yield from painter.paint_all(map(scene.moment, scene.frames))
    finally:
        painter.close()
