"""Numbers with units as typed on the command line."""

import math
import re

from benchmark.errors import UsageError

_LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_TIMES_S = {"s": 1.0, "min": 60.0, "h": 3600.0}
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?nan|[-+]?inf)"


def length_m(text: str, flag: str) -> float:
    """A length such as '3cm' in metres; raises UsageError otherwise."""
    match = re.fullmatch(_NUMBER + r"\s*(m|cm|mm)", text.strip(), re.IGNORECASE)
    if match is None:
        raise UsageError(f"{flag} is '{text}'; allowed: a length with m, cm or mm, such as 3cm")
    return float(match.group(1)) * _LENGTHS_M[match.group(2).lower()]


def number(text: str, flag: str) -> float:
    """A finite number such as '0.5'; raises UsageError otherwise."""
    match = re.fullmatch(_NUMBER, text.strip())
    if match is None or not math.isfinite(float(text)):
        raise UsageError(f"{flag} is '{text}'; allowed: a number such as 0.5")
    return float(text)


def duration_s(text: str, flag: str) -> float:
    """A time above 0 such as '90min' in seconds; raises UsageError otherwise."""
    match = re.fullmatch(_NUMBER + r"\s*(s|min|h)", text.strip(), re.IGNORECASE)
    value = float(match.group(1)) * _TIMES_S[match.group(2).lower()] if match else math.nan
    if not (math.isfinite(value) and value > 0):
        raise UsageError(f"{flag} is '{text}'; allowed: a time above 0 in s, min or h, such as 2h")
    return value


def count(text: str, flag: str) -> int:
    """A whole number such as '2e6' or '2000000'; raises UsageError otherwise."""
    try:
        value = float(text.replace("_", ""))
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value != int(value) or value < 0:
        raise UsageError(f"{flag} is '{text}'; allowed: a whole number from 0, such as 2e6")
    return int(value)


def counts(text: str, flag: str) -> tuple[int, ...]:
    """Whole numbers such as '16,64,256'; raises UsageError otherwise."""
    return tuple(count(part.strip(), flag) for part in text.split(","))
