"""The answer of a diagnosis as plain data: to JSON and back."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pydantic import TypeAdapter

from diagnosis.plain_gap import PlainGap
from diagnosis.shrinkage import Gaps, Share
from diagnosis.signals import Signals
from diagnosis.verdict.result import Cause, LimbResult, Nominal, Spot
from diagnosis.where import Place


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What is wrong with a mechanism, by one log. Gaps are root mean squares in noise floors."""

    verdict: tuple[str, ...]
    """Names of effects; `none`; or `unknown`, where none explains a gap beyond the ordinary."""
    joints: tuple[str, ...]
    """Joints that the verdict is about."""
    magnitudes: tuple[Cause, ...]
    """What is named, with sizes, 90 % intervals and shares of the gap."""
    probability: float
    """Share of right answers among verdicts like this one."""
    sentences: tuple[str, ...]
    """The verdict in words."""
    share: float
    """Share of the squared gap beyond one floor that the causes take, on the worst limb."""
    left: float
    """The gap that is left."""
    ordinary: float
    """Up to this gap, what is left is ordinary."""
    ordinary_from: str
    """What that is known from: `robot`, `simulator` or `healthy logs`."""
    gaps: Gaps
    """The gap on seconds that the fits have not seen."""
    engine_gaps_rad: tuple[float, ...] = ()
    """Root mean square distance of all positions from the log's in the nominal engine, of a user's
    robot in plain MuJoCo: nominal and corrected [rad; of slides m]; or none."""
    in_mujoco: PlainGap | None = None
    """Of a user's robot, what these are of, and the time step that they are with."""
    shrinkage: Share
    """Share of the squared gap beyond one floor, over all joints, that the causes take there."""
    shrinkage_nominal: Share
    """The same for the nominal numbers alone, refitted within their uncertainty."""
    where: tuple[Place, ...]
    """Parts of the gap, the largest first."""
    corrected: dict[str, dict[str, float]] = field(repr=False)
    """Numbers of the corrected world that differ from the nominal one's, by joint and name in the
    spec [SI]. `two_masses` is 1 where a gear was put between rotor and link."""
    gravity_m_s2: tuple[float, float, float] | None = None
    """Gravity of the corrected world, where it is another."""
    limbs: tuple[LimbResult, ...] = field(repr=False)
    """By limb: its verdict, and what it rests on."""
    spots: tuple[Spot, ...]
    """Gaps of touch and stick at every finger."""
    missing: tuple[str, ...]
    """Effects that could not be judged, the reason, and what to record for them."""
    notes: tuple[str, ...]
    """What is wrong with the log itself."""
    signals: tuple[Signals, ...] = field(repr=False)
    """Excerpts of the joints that the verdict is about."""
    cpu_s: float
    """CPU time [s]."""
    stopped: bool = False
    """Whether it was stopped: it is of the fits so far, without touch."""

    @property
    def nominal(self) -> tuple[Nominal, ...]:
        """Nominal numbers that took part of the gap."""
        return tuple(one for limb in self.limbs for one in limb.nominal)

    def plain(self) -> dict[str, Any]:
        """As JSON has it: the fields, and what follows from them under the names of the format."""
        return asdict(self) | {
            "confidence": self.probability,
            "magnitudes": [
                asdict(one) | {"interval": [one.low, one.high]} for one in self.magnitudes
            ],
            "gap_before": self.gaps.before.value,
            "gap_nominal": self.gaps.nominal.value,
            "gap_after": self.gaps.after.value,
            "noise_floor": 1.0,
            "nominal_numbers": [asdict(one) for one in self.nominal],
            "ranking": [
                {"limb": list(limb.joints), **asdict(one)}
                for limb in self.limbs
                for one in limb.ranking
            ],
            "leading": [asdict(one) for limb in self.limbs for one in limb.leading],
            "indistinguishable": [
                {"effects": [*limb.verdict], "or": list(tie), "experiment": limb.experiment}
                for limb in self.limbs
                for tie in limb.tied
            ],
        }

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        from diagnosis.report.report import notebook

        return notebook(self)

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> "Diagnosis":
        """From JSON; raises ValueError where it is none."""
        return TypeAdapter(cls).validate_python(data)
