"""All files that are made from results, in stages: later ones show what earlier ones wrote."""

from collections.abc import Callable, Iterator
from pathlib import Path

from leaderboard._whole import write_whole
from leaderboard.files import contents
from leaderboard.publish import blocks, figures, pictures  # noqa: F401 - some enter themselves
from leaderboard.publish.kept import Kept
from leaderboard.publish.markers import MarkerError, fill, has_blocks
from leaderboard.publish.registry import BLOCKS, PICTURES

IMAGES = "docs/results/images"
"""Folder that holds nothing but what is made here."""
Files = dict[str, bytes]
"""By their paths from the root."""


class PublishError(ValueError):
    """A page asks for what nobody gives; the message is complete."""


def write(root: Path) -> list[str]:
    """Write whatever is not as the results have it; the paths that changed."""
    changed = []
    for path, data in _everything(Kept(root)):
        if _read(root / path) != data:
            write_whole(root / path, data)
            changed.append(path)
    for path in _left_over(root):
        (root / path).unlink()
        changed.append(path)
    return changed


def stale(root: Path) -> list[str]:
    """What is wrong with each file that is not as the results have it, replayed pictures too."""
    wrong = [
        f"{path}: {'edited by hand or stale' if (root / path).exists() else 'missing'}"
        for path, data in _everything(Kept(root))
        if _read(root / path) != data
    ]
    left_over = [f"{path}: nothing makes it" for path in _left_over(root)]
    return [*wrong, *left_over, *figures.wrong(root)]


def _everything(kept: Kept) -> Iterator[tuple[str, bytes]]:
    """Path and content of every file; a stage is made when all before it were taken."""
    for stage in STAGES:
        yield from stage(kept).items()


def _transfers(kept: Kept) -> Files:
    return {
        f"leaderboard/transfer/{folder}/{name}": data
        for folder, files in (*kept.transfers.items(), *kept.explained.items())
        for name, data in files.items()
    }


def _board(kept: Kept) -> Files:
    files = contents(kept.board, kept.leaderboard)
    return {f"leaderboard/{name}": data for name, data in files.items()}


def _pictures(kept: Kept) -> Files:
    return {path: give(kept) for path, give in PICTURES.items()}


def _pages(kept: Kept) -> Files:
    def give(name: str) -> str:
        if name not in BLOCKS:
            raise MarkerError(f"no block '{name}'; known: {', '.join(sorted(BLOCKS))}")
        return BLOCKS[name](kept)

    filled = {}
    for path in pages(kept.root):
        text = path.read_text(encoding="utf-8")
        name = path.relative_to(kept.root).as_posix()
        try:
            filled[name] = fill(text, give).encode()
        except MarkerError as error:
            raise PublishError(f"{name}: {error}") from error
    return filled


STAGES: tuple[Callable[[Kept], Files], ...] = (_transfers, _pictures, _board, _pages)


def pages(root: Path) -> list[Path]:
    """The pages that hold blocks."""
    known = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    return [path for path in known if has_blocks(path.read_text(encoding="utf-8"))]


def _left_over(root: Path) -> list[str]:
    found = (path.relative_to(root).as_posix() for path in (root / IMAGES).glob("*"))
    return sorted(set(found) - set(PICTURES))


def _read(path: Path) -> bytes | None:
    return path.read_bytes() if path.exists() else None
