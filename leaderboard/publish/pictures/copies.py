"""Pictures that lie elsewhere in the repository, where the pages can show them."""

from functools import partial

from leaderboard.paper import PAPER
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import picture

IMAGES = "docs/results/images"


@picture(f"{IMAGES}/transfer.png")
def heatmap(kept: Kept) -> bytes:
    """The matrix of train and deploy worlds."""
    return kept.transfers["circle-engines"]["heatmap.png"]


@picture(f"{IMAGES}/causes.png")
def causes(kept: Kept) -> bytes:
    """What wins back the losses between engines."""
    return kept.explained["circle-causes"]["causes.png"]


def drawn(task: str, kept: Kept) -> bytes:
    """A figure as the hand draws it; `make figures` makes it."""
    return (kept.leaderboard / "figures" / f"{task}.png").read_bytes()


for _task in PAPER:
    picture(f"{IMAGES}/{_task}.png")(partial(drawn, _task))
