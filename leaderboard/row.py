"""One result row in its file: `run.json`, checked, independent of what produced it.

This file knows the layout of `run.json` and its allowed values. It must not know an engine, a task
or a learner, so that rows of unknown plug-ins can be read.
"""

import math
import re
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from leaderboard.details import SCORES
from leaderboard.identity import (
    BUDGET,
    EPISODES,
    SMOKE_EPISODES,
    learner_name,
    row_key,
    run_digest,
)

Fraction = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=0)]
Name = Annotated[str, Field(min_length=1)]
FIRST = datetime(2025, 1, 1, tzinfo=UTC)
"""No run is older [date]."""
RATE_DIGIT, WALL_DIGIT_S = 0.1, 0.01
"""Last digits of `env_steps_per_s` and `wall_s`."""
ROUNDING = 1e-5
"""Largest relative error of the mean of kept scores, which have six digits each."""


def without_place(command: str) -> str:
    """A command without --out, whose folder exists on one machine only."""
    return re.sub(r"\s+--out(=|\s+)('[^']*'|\S+)", "", command)


class _Part(BaseModel):
    """A part of `run.json`; unknown fields are kept."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, allow_inf_nan=False)


class RunIdentity(_Part):
    """What was run."""

    backend: Name
    hand: Name
    stick: Name
    effects: str
    task: Name
    radius_m: Positive
    """Size of the figure [m]."""
    speed: Positive
    """Pace of the figure over the training pace."""
    observation: Name
    algo: Name
    steps: Count
    """Training budget in environment steps."""
    until: Name = BUDGET
    """When training ends, see `identity.ENDS`."""
    seed: Count
    randomize: bool
    spread: str = "paper"
    """Spread of the worlds drawn in training around the nominal one."""
    start_spread: Fraction = 1.0
    """Width of the initial states drawn in training; 0: a single one."""
    worlds: Count
    smoke: bool
    overrides: dict[str, Any] = {}
    """Hyperparameters of the learner that differ from its defaults."""
    start_sha256: str | None = None
    """The policy that training started from; None: a fresh one."""

    @property
    def learner(self) -> str:
        """The algorithm with what is not its default, such as 'sb3-ppo lr=0.0003'."""
        return learner_name(self.algo, self.overrides, self.start_sha256, self.until)


class Scores(_Part):
    """Means over the evaluation's episodes."""

    p_err_cm: NotNegative
    """Error of the stick's lower end [cm]."""
    q_err_deg: Annotated[float, Field(ge=0, le=180)]
    """Error of the stick's axis [deg]."""
    held: Fraction
    """Fraction of the episode before the stick fell."""
    tracked: Fraction
    """Fraction of all reference steps with the stick held and both errors in bounds."""
    episodes: Annotated[int, Field(ge=1)]


class Episodes(_Part):
    """The same scores per episode; equal indices have equal initial states."""

    p_err_cm: list[NotNegative]
    q_err_deg: list[Annotated[float, Field(ge=0, le=180)]]
    held: list[Fraction]
    tracked: list[Fraction]


class Curve(_Part):
    """The learning curve: means over the training up to each number of steps."""

    steps: list[Count]
    reward: list[float]
    p_err_cm: list[NotNegative]
    q_err_deg: list[NotNegative]


class Provenance(_Part):
    """The provenance of the row."""

    command: Name
    versions: dict[str, str]
    cpu: str
    cores: Count
    commit: str
    platform: str
    finished: str
    """When the run ended, ISO 8601."""

    @field_validator("finished")
    @classmethod
    def _is_past(cls, value: str) -> str:
        moment = datetime.fromisoformat(value)
        moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        if not FIRST <= moment <= datetime.now(UTC) + timedelta(days=1):
            raise ValueError("Input should be a time since 2025 that is past")
        return value

    @field_validator("command")
    @classmethod
    def _without_place(cls, value: str) -> str:
        return without_place(value)


