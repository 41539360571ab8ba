"""What a diagnosis says of a log, as an object and as plain data."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from diagnosis.attribution.locate import Place
from diagnosis.attribution.magnitudes import Magnitude
from diagnosis.attribution.verdict import LimbVerdict
from diagnosis.beside.finding import Finding, Spot
from diagnosis.leading import Leading
from diagnosis.shrinkage import Share


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What a log says. Gaps are root mean squares over the noise, on held-out samples."""

    verdict: tuple[str, ...]
    joints: tuple[str, ...]
    magnitudes: tuple[Magnitude, ...]
    confidence: float
    ranking: tuple[dict, ...]
    """Per limb, what was tried: effects, joints, magnitudes, cost in nats and held-out gap."""
    indistinguishable: tuple[dict, ...]
    """Effects that this log cannot tell apart, and the experiment that would."""
    leading: tuple[Leading, ...]
    """What unknown gaps are mostly like; no part of the verdict."""
    unseen: tuple[str, ...]
    """Joints of which this log tells nothing."""
    where: tuple[Place, ...]
    gap_before: float
    gap_nominal: float
    """With the nominal parameters alone refitted: what a calibration reaches."""
    gap_after: float
    noise_floor: float
    shrinkage: Share
    """Of the squared gap above the floor, by the verdict."""
    shrinkage_nominal: Share
    """The same by the refit of nominal parameters alone."""
    gaps: Mapping[str, Share]
    """The gaps before, nominal and after with their intervals."""
    beside: tuple[Finding, ...]
    """Findings without replays of free air: sensors, lost packets, touch, stick, contact."""
    spots: tuple[Spot, ...]
    """What touch and stick show at every finger."""
    missing: tuple[str, ...]
    """Effects that could not be looked for, why, and what to record for them."""
    cpu_s: float
    """Of this process and those that it waited for [s]."""
    limbs: tuple[LimbVerdict, ...] = field(repr=False)
    """The verdicts behind, per limb, with everything that was fitted."""

    def row(self) -> dict:
        """As plain data, without the fits."""
        said = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "limbs"}
        return said | {
            "verdict": list(self.verdict),
            "joints": list(self.joints),
            "leading": [asdict(one) for one in self.leading],
            "unseen": list(self.unseen),
            "magnitudes": [asdict(m) for m in self.magnitudes],
            "where": [place.row() for place in self.where],
            "shrinkage": asdict(self.shrinkage),
            "shrinkage_nominal": asdict(self.shrinkage_nominal),
            "gaps": {name: asdict(gap) for name, gap in self.gaps.items()},
            "beside": [asdict(one) | {"confidence": one.confidence} for one in self.beside],
            "spots": [asdict(spot) for spot in self.spots],
            "missing": list(self.missing),
        }
