"""The contents of log.yaml: the log's source, mechanism, units and episodes."""

import re
import reprlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import PurePath
from typing import Annotated, Literal, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    NonNegativeInt,
    StringConstraints,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic_core import ErrorDetails

from files.bounded import FileError

NOMINAL_UNCERTAINTY = 0.05
"""Relative uncertainty of the nominal parameters if none is given."""

Text = Annotated[str, StringConstraints(min_length=1, strip_whitespace=True)]
Name = Annotated[Text, BeforeValidator(lambda name: str(name) if type(name) is int else name)]
"""A joint's name, which may be a number."""
Amount = Annotated[FiniteFloat, Field(ge=0)]
Positive = Annotated[FiniteFloat, Field(gt=0)]


class LogError(ValueError):
    """A log cannot be used; the message says what was given, what is allowed and what to do."""


@contextmanager
def as_log_errors(before: str = "") -> Iterator[None]:
    """Say of a file that cannot be read, as a LogError, what is wrong with it."""
    try:
        yield
    except FileError as error:
        raise LogError(f"{before}{error}") from None


class Part(BaseModel):
    """A part of a file that a user may write: no field that is unknown."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Channel(Part):
    """A recorded quantity, such as 'position_rad': the columns of all joints with that name."""

    unit: str
    """Unit of the numbers: rad, m, Nm, N, rad/s, m/s, or 1 for contact yes or no."""
    rate_hz: Annotated[FiniteFloat, Field(gt=0)] | None = None
    """Samples per second; a channel slower than the rows repeats its last value. None: the rows'"""


class EpisodeMeta(Part):
    """One uninterrupted stretch of samples, from rest."""

    episode: NonNegativeInt
    protocol: Text = "free"
    """The commanded protocol: steps, triangle, multisine, push, grasp, pull, policy, or free."""
    note: str | None = None


HELD = {"kp", "kd", "limit", "armature", "sensor", "uncertainty", "open_loop"}
"""Fields of a drive that say nothing of its loop."""
UNSURE = re.compile(r"^\s*([^\s%±]+?)\s*(?:\+-|\+/-|±)\s*([^\s%±]+)\s*(%?)\s*$")
"""A number and one standard deviation of it, such as '60 +- 20%'."""


class DriveSettings(Part):
    """Nominal drive of one joint, on the motor side; of a linear joint read m for rad, N for Nm.

    What is not given here stands in the MJCF, as do links, friction and gravity; what neither says
    beside kp and kd is not there. Numbers of `uncertainty` may be given with their standard
    deviation: '60 +- 20%' or '60 +- 12'.
    """

    kp: Amount | None = None
    """Proportional gain [Nm/rad], of a linear joint [N/m]; None: that of the MJCF's actuator."""
    kd: Amount | None = None
    """Derivative gain [Nms/rad], of a linear joint [Ns/m]; None: as `kp`."""
    limit: Positive | None = None
    """Largest drive torque [Nm], of a linear joint force [N]; None: as `kp`, or no limit."""
    armature: Positive | None = None
    """Inertia on the motor's side: the rotor's times the gear ratio squared [kg m^2], of a linear
    joint [kg]; None: that of the MJCF, or unknown."""
    sensor: Literal["joint", "motor"] = "joint"
    """Side of the gear on which the position was measured."""
    ki: Amount = 0.0
    """Integral gain [Nm/(rad s)]."""
    position_gain: Amount = 0.0
    """Of a cascade, whose loop on the speed has the gain kd: gain of its loop on the position
    [1/s]; kp is their product."""
    speed_integral: Amount = 0.0
    """Of a cascade: integral gain of its loop on the speed over kd [1/s], one over its reset
    time."""
    integral_limit: Amount = 0.0
    """Largest torque of the integral [Nm]; 0: `limit`."""
    filter: Amount = 0.0
    """Time constant of the low-pass filter on the speed that kd takes [s]."""
    lead: Annotated[FiniteFloat, Field(ge=0, le=1)] | None = None
    """Share of the target's speed that kd follows; 1: kd acts on the error of the speed; None: 1
    where the log has a `reference`, else 0."""
    speed: Amount = 0.0
    """Largest speed at which the drive moves its target to a command [rad/s]; 0: any."""
    acceleration: Amount = 0.0
    """The acceleration of that [rad/s^2]; 0: any."""
    lag: Amount = 0.0
    """Time constant by which the torque follows what is asked [s]."""
    rate: Amount = 0.0
    """Rate at which its loop acts, and its torque holds in between [Hz]; 0: as fast as may be."""
    back_emf: Amount = 0.0
    """Damping beside kd that the limit does not hold: kt^2 / R of a driven voltage [Nms/rad]."""
    open_loop: bool = False
    """Whether no position is fed back: the log's `feedforward`, or its `reference` with kd, is all
    that is asked, and kp, 1 by itself, is the gain of that torque."""
    uncertainty: dict[
        Literal["kp", "kd", "limit", "armature", "ki", "speed_integral"], Positive
    ] = {}
    """Standard deviations as shares, of numbers that are known otherwise than most."""

    @model_validator(mode="before")
    @classmethod
    def _with_uncertainty(cls, data: object) -> object:
        """Numbers such as '60 +- 20%' as numbers and their uncertainty."""
        if not isinstance(data, dict):
            return data
        found = {k: m for k, v in data.items() if isinstance(v, str) and (m := UNSURE.match(v))}
        try:
            values = {k: float(match[1]) for k, match in found.items()}
            sizes = {
                k: float(match[2]) / (100.0 if match[3] else abs(values[k]))
                for k, match in found.items()
            }
        except (ValueError, ZeroDivisionError):
            return data
        return {**data, **values, "uncertainty": {**data.get("uncertainty", {}), **sizes}}

    @model_validator(mode="after")
    def _of_cascade(self) -> Self:
        """The gain on the position of a cascade: the product of its gains."""
        if self.position_gain:
            if self.kd is None:
                raise ValueError("a position_gain needs kd, the gain of the loop on the speed")
            object.__setattr__(self, "kp", self.position_gain * self.kd)
        return self

    @property
    def more(self) -> dict[str, float]:
        """What it does beside the PD law, by the names here."""
        return self.model_dump(exclude_defaults=True, exclude=HELD)

    @property
    def loop(self) -> dict[str, float]:
        """What its loop does beside the PD law, by the numbers of `backends.spec.Loop`.

        Of settings whose kd holds the back-EMF.
        """
        return {
            "integral_hz": self.ki / self.kp if self.kp else 0.0,
            "speed_integral_hz": self.speed_integral,
            "integral_limit_nm": self.integral_limit,
            "filter_s": self.filter,
            "lead": self.lead or 0.0,
            "profile_rad_s2": self.acceleration,
            "lag_s": self.lag,
            "hold_s": 1.0 / self.rate if self.rate else 0.0,
            "unlimited": self.back_emf / self.kd if self.kd else 0.0,
            "open": float(self.open_loop),
        }


