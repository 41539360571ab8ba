"""Names that a mechanic would accept for a fault outside the catalogue, fixed before the draw.

A fault outside the catalogue is *seen* if the verdict is `unknown`. If an effect is named instead,
it is *near* if a mechanic who knows the true fault would accept the name, on its joint: lost motion
for lost motion, dry friction for dry friction, late for late. An effect says so itself
(`Effect.near`), and whether another name says the same of a robot (`Effect.same_as`).
"""

from collections.abc import Collection

from backends.catalogue import catalogue
from diagnosis.blind.plant import MAGNET_SLIP


def near(fault: str) -> tuple[str, ...]:
    """Names that a mechanic would accept for a fault; none of one that this catalogue knows not.

    A magnet that slips is a bias.
    """
    kind = catalogue().get(fault)
    if kind is None:
        return ("encoder-bias",) if fault == MAGNET_SLIP else ()
    return kind.near


def plain_names(names: Collection[str], channels: Collection[str]) -> list[str]:
    """Names in order, one for all that say the same of a robot with these channels."""
    return sorted(_plain(name, channels) for name in names)


def _plain(name: str, channels: Collection[str]) -> str:
    kind = catalogue().get(name)
    if kind is None or kind.same_as is None or kind.apart_by in channels:
        return name
    return kind.same_as


def is_near(fault: str, named: Collection[str]) -> bool:
    """Whether all names given instead of a fault are near it; False if none is given."""
    return bool(named) and set(named) <= set(near(fault))
