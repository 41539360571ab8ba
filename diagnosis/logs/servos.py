"""Servos that are known: from the gain in their firmware and their supply to a drive's numbers.

They drive a voltage, so the back-EMF brakes them beyond the limit of the duty cycle, too.
"""

from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

import yaml

from diagnosis.logs._meta import DriveSettings, LogError

MOST_UNSURE = ("kp", "kd", "limit", "armature")
OWN = ("gain", "volts")
"""Numbers that a user may know better than the table."""


@cache
def table() -> Mapping[str, Mapping[str, Any]]:
    """The servos by name, as `servos.yaml` explains them."""
    text = resources.files(__package__).joinpath("servos.yaml").read_text(encoding="utf-8")
    found: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return found


def servo(text: str) -> DriveSettings:
    """The drive of a servo such as `sts3215`, or `sts3215,gain:16,volts:7.2`; raises LogError."""
    name, *own = (part.strip() for part in text.split(","))
    if name not in table():
        raise LogError(
            f"no servo '{name}' is known; known: {', '.join(table())}; else give --drive"
        )
    one = dict(table()[name])
    for part in own:
        key, _, value = part.partition(":")
        try:
            one[key] = float(value)
        except ValueError:
            one[key] = -1.0
        if key not in OWN or not one[key] > 0.0:
            raise LogError(f"'{part}' of servo {text}: allowed are {', '.join(OWN)} above 0")
    limit = one["nm_per_volt"] * one["volts"]
    known = [n for n in MOST_UNSURE if n != "armature" or "armature" in one]
    return DriveSettings.model_validate(
        {
            "kp": limit * one["duty_per_rad"] * one["gain"],
            "limit": limit * one.get("most_duty", 1.0),
            "back_emf": one["back_emf"],
            "armature": one.get("armature"),
            "uncertainty": dict.fromkeys(known, one["uncertainty"]),
        }
    )