class Row(_Part):
    """One run."""

    schema_version: Literal[1] = Field(alias="schema")
    status: Literal["done", "diverged", "skipped", "interrupted"]
    reason: str
    spec: RunIdentity
    digest: Name
    """Digest of the run's identity; runs with equal digests are the same."""
    spec_digest: Name
    """The nominal world's digest: hand, stick and effects."""
    scores: Scores | None
    """None unless the run is done."""
    episodes: Episodes | None = None
    """None if only means were kept."""
    curve: Curve | None = None
    """None if none was kept, and for baselines that do not train."""
    steps: Count
    """Environment steps trained."""
    wall_s: NotNegative
    env_steps_per_s: NotNegative
    policy_sha256: str | None
    provenance: Provenance

    @property
    def key(self) -> str:
        """What the row claims: the run, its policy and its scores."""
        scores = self.scores.model_dump(mode="json") if self.scores else {}
        return row_key(self.digest, self.policy_sha256, scores)

    @model_validator(mode="after")
    def _is_possible(self) -> "Row":
        """Refuse a row whose digest is another run's, or whose parts cannot be true together."""
        spec = self.spec.model_dump(mode="json", exclude_unset=True)
        if self.digest != run_digest(spec, self.spec_digest):
            raise ValueError(f"digest is {self.digest!r}, which is not that of this spec and world")
        if self.scores is not None and self.scores.tracked > self.scores.held + ROUNDING:
            raise ValueError(
                f"tracked is {self.scores.tracked:g}, held {self.scores.held:g}; allowed: tracked "
                "at most held, for a dropped stick is not tracked"
            )
        if self.status == "done" and self.spec.steps > 0 and self.policy_sha256 is None:
            raise ValueError("policy_sha256 is None; allowed: that of the trained policy")
        if self.status == "done":
            self._was_run()
        return self

    def _was_run(self) -> None:
        """Raise ValueError for numbers that no finished run of this spec can have."""
        if self.steps < self.spec.steps and self.spec.until == BUDGET:
            raise ValueError(f"steps is {self.steps}; allowed: the run's {self.spec.steps} or more")
        count = SMOKE_EPISODES if self.spec.smoke else EPISODES
        if self.scores is not None and self.scores.episodes != count:
            raise ValueError(f"scores.episodes is {self.scores.episodes}; allowed: {count}")
        rate, wall_s = self.env_steps_per_s, self.wall_s
        if wall_s == 0 or self.steps > (rate + RATE_DIGIT) * (wall_s + WALL_DIGIT_S):
            raise ValueError(
                f"wall_s is {wall_s:g}, in which {self.steps} steps were trained at {rate:g} a "
                "second; allowed: that time or more, which is above 0"
            )

    @field_validator("scores", mode="before")
    @classmethod
    def _only_of_done_runs(cls, value: object, info: ValidationInfo) -> object:
        done = info.data.get("status") == "done"
        if done and value is None:
            raise ValueError("Input should be the scores, for the run is done")
        return value if done else None

    @field_validator("episodes")
    @classmethod
    def _of_these_scores(cls, value: Episodes | None, info: ValidationInfo) -> Episodes | None:
        scores = info.data.get("scores")
        if value is None or scores is None:
            return None
        for name in SCORES:
            kept, mean = getattr(value, name), getattr(scores, name)
            if len(kept) != scores.episodes:
                raise ValueError(f"{scores.episodes} values of {name}, not {len(kept)}")
            if abs(math.fsum(kept) / len(kept) - mean) > ROUNDING * max(kept):
                raise ValueError(f"values of {name} whose mean is {mean:g}, that of the scores")
        return value

    @field_validator("curve")
    @classmethod
    def _of_equal_lengths(cls, value: Curve | None) -> Curve | None:
        if value is not None and len({len(v) for v in value.model_dump().values()}) > 1:
            raise ValueError("lists of equal length")
        return value
