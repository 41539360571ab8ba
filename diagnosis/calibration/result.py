"""calibration.yaml: the result of a calibration as plain data, which is checked when it is read."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import Field, ValidationError

from diagnosis.calibration.backlash import Play
from diagnosis.calibration.tactile import Number, Size, TouchSensor
from diagnosis.logs._meta import LogError, Part, as_log_errors, problem
from files.atomic import write_atomically
from files.plain_yaml import read_plain_yaml


class Gain(Part):
    """A gain of the PD law."""

    mean: Annotated[Number, Field(gt=0)]
    """In Nm/rad or Nms/rad."""
    std: Size
    """Standard deviation, by bootstrap, in the same unit."""
    relative: Number
    """Relative difference from the nominal gain."""


class Gains(Part):
    """The gains of one joint."""

    kp_nm_rad: Gain
    kd_nms_rad: Gain
    correlation: Annotated[Number, Field(ge=-1, le=1)]
    compared: Literal["position", "motor"]
    """The angle that is compared: motor or position."""
    samples: Annotated[int, Field(gt=0)]
    error_nominal_mrad: Size
    error_calibrated_mrad: Size
    """Mean absolute errors, which the fit minimises."""
    confounded: tuple[str, ...]
    """Effects that this log cannot distinguish from other gains, and the gains that they look
    like."""


class Backlash(Part):
    """The play of one joint."""

    half_deg: Size
    """Half of the play, mean over the positions."""
    std_deg: Size | None
    """Standard deviation over the positions; None for a single one."""
    range_deg: tuple[Number, Number]
    """The paper's [q_c - q_a, q_b - q_a], mean over the positions."""
    positions: Annotated[int, Field(gt=0)]
    stiffness_nm_rad: Number | None
    """Stiffness of the teeth, from the deflection under the push; None: no deflection was seen."""
    residual_mrad: Size
    motor: Literal["logged", "replayed"]
    """Source of the motor's own motion, which is subtracted."""
    self_lock: bool

    @classmethod
    def of(cls, play: Play) -> "Backlash":
        """The result of a push test."""
        low, high = np.degrees(play.ends_rad - play.rest_rad[:, None]).mean(axis=0)
        return cls(
            half_deg=np.degrees(play.mean_rad),
            std_deg=np.degrees(play.std_rad) if len(play.held_rad) > 1 else None,
            range_deg=(low, high),
            positions=len(play.held_rad),
            stiffness_nm_rad=1 / play.give_rad_nm if play.give_rad_nm > 0 else None,
            residual_mrad=1e3 * play.residual_rad,
            motor="logged" if play.reference == "logged" else "replayed",
            self_lock=bool(play.locks),
        )


class Joint(Part):
    """One joint; a text says why a number is not identifiable from this log."""

    gains: Gains | str
    backlash: Backlash | str


class CalibrationFile(Part):
    """The contents of calibration.yaml."""

    schema_version: Literal[1] = Field(alias="schema")
    log: str
    source: str
    backend: str
    hand: str
    stick: str
    nominal_effects: str
    seed: int
    effects: str
    """The calibrated world, in the form of `--effects`."""
    spread: str
    """Domain randomisation around it: standard deviations, half widths for stick and contact."""
    joints: dict[str, Joint]
    tactile: dict[str, TouchSensor] | str


def write_calibration(path: Path, content: CalibrationFile) -> None:
    """Write calibration.yaml, whole or not at all."""
    data = content.model_dump(mode="json", by_alias=True)
    text = yaml.safe_dump(data, sort_keys=False, width=100, default_flow_style=None)
    write_atomically(path, text)


def read_calibration(path: Path) -> CalibrationFile:
    """A calibration.yaml, checked; raises LogError."""
    try:
        with as_log_errors():
            return CalibrationFile.model_validate(read_plain_yaml(path))
    except FileNotFoundError:
        raise LogError(f"no calibration at {path}; `bench calibrate` writes one") from None
    except ValidationError as error:
        wrong = "; ".join(map(problem, error.errors()[:3]))
        raise LogError(f"{path}: {wrong}; correct it, or calibrate again") from None
