"""What there is of a kind of part, as its files say themselves."""

from collections.abc import Callable

from files.plugins import KINDS, parts
from leaderboard._grid import grid
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block


def _of(kind: str) -> Callable[[Kept], str]:
    def table(kept: Kept) -> str:
        """Each part by name, those of other packages left out."""
        own = {name: part for name, part in parts(KINDS[kind]).items() if part.package is None}
        return grid(("name", "what it is"), [(f"`{n}`", p.summary) for n, p in own.items()])

    table.__name__ = f"known_{kind}"
    return table


for _kind in ("backend", "task", "observation", "algo"):
    block(_of(_kind))
