"""The result of a diagnosis, as an object and as plain data."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from diagnosis.attribution.locate import Place
from diagnosis.attribution.magnitudes import Magnitude
from diagnosis.attribution.verdict import LimbVerdict
from diagnosis.finding import Finding, Spot
from diagnosis.leading import Leading
from diagnosis.shrinkage import Share


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The result of a diagnosis. Gaps are root mean squares over the noise, on held-out samples."""

    verdict: tuple[str, ...]
    joints: tuple[str, ...]
    magnitudes: tuple[Magnitude, ...]
    confidence: float
    ranking: tuple[dict, ...]
    """Per limb, the candidates: effects, joints, magnitudes, cost in nats and held-out gap."""
    indistinguishable: tuple[dict, ...]
    """Effects that this log cannot distinguish, and the experiment that would."""
    leading: tuple[Leading, ...]
    """The effects that are closest to unknown gaps; not part of the verdict."""
    unseen: tuple[str, ...]
    """Joints about which this log says nothing."""
    where: tuple[Place, ...]
    gap_before: float
    gap_nominal: float
    """The gap with only the nominal parameters refitted, as a calibration would."""
    gap_after: float
    noise_floor: float
    shrinkage: Share
    """Share of the squared gap above the noise floor that the verdict removes."""
    shrinkage_nominal: Share
    """The same for the refit of the nominal parameters alone."""
    gaps: Mapping[str, Share]
    """The gaps before, nominal and after, with their intervals."""
    beside: tuple[Finding, ...]
    """Findings without replays of free air: sensors, lost packets, touch, stick, contact."""
    spots: tuple[Spot, ...]
    """Gaps of touch and stick at every finger."""
    missing: tuple[str, ...]
    """Effects that could not be judged, the reason, and what to record for them."""
    cpu_s: float
    """CPU time of this process and its child processes [s]."""
    limbs: tuple[LimbVerdict, ...] = field(repr=False)
    """The verdicts per limb with all their fits."""

    def row(self) -> dict:
        """The result as plain data, without the fits."""
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
