"""A scene in the browser: a server that needs no screen, a slider over time, rods to build with."""

import time
from typing import Any

import numpy as np

from benchmark.errors import CommandError
from benchmark.parts.extras import install_command

HOST = "127.0.0.1"
EVERY = 2
"""Moments from one that is played to the next."""
NARROW, LOWER = 0.6, 0.25
"""Width over height of a window whose controls are below; how far it looks down, over distance."""


class Browser:
    """A server that shows N moments of period `period_s`; a subclass's `show` poses one of them.

    Raises CommandError where viser is missing.
    """

    def __init__(self, count: int, period_s: float, port: int) -> None:
        try:
            import trimesh
            import viser
        except ImportError as error:
            raise CommandError(
                f"--live needs the package '{error.name}'; install it with: "
                f"{install_command('live')}"
            ) from error
        self._shapes, self._viser = trimesh.creation, viser
        self._count, self._period_s = count, period_s
        self.server = viser.ViserServer(HOST, port, label="stickbench", verbose=False)
        self.nodes: dict[str, Any] = {}

    @property
    def url(self) -> str:
        """Where it is seen."""
        return f"http://{HOST}:{self.server.get_port()}"

    def show(self, moment: int) -> None:
        """Pose everything as it was at a moment."""
        raise NotImplementedError

    def play(self) -> None:
        """Go through the moments in real time, over and over, until Ctrl-C."""
        try:
            while True:
                time.sleep(EVERY * self._period_s)
                if self.playing.value:
                    self.slider.value = (self.slider.value + EVERY) % self._count
        except KeyboardInterrupt:
            self.server.stop()

    def _look(self, eye_m: Any, at_m: Any) -> None:
        """See `at_m` from `eye_m` [m]; in a narrow window farther away, and above the controls."""
        self.server.initial_camera.position = tuple(eye_m)
        self.server.initial_camera.look_at = tuple(at_m)

        def fit(client: Any) -> None:
            if client.camera.aspect < NARROW:
                away = NARROW / client.camera.aspect * np.subtract(eye_m, at_m)
                below = np.array(at_m) - [0, 0, LOWER * np.linalg.norm(away)]
                client.camera.position, client.camera.look_at = below + away, below

        self.server.on_client_connect(fit)

    def _add_controls(self, title: str, moment: str) -> None:
        gui = self.server.gui
        gui.add_markdown(title.replace("\n", "\n\n"))
        self.playing = gui.add_checkbox("play", True)
        self.slider = gui.add_slider(moment, 0, self._count - 1, 1, 0)
        self.slider.on_update(lambda _: self.show(int(self.slider.value)))

    def _pose(self, name: str, origin: Any, rotation: Any) -> None:
        """Place a frame by its origin and its rotation matrix."""
        self.nodes[name].position = origin
        self.nodes[name].wxyz = self._viser.transforms.SO3.from_matrix(rotation).wxyz

    def _add_frame(self, name: str) -> None:
        """A frame that carries what is added under its name."""
        self.nodes[name] = self.server.scene.add_frame(f"/{name}", show_axes=False)

    def _add_rod(
        self, name: str, start: Any, end: Any, radius_m: float, color: Any, **look: Any
    ) -> None:
        """A rod with round ends; `look` are further keywords of a mesh."""
        look["color"] = color
        sides, splits = (8, 1) if look.get("wireframe") else (32, 2)
        if np.linalg.norm(np.subtract(end, start)) > 0:
            rod = self._shapes.cylinder(radius_m, segment=[start, end], sections=sides)
            self.server.scene.add_mesh_simple(f"{name}/rod", rod.vertices, rod.faces, **look)
        for number, at in enumerate((start, end)):
            ball, round_end = f"{name}/end{number}", self._shapes.icosphere(splits, radius_m)
            shape = round_end.vertices, round_end.faces
            self.server.scene.add_mesh_simple(ball, *shape, **look, position=tuple(at))
