"""Numbers with units as typed on the command line."""

import math
import re

from benchmark.errors import UsageError

_LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?nan|[-+]?inf)"


def length_m(text: str, flag: str) -> float:
    """A length such as '3cm' in metres; raises UsageError otherwise."""
    match = re.fullmatch(_NUMBER + r"\s*(m|cm|mm)", text.strip(), re.IGNORECASE)
    if match is None:
        raise UsageError(f"{flag} is '{text}'; allowed: a length with m, cm or mm, such as 3cm")
    return float(match.group(1)) * _LENGTHS_M[match.group(2)]


def count(text: str, flag: str) -> int:
    """A whole number such as '2e6' or '2000000'; raises UsageError otherwise."""
    try:
        value = float(text.replace("_", ""))
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value != int(value) or value < 0:
        raise UsageError(f"{flag} is '{text}'; allowed: a whole number from 0, such as 2e6")
    return int(value)
