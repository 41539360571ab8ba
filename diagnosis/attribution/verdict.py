"""From fits to a verdict: an effect, a pair, `none` or `unknown`, by rules frozen in rules.yaml."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict

from backends.effect import Effect
from diagnosis.attribution.attribute import Attribution, Ranked
from diagnosis.attribution.evidence import Evidence

NONE, UNKNOWN = "none", "unknown"


class Rules(BaseModel):
    """Thresholds, tuned on cases that no test uses; a cost is in nats, a gap in deviations."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    version: int
    floor_position_rad: float
    """The model's own error of positions: from nominal worlds of other equations."""
    floor_torque_share: float
    """The same of torques, as a share of the torque limit."""
    accuse_nats: float
    """An effect must lower the cost of the nominal refit by this."""
    pair_nats: float
    """A second effect must lower the cost of the first by this."""
    pair_share: float
    """A second effect must explain this share of what the first left over the floor."""
    explained_share: float
    """A verdict must explain this share of the held-out gap, else it is `unknown`."""
    settled_gap: float
    """Held-out gap that counts as explained whatever it was before."""
    nominal_stds: float
    """A nominal parameter is accused beyond so many of its standard deviations."""
    tie_nats: float
    """Effects whose cost is this near the best are not told apart."""
    confidence: tuple[float, float]
    """Confidence is the logistic function of a + b log(lead in nats)."""


@cache
def rules() -> Rules:
    """The frozen rules."""
    path = Path(__file__).with_name("rules.yaml")
    return Rules.model_validate(yaml.safe_load(path.read_text()))


@dataclass(frozen=True, kw_only=True)
class LimbVerdict:
    """What one limb's evidence says."""

    names: tuple[str, ...]
    """Effects, or `none`, or `unknown`."""
    chosen: Ranked
    """The fit behind the verdict; the nominal one for `none`, the best found for `unknown`."""
    attribution: Attribution
    tied: tuple[Ranked, ...]
    """Single effects that this evidence cannot tell from the chosen one."""
    lead_nats: float
    """How far the verdict is ahead of the next one."""

    @property
    def confidence(self) -> float:
        """Probability that the verdict is right."""
        a, b = rules().confidence
        return float(1 / (1 + np.exp(-(a + b * np.log(max(self.lead_nats, 1e-3))))))


def judge(
    evidence: Evidence, catalogue: Mapping[str, type[Effect]], uncertainty: float
) -> LimbVerdict:
    """The verdict on one limb."""
    found, rule = Attribution(evidence, catalogue, uncertainty), rules()
    beyond = [r for r in found.singles if _beyond_nominal(found, r, rule)]
    singles = sorted(beyond or found.singles, key=lambda r: r.fit.cost)
    best, nominal = singles[0], found.nominal
    gain = nominal.fit.cost - best.fit.cost
    if gain < rule.accuse_nats or not beyond:
        name = NONE if nominal.gap <= rule.settled_gap else UNKNOWN
        return _verdict((name,), nominal, found, (), rule.accuse_nats - gain)
    if best.gap > rule.settled_gap or best.strain > rule.pair_nats:
        pairs = sorted(found.second(best), key=lambda r: r.fit.cost)
        if pairs and _adds(best, pairs[0], rule) and _explains(nominal, pairs[0], rule):
            lead = best.fit.cost - pairs[0].fit.cost
            return _verdict(pairs[0].names, pairs[0], found, (), lead)
    if not _explains(nominal, best, rule):
        return _verdict((UNKNOWN,), best, found, (), gain)
    tied = tuple(r for r in singles[1:] if r.fit.cost - best.fit.cost < rule.tie_nats)
    lead = min([r.fit.cost - best.fit.cost for r in singles[1:]] + [gain])
    return _verdict(best.names, best, found, tied, lead)


def _verdict(
    names: tuple[str, ...],
    chosen: Ranked,
    found: Attribution,
    tied: tuple[Ranked, ...],
    lead: float,
) -> LimbVerdict:
    return LimbVerdict(
        names=names, chosen=chosen, attribution=found, tied=tied, lead_nats=float(lead)
    )


def _beyond_nominal(found: Attribution, ranked: Ranked, rule: Rules) -> bool:
    """Whether an effect is more than a nominal parameter within its uncertainty."""
    effect = ranked.fit.effects[-1]
    stds = [n.std for n in found.fitter.nuisances if n.kind is type(effect)]
    return not stds or abs(effect.magnitude) > rule.nominal_stds * min(stds)


def _excess(gap: float) -> float:
    """What a gap has above the floor, squared."""
    return max(gap**2 - 1.0, 0.0)


def _explains(nominal: Ranked, candidate: Ranked, rule: Rules) -> bool:
    if candidate.gap <= rule.settled_gap:
        return True
    allowed = (1 - rule.explained_share) * _excess(nominal.gap) + candidate.unrest**2
    return _excess(candidate.gap) <= allowed


def _adds(first: Ranked, pair: Ranked, rule: Rules) -> bool:
    """Whether a second effect is needed: by held-out samples, or by what it asks of the nominal."""
    gain = first.fit.cost - pair.fit.cost
    by_data = _excess(pair.gap) <= (1 - rule.pair_share) * _excess(first.gap)
    by_prior = first.strain - pair.strain >= 0.5 * rule.pair_nats
    return gain >= rule.pair_nats and (by_data or by_prior)
