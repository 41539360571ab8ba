"""The thresholds of a diagnosis, frozen in rules.yaml."""

import math
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict


class Right(BaseModel):
    """Shares of verdicts that were right in former blind sets."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    effect: float
    """Of effects named on joints and sensors, each."""
    grasp: float
    """Of effects named on touch, stick and contact, each."""
    none: float
    """Of `none`, effects too small to be detected aside."""
    unknown: float
    """Of `unknown`."""


class Rules(BaseModel):
    """Thresholds, tuned on cases that no test uses; a cost is in nats, a gap in deviations."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    version: int
    floor_position_rad: float
    """The model's own error of positions: from nominal worlds of other equations."""
    floor_torque_share: float
    """The same of torques, as a share of the torque limit."""
    accuse_nats: float
    """An effect must lower the cost of the nominal refit by this, see `_lead`."""
    pair_nats: float
    """A second effect must lower the cost of the first by this, where the pair leaves noise."""
    firm_nats: float
    """Or else by this, and so must what is named beside lost packets or a parameter far from its
    prior."""
    pair_share: float
    """It must then also explain this share of what the first left over the floor, if anything."""
    white_sd: float
    """The innovations of an explained log are no further from white than this: in held-out
    residuals, or in every protocol once all are fitted."""
    wild_sd: float
    """An innovation is an outlier from so many deviations on."""
    wild_count: int
    """So many such samples are no noise: lost packets alone look white."""
    law_nats: float
    """Two regressors predict no more of what an explained log leaves. Beyond `settled_gap` a tenth
    of what effects take beside: 1 - `explained_share`."""
    uneven_sd: float
    """Where it leaves no more than the floor, no protocol is further from white than this."""
    uneven_share: float
    """Or than this share of how far it is with the nominal parameters alone."""
    explained_share: float
    """Or else an effect must explain this share of what a gap has beyond the floor."""
    exact_share: float
    """A law that is no model, see `is_modelled`, this share of what it has beyond noise; where it
    leaves no more than the floor, `explained_share` of that."""
    within_share: float
    """Where a model leaves no more than the floor: this share of what is beyond noise. And a pair
    in any case."""
    bent_stds: float
    """Beside the effect that explains a log, no nominal parameter is off by more of its standard
    deviations: where laws differ, some make up for it."""
    alone_stds: float
    """The same of the nominal world alone."""
    pair_stds: float
    """The same beside a pair."""
    settled_gap: float
    """Held-out gap that counts as none."""
    nominal_stds: float
    """A nominal parameter is accused beyond so many of its standard deviations."""
    sound_more: float
    """A log may leave so many times what the worst log of a sound mechanism does, and an effect be
    so many times as large as there: what is little differs by that from log to log."""
    sound_nats: float
    """An effect is there where it lowers the cost of the nominal refit by this."""
    sound_gap: float
    """Held-out gap beyond which a log is none of a sound mechanism: it would excuse any effect."""
    tie_nats: float
    """Effects whose cost is this near the best are not distinguished."""
    right: Right
    """What confidence is for a verdict that is far ahead, see `confidence`."""

    @property
    def floor(self) -> dict[str, float]:
        """The model's own error by channel, as `gather.gather` takes it."""
        position = self.floor_position_rad
        return {"position": position, "motor": position, "torque": self.floor_torque_share}


def confidence(right: float, behind_nats: Iterable[float]) -> float:
    """Probability of what is right with this share of the rivals that are so far behind it.

    Among rivals by the likelihoods (Burnham and Anderson, 2002, 2.9).
    """
    return right / (1 + sum(math.exp(-nats) for nats in behind_nats))


@cache
def rules() -> Rules:
    """The frozen rules."""
    path = Path(__file__).with_name("rules.yaml")
    return Rules.model_validate(yaml.safe_load(path.read_text()))