class HandMechanism(Part):
    """A hand that Stickbench knows by its name."""

    hand: Text
    stick: Text = "reference"
    """The stick that it holds in protocols with a stick."""
    effects: str = "none"
    """Effects that are known to be present, as on the command line; part of the nominal world."""


class MjcfMechanism(Part):
    """A user's mechanism: an MJCF or URDF file in the log's folder, and what it does not say."""

    mjcf: Text
    joints: dict[Name, DriveSettings] = {}
    """What the file does not say of drives, or says wrongly."""
    hold: dict[Name, FiniteFloat] = {}
    """Where joints are held that the log has not [rad], of a linear joint [m]; 0 by default."""
    fix_base: bool = False
    """Whether a floating base stands where the file has it."""
    gravity_compensation: Annotated[FiniteFloat, Field(ge=0, le=1)] = 0.0
    """Share of the weight of all links that the drives carry, beside their PD law; true: all."""

    @field_validator("mjcf")
    @classmethod
    def _stays_in_the_folder(cls, name: str) -> str:
        if PurePath(name).name != name:
            raise ValueError("give the name of a file in the log's folder, without a path")
        return name


class LogMeta(Part):
    """The contents of log.yaml."""

    schema_version: Literal[1] = Field(alias="schema")
    source: Text
    """Who or what recorded it, and when."""
    mechanism: HandMechanism | MjcfMechanism | None = None
    """None: no model is known, so the log can only be compared with healthy ones."""
    channels: dict[str, Channel] = {}
    """By channel name; empty: all channels of the samples, in the units of their names."""
    episodes: tuple[EpisodeMeta, ...] = ()
    """Empty: every episode of the samples has protocol 'free'."""
    nominal_uncertainty: Annotated[FiniteFloat, Field(ge=0, le=1)] = NOMINAL_UNCERTAINTY
    """Relative uncertainty (one standard deviation) of the nominal parameters."""


def parse_meta(data: object) -> LogMeta:
    """A LogMeta from the data of a YAML file; raises LogError naming every wrong field."""
    if not isinstance(data, dict):
        raise LogError(
            "log.yaml is empty; it needs the fields schema and source, and mechanism for a model"
        )
    if data.get("schema") != 1:
        raise LogError(
            f"log.yaml has schema {data.get('schema')!r}; allowed: 1; "
            "write `schema: 1` and follow docs/reference/log-format.md"
        )
    # One of two mechanisms is meant: say what is wrong with that one only.
    mechanism = data.get("mechanism")
    is_mjcf = isinstance(mechanism, dict) and "mjcf" in mechanism
    other = "HandMechanism" if is_mjcf else "MjcfMechanism"
    try:
        return LogMeta.model_validate(data)
    except ValidationError as error:
        wrong = [problem(e) for e in error.errors() if other not in e["loc"]]
        raise LogError(f"log.yaml: {'; '.join(wrong)}; see docs/reference/log-format.md") from None


def drive_of(source: object, **numbers: object) -> DriveSettings:
    """A drive of numbers that a recording gives; raises LogError for those that no drive has."""
    try:
        return DriveSettings.model_validate(numbers)
    except ValidationError as error:
        raise LogError(f"{source}: {'; '.join(map(problem, error.errors()))}") from None


def problem(error: ErrorDetails) -> str:
    """What is wrong with a field of a file, and what was given."""
    place = [str(part) for part in error["loc"] if not str(part).endswith("Mechanism")]
    given = "" if error["type"] == "missing" else f" (given: {reprlib.repr(error['input'])})"
    message = f"{error['msg'][:1].lower()}{error['msg'][1:]}"
    if error["type"] == "extra_forbidden":
        message, given = "unknown field; correct or remove it", ""
    elif place[-1:] == ["[key]"] and error["type"] == "string_type":
        place.pop()
        message, given = f"a name must be text; quote it: '{error['input']}'", ""
    return f"{'.'.join(place) or 'the file'}: {message}{given}"
