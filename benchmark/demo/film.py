"""Pictures of `bench demo`: one policy in several engines side by side, as video and as paths."""

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from PIL import Image, ImageDraw, ImageFont

from benchmark.pictures import _pictures
from benchmark.pictures._pictures import Caption
from benchmark.pictures._plots import add_legend, draw_paths
from benchmark.pictures._render import render
from benchmark.pictures._replay import Recording
from benchmark.pictures.view import counted, scene_of

PANEL_SIZE, TITLE_HEIGHT = (320, 432), 32
"""Width and height of one hand, and height of the line above it [pixels]; together whole blocks."""
EVERY = 2
"""Policy steps from one frame to the next."""
FILM_S = 10.0
"""Length of the film [s]: an episode of 6 s, slowed down."""
DRAWN = 6
"""Episodes whose paths are drawn."""
REACH_CM, TICK_CM = 8.0, 2.0
"""What lies farther from the grip is not drawn; the scale [cm]."""
_PAPER, _INK = (255, 255, 255), (40, 44, 52)


def draw_engines(
    recordings: Mapping[str, Recording], title: str, caption: Caption, out: Path
) -> None:
    """Draw reference and lower end of some episodes, engines side by side, to one scale."""
    figure = Figure(figsize=(3.6 * len(recordings), 4.4), layout="constrained")
    every = figure.subplots(1, len(recordings), squeeze=False)[0]
    reach_cm = []
    for axes, (engine, recording) in zip(every, recordings.items(), strict=True):
        reach_cm.append(draw_paths(axes, _first_episodes(recording)))
        axes.set_title(engine)
        axes.set(xlabel="X from the grip [cm]", aspect="equal")
    half = min(1.12 * max(reach_cm), REACH_CM)
    for axes in every:
        axes.set(xlim=(-half, half), ylim=(-half, half))
        axes.xaxis.set_major_locator(MultipleLocator(TICK_CM))
        axes.yaxis.set_major_locator(MultipleLocator(TICK_CM))
    every[0].set_ylabel("Y from the grip [cm]")
    add_legend(every[0])
    figure.suptitle(title, fontsize=11)
    _pictures.write_figure(figure, caption, out)


def _first_episodes(recording: Recording) -> Recording:
    shown = {
        name: getattr(recording, name)[:, :DRAWN] for name in ("lower_m", "reference_m", "held")
    }
    return dataclasses.replace(recording, **shown)


def film(recordings: Mapping[str, Recording], titles: Mapping[str, str], out: Path) -> None:
    """Episode 0 in every engine as a video of 10 s; raises CommandError without a renderer."""
    length = len(next(iter(recordings.values())).time_s)
    steps = tuple(range(0, length, EVERY))
    width = PANEL_SIZE[0] * len(recordings)
    size = (width, PANEL_SIZE[1] + TITLE_HEIGHT)
    banner = _banner([titles[engine] for engine in recordings])
    drawn = [render(scene_of(r, steps, PANEL_SIZE)) for r in recordings.values()]
    frames = counted(_side_by_side(drawn, banner), len(steps))
    _pictures.write_mp4(frames, size, len(steps) / FILM_S, out)


def _side_by_side(panels: list[Iterator[np.ndarray]], banner: np.ndarray) -> Iterator[np.ndarray]:
    for frames in zip(*panels, strict=True):
        yield np.vstack([banner, np.hstack(frames)])


def _banner(titles: list[str]) -> np.ndarray:
    """A line of text above each panel."""
    width = PANEL_SIZE[0]
    image = Image.new("RGB", (width * len(titles), TITLE_HEIGHT), _PAPER)
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(size=17)
    for number, title in enumerate(titles):
        where = (width * number + width // 2, TITLE_HEIGHT // 2)
        pen.text(where, title, fill=_INK, font=font, anchor="mm")
    return np.asarray(image)
