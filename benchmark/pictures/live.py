"""A run in the browser: hand, stick, taxels, reference and trace, with a slider over time.

Any engine's run is shown the same way, from the state that every engine reports; nothing is
simulated here and no screen is needed.
"""

import numpy as np

from backends import kinematics
from backends.spec import Hand
from backends.state import Array
from backends.touch import taxel_grid
from benchmark.pictures._live_browser import Browser
from benchmark.pictures._replay import Recording

LINK_M, BALL_M, TAXEL_M = 0.0075, 0.003, 0.0012
"""Drawn radii [m]."""
_DARK, _PAD, _WOOD = (60, 63, 68), (140, 185, 240), (205, 158, 92)
_RED, _BLUE, _IDLE = (230, 30, 25), (25, 76, 217), (56, 94, 148)
_EYE_M, _LOOK_AT_M = (0.33, -0.09, 0.13), (0.035, 0.002, -0.052)


class Live(Browser):
    """Shows episode 0 of a recording."""

    def __init__(self, recording: Recording, title: str, port: int) -> None:
        super().__init__(len(recording.time_s), recording.spec.timing.policy_s, port)
        self._recording = recording
        self._hand: Hand = recording.spec.hand
        states = recording.states
        self._frames = kinematics.body_frames(self._hand, states.joint_rad)
        self._taxels_m = _taxels(self._hand, states.joint_rad)
        self._look(_EYE_M, _LOOK_AT_M)
        self._add_bodies()
        self._add_paths()
        self._add_controls(title, "step of 20 ms")
        self.show(0)

    def show(self, moment: int) -> None:
        """Pose everything as it was after a step."""
        recording, state = self._recording, self._recording.states
        for name, (origin, rotation) in self._frames.items():
            self._pose(name, origin[moment], rotation[moment])
        self.nodes["stick"].position = state.stick_pos_m[moment]
        self.nodes["stick"].wxyz = state.stick_quat_wxyz[moment]
        self.nodes["reference"].position = recording.reference_m[moment, 0]
        self.nodes["trace"].points = _pieces(recording.lower_m[: moment + 2, 0])
        active = recording.touch.active[moment].ravel()
        self.nodes["taxels"].points = self._taxels_m[moment].astype(np.float32)
        self.nodes["taxels"].colors = np.where(active[:, None], _RED, _IDLE).astype(np.uint8)

    def _add_bodies(self) -> None:
        hand, stick = self._hand, self._recording.spec.stick
        for body in hand.bodies:
            self._add_frame(body.name)
            ends = [b.origin_m for b in hand.bodies if b.parent == body.name]
            ends += [tip.center_m for tip in hand.fingertips if tip.body == body.name]
            for number, end in enumerate(ends):
                if np.linalg.norm(end) > LINK_M:
                    self._add_rod(f"/{body.name}/{number}", np.zeros(3), end, LINK_M, _DARK)
        for tip in hand.fingertips:
            back = np.array(tip.center_m) - tip.length_m * np.array(tip.forward)
            name = f"/{tip.body}/{tip.finger}"
            self._add_rod(name, back, tip.center_m, tip.radius_m, _PAD, opacity=0.5)
        scene, half = self.server.scene, np.array([0, 0, stick.length_m / 2])
        self._add_frame("stick")
        self._add_rod("/stick/rod", -half, half, stick.radius_m, _WOOD)
        size = np.array(hand.palm_half_size_m) * 2
        scene.add_box("/palm", _DARK, tuple(size), position=hand.palm_center_m)

    def _add_paths(self) -> None:
        scene, recording = self.server.scene, self._recording
        figure = _pieces(recording.reference_m[recording.first :, 0])
        scene.add_line_segments("/figure", figure, _RED, thickness=0.001)
        first = _pieces(recording.lower_m[:2, 0])
        self.nodes["trace"] = scene.add_line_segments("/trace", first, _BLUE, thickness=0.0013)
        self.nodes["reference"] = scene.add_icosphere("/reference", BALL_M, _RED)
        points = self._taxels_m[0].astype(np.float32)
        self.nodes["taxels"] = scene.add_point_cloud(
            "/taxels", points, np.tile(_IDLE, (len(points), 1)), point_size=TAXEL_M
        )


def _taxels(hand: Hand, joint_rad: Array) -> Array:
    """Places of all taxels [m], world frame, shape (T, F taxels, 3)."""
    origin, rotation = kinematics.tip_frames(hand, joint_rad)
    grids = np.array([taxel_grid(tip, hand.taxels)[0] for tip in hand.fingertips])
    placed = origin[:, :, None] + np.einsum("nfij,ftj->nfti", rotation, grids)
    return placed.reshape(len(joint_rad), -1, 3)


def _pieces(path_m: Array) -> Array:
    """A path as pieces, shape (n, 2, 3)."""
    return np.stack([path_m[:-1], path_m[1:]], axis=1).astype(np.float32)
