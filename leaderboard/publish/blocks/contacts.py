"""Why policies lose between engines, and how well mended engines predict the reference."""

from collections.abc import Iterator

import pandas as pd

from leaderboard._grid import grid
from leaderboard.causes import CELL, TOGETHER, WON
from leaderboard.publish.blocks.transfer import ENGINES, REFERENCE
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import world
from leaderboard.statistics import mean
from leaderboard.transfer import bootstrap, named
from leaderboard.transfer_text import interval

CAUSES = "circle-causes"
MENDED = ("circle-mended-bullet", "circle-mended-sapien")
TRAINED, UNMENDED = "circle-trained-mended", "bullet built"


@block
def causes(kept: Kept) -> str:
    """The difference that wins most of each loss back, and all at once where it is not enough."""
    head = ("trained in", "deployed in", "tracked", "difference", "switched", "won back", "all")
    return grid(head, [_row(cell) for cell in _cells(kept)])


@block
def causes_said(kept: Kept) -> str:
    """How many losses one difference explains."""
    cells = list(_cells(kept))
    first = [_alone(cell).iloc[0] for cell in cells]
    won = [line for line in first if line["won"] >= WON]
    sure = sum(line["won_low"] >= WON for line in won)
    names = pd.Series([line["difference"] for line in won]).value_counts()
    each = ", ".join(f"`{name}` {count}" for name, count in names.items())
    return (
        f"Of {len(cells)} losses of 0.1 or more, one named difference wins back at least {WON:g} "
        f"in {len(won)}: {each}. In {sure} of them its whole interval lies above that. "
        f"{cells[0]['seeds'].min()} seeds of {cells[0]['episodes'].min()} episodes each."
    )


@block
def ruled_out(kept: Kept) -> str:
    """What every difference wins back where none alone wins enough."""
    head = ("trained in", "deployed in", "difference", "switched", "won back")
    rows = [
        [world(line["train"]), world(line["deploy"]), *_what(line), interval(line, "won", 2)]
        for cell in _cells(kept)
        if _alone(cell).iloc[0]["won"] < WON
        for line in cell.to_dict("records")
    ]
    return grid(head, rows)


@block
def predicted(kept: Kept) -> str:
    """Scores in engines as they are and mended, beside those on the reference."""
    head = ("trained in", "world", "predicted", "on the reference", "off by")
    engines, rows = kept.episodes(ENGINES), []
    for mended in (kept.episodes(name) for name in MENDED):
        mended = mended[~mended["floor"]]
        known = engines[engines["episode"].isin(mended["episode"]) & ~engines["floor"]]
        for train in dict.fromkeys(mended["train"]):
            there = _tracked(known, train, REFERENCE)
            engine = train.split(" ")[0]
            new = [name for name in dict.fromkeys(mended["deploy"]) if "," in name]
            worlds = [(known, f"{engine} built"), *((mended, name) for name in new)]
            for frame, name in worlds:
                found = _tracked(frame, train, name)
                off = f"{found['tracked'] - there['tracked']:+.2f}"
                scores = (interval(found, "tracked", 2), interval(there, "tracked", 2))
                rows.append([world(train), f"`{name}`", *scores, off])
    return grid(head, rows)


@block
def trained(kept: Kept) -> str:
    """Scores of policies that were trained in an engine as it is, mended, and in the reference.

    Won back: of what the reference's own policies reach there more than the engine's.
    """
    engines, mended = (kept.episodes(name) for name in (ENGINES, TRAINED))
    known = engines[engines["episode"].isin(mended["episode"]) & ~engines["floor"]]
    mended = mended[~mended["floor"]]
    own, lost = (_tracked(known, w, REFERENCE)["tracked"] for w in (REFERENCE, UNMENDED))
    rows = []
    for frame, names in (
        (known, (UNMENDED,)),
        (mended, tuple(dict.fromkeys(mended["train"]))),
        (known, (REFERENCE,)),
    ):
        for name in names:
            home, there = (_tracked(frame, name, deploy) for deploy in (name, REFERENCE))
            won = f"{(there['tracked'] - lost) / (own - lost):.2f}"
            scores = (interval(home, "tracked", 2), interval(there, "tracked", 2))
            rows.append([f"`{name}`", *scores, won])
    return grid(("trained in", "at home", "on the reference", "won back"), rows)


def _tracked(episodes: pd.DataFrame, train: str, deploy: str) -> dict[str, float]:
    """`tracked` of the policies of a train world in another world, with its interval."""
    part = episodes[(episodes["train"] == train) & (episodes["deploy"] == deploy)]
    table = part.pivot(index="policy", columns="episode", values="tracked")
    return named("tracked", bootstrap(mean, table.to_numpy()))


def _cells(kept: Kept) -> Iterator[pd.DataFrame]:
    """The lines of each loss, the most that is won back first."""
    for _, cell in kept.causes(CAUSES).groupby(list(CELL), sort=False):
        yield cell


def _alone(cell: pd.DataFrame) -> pd.DataFrame:
    return cell[cell["difference"] != TOGETHER]


def _row(cell: pd.DataFrame) -> list[str]:
    line = _alone(cell).iloc[0].to_dict()
    together = cell[cell["difference"] == TOGETHER].to_dict("records")
    return [
        *(world(line["train"]), world(line["deploy"])),
        f"{line['home']:.2f} to {line['away']:.2f}",
        *_what(line),
        interval(line, "won", 2),
        interval(together[0], "won", 2) if together else "",
    ]


def _what(line: dict) -> tuple[str, str]:
    return f"`{line['difference']}`", line["switched"]
