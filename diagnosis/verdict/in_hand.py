"""What is said of touch, stick and contact: causes, gaps at every finger, and what is missing."""

from collections.abc import Iterable
from dataclasses import dataclass

from backends.spec import Spec
from diagnosis.verdict.result import Cause

TOUCH, STICK = "touch", "stick"


@dataclass(frozen=True, kw_only=True)
class Spot:
    """What touch or stick show at one finger, root mean squares over the floor."""

    finger: str
    family: str
    """`touch` or `stick`."""
    gap_before: float
    gap_after: float


@dataclass(frozen=True, kw_only=True)
class Report:
    """Causes, where they show, and what a log does not tell."""

    causes: tuple[Cause, ...] = ()
    """`unknown` among them, where a gap has no name."""
    spots: tuple[Spot, ...] = ()
    missing: tuple[str, ...] = ()
    """Why effects could not be looked for, and what to record for them."""
    world: Spec | None = None
    """The nominal world with the shapes that were found, named or not; None: as it was."""

    def __add__(self, other: "Report") -> "Report":
        """Both, in this order; the world is the later one."""
        return Report(
            causes=(*self.causes, *other.causes),
            spots=(*self.spots, *other.spots),
            missing=(*self.missing, *other.missing),
            world=other.world or self.world,
        )


def missing(names: Iterable[str], why: str) -> tuple[str, ...]:
    """What to say of effects that could not be looked for; nothing of none."""
    said = ", ".join(names)
    return (f"{said}: {why}",) if said else ()
