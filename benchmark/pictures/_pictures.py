"""Write small pictures and videos; each contains its caption and the command that made it."""

import io
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from benchmark.errors import CommandError
from benchmark.parts.extras import install_command

PALETTE = 128
"""Number of colours of a PNG or GIF."""
SAMPLED = 4
"""Frames of a GIF that its colours are taken from."""


@dataclass(frozen=True, kw_only=True)
class Caption:
    """The texts that are stored in a picture."""

    title: str
    """What it shows."""
    source: str
    """The command that makes it."""


def write_figure(figure: Figure, caption: Caption, out: Path) -> None:
    """Write a plot as PNG."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=130)
    write_png(Image.open(drawn), caption, out)


def write_png(image: Image.Image, caption: Caption, out: Path) -> None:
    """Write a picture as PNG with few colours."""
    about = PngInfo()
    about.add_text("Title", caption.title)
    about.add_text("Source", caption.source)
    small = image.convert("RGB").quantize(PALETTE)
    _write(out, lambda path: small.save(path, format="PNG", optimize=True, pnginfo=about))


def write_mp4(frames: Iterable[np.ndarray], size: tuple[int, int], rate: float, out: Path) -> None:
    """Write frames (height, width, 3) uint8 as H.264 video."""
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise CommandError(
            f"{out.name} needs the package 'imageio-ffmpeg', which is not installed; install it "
            f"with: {install_command(__name__)}, or choose --out with .gif"
        ) from error

    def write(path: Path) -> None:
        options = {"fps": rate, "codec": "libx264", "output_params": ["-f", "mp4"]}
        writer = imageio_ffmpeg.write_frames(str(path), size, **options)
        writer.send(None)
        try:
            for frame in frames:
                writer.send(np.ascontiguousarray(frame))
        finally:
            writer.close()

    _write(out, write)


def write_gif(frames: Iterable[np.ndarray], rate: float, out: Path) -> None:
    """Write frames (height, width, 3) uint8 as an endless GIF.

    All have one palette and nothing is dithered, so that what stands still is stored once.
    """
    drawn = [Image.fromarray(frame) for frame in frames]
    some = np.hstack([np.asarray(one) for one in drawn[:: -(-len(drawn) // SAMPLED)]])
    palette = Image.fromarray(some).quantize(PALETTE)
    first, *others = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in drawn]
    options = {"save_all": True, "append_images": others, "duration": 1000 / rate, "loop": 0}
    _write(out, lambda path: first.save(path, format="GIF", **options))


def _write(out: Path, write: Callable[[Path], None]) -> None:
    """Write under a temporary name, then rename it into place."""
    out.parent.mkdir(parents=True, exist_ok=True)
    temporary = out.with_name(f".{out.name}.tmp")
    try:
        write(temporary)
        os.replace(temporary, out)
    finally:
        temporary.unlink(missing_ok=True)
