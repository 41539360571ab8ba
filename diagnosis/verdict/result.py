"""What is said of a log, as plain data: no arrays, no fits, to JSON and back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from backends.effect import UNITS, Effect
from diagnosis.verdict.sizes import ANYWHERE, Place, sized

NONE, UNKNOWN = "none", "unknown"
Z90 = 1.645
"""Half of a 90 % interval, in standard deviations."""
CLOSE_NATS = 1.35
"""Half of the 90 % point of a squared normal number: ends of an interval of a likelihood."""


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One effect, named or leading."""

    effect: str
    joint: str | None
    """None: all joints, or an effect that concerns none."""
    joints: tuple[str, ...]
    value: float
    """In `unit`; so are low and high, the ends of its 90 % interval."""
    low: float
    high: float
    unit: str
    share: float
    """Share of the gap that it takes by itself."""
    also: str = ""
    """The value in other words: from side to side, in radians, in counts of the encoder."""
    shape: tuple[str, ...] = ()
    """Effects of its family that give its law more shape on that joint: no causes themselves."""
    evidence: str = ""
    """What in the log says so, of touch and stick."""
    tied: tuple[str, ...] = ()
    """Effects on touch and stick that this log cannot distinguish from it."""

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Value, low and high in SI units or as shares."""
        per = UNITS[self.unit][1] if self.unit else 1.0
        return self.value * per, self.low * per, self.high * per


def cause(
    effect: str,
    sizes: Sequence[float],
    catalogue: Mapping[str, type[Effect]],
    *,
    joints: tuple[str, ...] = (),
    share: float = 0.0,
    evidence: str = "",
    tied: tuple[str, ...] = (),
    at: Place = ANYWHERE,
) -> Cause:
    """A cause of a value, low and high in SI units or as shares; `unknown` out of a catalogue.

    `at`: see `Evidence.place`.
    """
    return Cause(
        effect=effect if effect in catalogue else UNKNOWN,
        joint=joints[0] if len(joints) == 1 else None,
        joints=joints,
        share=share,
        evidence=evidence,
        tied=tied,
        **sized(catalogue.get(effect), sizes, at),
    )


@dataclass(frozen=True, kw_only=True)
class Nominal:
    """A nominal number that took part of the gap."""

    effect: str
    joint: str
    value: float
    """How far it moved, in `unit`: a share of the number in the file where that is not zero."""
    sd: float
    """Standard deviation of the fit alone, in `unit`."""
    unit: str


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """A set of causes that was tried."""

    causes: tuple[tuple[str, str | None], ...]
    """Effects and their joints."""
    share: float
    left: float
    """The largest gap of a joint that it leaves [floors]."""


@dataclass(frozen=True, kw_only=True)
class LimbResult:
    """What is said of one limb."""

    joints: tuple[str, ...]
    verdict: tuple[str, ...]
    """Names of effects, `none` or `unknown`."""
    causes: tuple[Cause, ...]
    """What is named."""
    leading: tuple[Cause, ...]
    """The first causes, whatever is named."""
    sensors: tuple[Cause, ...]
    """Findings about sensors and packets, beside the verdict."""
    share: float
    left: float
    ordinary: float
    ordinary_from: str
    probability: float
    ranking: tuple[Ranked, ...]
    tied: tuple[tuple[str, ...], ...]
    experiment: str | None
    gap_before: float
    gap_nominal: float
    gaps: dict[str, float]
    """By joint, what the tolerances leave [floors]."""
    nominal: tuple[Nominal, ...]
    runs: int
    sentences: tuple[str, ...] = ()
    law: str | None = None
    """What a drive may do that the log does not say, and that would close an unknown gap."""
    strain: float = 0.0
    """How much further off the nominal numbers would be together than a healthy robot's, in
    standard deviations; 0 where they are usual."""
