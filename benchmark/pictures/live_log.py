"""A log in the browser: the robot as measured, nominal and corrected, residuals below a slider."""

from typing import Any

import numpy as np

from backends.kinematics import body_frames
from backends.state import Array
from benchmark.gap.overlay import CORRECTED, NOMINAL, Overlay
from benchmark.pictures._live_browser import Browser
from diagnosis.logs._columns import SHOWN

MEASURED = "measured"
COLORS = {MEASURED: (60, 63, 68), NOMINAL: (230, 120, 30), CORRECTED: (25, 76, 217)}
THICKNESS = {MEASURED: 1.0, NOMINAL: 1.3, CORRECTED: 1.15}
"""Of links; the simulated ones are wires around the measured one, so that each can be seen."""
LINK_SHARE = 0.04
"""Radius of a link over the reach of the robot."""
EYE, FAR = np.array([1.5, -2.0, 0.9]), 1e-4
"""Where it is seen from, over its reach; and what is a length at all [m]."""


class LiveLog(Browser):
    """Shows the free-air episodes of a log, one after the other."""

    def __init__(self, overlay: Overlay, title: str, port: int) -> None:
        super().__init__(len(overlay.time_s), _period_s(overlay), port)
        self._overlay = overlay
        measured = np.where(np.isnan(overlay.measured), overlay.worlds[NOMINAL], overlay.measured)
        self._frames = {
            name: body_frames(overlay.spec.hand, np.nan_to_num(angle))
            for name, angle in {MEASURED: measured, **overlay.worlds}.items()
        }
        points = self._points()
        center = (points.min(axis=0) + points.max(axis=0)) / 2
        self._reach_m = float(np.linalg.norm(points - center, axis=1).max())
        self._look(center + EYE * self._reach_m, center)
        for name in self._frames:
            self._add_robot(name)
        self._add_controls(f"{title}\n{_legend(self._frames)}", "moment")
        self.at = self.server.gui.add_markdown("")
        joints = overlay.spec.hand.joint_names
        self.joint = self.server.gui.add_dropdown("joint", joints, initial_value=self._worst())
        self.joint.on_update(lambda _: self._draw())
        self.residuals: Any = None
        self._drawn: tuple[int, str] | None = None
        self.show(0)

    def show(self, moment: int) -> None:
        """Pose the robots as they were at a moment, and draw the residuals of its episode."""
        for name, frames in self._frames.items():
            for body, (origin, rotation) in frames.items():
                self._pose(f"{name}/{body}", origin[moment], rotation[moment])
        self._now = moment
        number = int(self._overlay.episode[moment])
        protocol, time_s = self._overlay.protocols[number], self._overlay.time_s[moment]
        self.at.content = f"episode {number} ({protocol}), {time_s:.2f} s"
        self._draw()

    def _draw(self) -> None:
        """The residuals of one joint in the episode that is shown."""
        over, number = self._overlay, int(self._overlay.episode[self._now])
        joint = str(self.joint.value)
        if self._drawn == (number, joint):
            return
        self._drawn = number, joint
        rows, j = over.episode == number, over.spec.hand.joint_names.index(joint)
        size, unit, _ = SHOWN[over.spec.hand.driven[j].joint.slides]
        off = [size * (over.measured[rows, j] - w[rows, j]) for w in over.worlds.values()]
        data = (over.time_s[rows], *off)
        if self.residuals is not None:
            self.residuals.data = data
            return
        uplot = self._viser.uplot
        lines = [
            uplot.Series(label=name, stroke=f"rgb{COLORS[name]}", width=1.5) for name in over.worlds
        ]
        self.residuals = self.server.gui.add_uplot(
            data,
            (uplot.Series(label="s"), *lines),
            scales={"x": uplot.Scale(time=False)},
            title=f"measured - simulated [{unit}]",
            aspect=2.2,
        )

    def _add_robot(self, name: str) -> None:
        radius_m = LINK_SHARE * self._reach_m * THICKNESS[name]
        for body in self._overlay.spec.hand.bodies:
            self._add_frame(f"{name}/{body.name}")
            for number, end in enumerate(self._ends(body.name)):
                at = f"/{name}/{body.name}/{number}"
                wire = name != MEASURED
                self._add_rod(at, np.zeros(3), end, radius_m, COLORS[name], wireframe=wire)

    def _points(self) -> Array:
        """Where joints and ends of the robot ever are [m], shape (n, 3)."""
        frames = self._frames[MEASURED].items()
        ends = [o + r @ end for name, (o, r) in frames for end in self._ends(name)]
        return np.concatenate([*(origin for _, (origin, _) in frames), *ends])

    def _ends(self, name: str) -> list[Array]:
        """Where the rods of a body end, in its frame: at the next bodies, else past its centre."""
        hand = self._overlay.spec.hand
        ends = [np.array(b.origin_m) for b in hand.bodies if b.parent == name]
        ends += [np.array(tip.center_m) for tip in hand.fingertips if tip.body == name]
        ends = [end for end in ends if np.linalg.norm(end) > FAR]
        (body,) = [b for b in hand.bodies if b.name == name]
        return ends or [2 * np.array(body.com_m)]

    def _worst(self) -> str:
        """The joint that the nominal world is furthest from."""
        over = self._overlay
        off = np.nanmean((over.measured - over.worlds[NOMINAL]) ** 2, axis=0)
        return over.spec.hand.joint_names[int(np.nanargmax(off))]


def _period_s(overlay: Overlay) -> float:
    return float(np.median(np.diff(overlay.time_s)))


def _legend(names: Any) -> str:
    """Which color is which robot."""
    words = (f'<span style="color:rgb{COLORS[name]}">&#9632; {name}</span>' for name in names)
    return " ".join(words)
