"""Numbers with units, as typed on the command line."""

import math
import re

from benchmark.errors import UsageError

_UNITS = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180},
    "time": {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0},
    "rate": {"Hz": 1.0, "kHz": 1e3},
    "torque": {"Nm": 1.0, "mNm": 1e-3},
    "force": {"N": 1.0},
}
"""Sizes of units in SI, by dimension."""
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?nan|[-+]?inf)"


def size(unit: str) -> float:
    """Size of a unit in SI units."""
    return next(units[unit] for units in _UNITS.values() if unit in units)


def measured(text: str, flag: str, *units: str) -> tuple[float, str]:
    """Read a number with a unit of one of these dimensions: its SI value and dimension.

    Raises UsageError if the unit is missing or of another dimension.
    """
    dimensions = {name: sizes for name, sizes in _UNITS.items() if set(units) & set(sizes)}
    match = re.fullmatch(_NUMBER + r"\s*([A-Za-z]+)", text.strip())
    if match is not None:
        for name, sizes in dimensions.items():
            for unit, unit_size in sizes.items():
                if match.group(2).casefold() == unit.casefold():
                    return float(match.group(1)) * unit_size, name
    known = ", ".join(unit for sizes in dimensions.values() for unit in sizes)
    raise UsageError(f"{flag} is '{text}'; allowed: a number with its unit ({known})")


def quantity(text: str, flag: str, unit: str) -> float:
    """Read a number with a unit of the dimension of `unit`, in SI units; raises UsageError."""
    return measured(text, flag, unit)[0]


def within(flag: str, value: float, low: float, high: float, unit: str = "") -> None:
    """Raise UsageError unless a number (SI units) is finite and in its range (in `unit`)."""
    try:
        shown = value / size(unit) if unit else float(value)
    except OverflowError:  # a whole number of hundreds of digits
        shown = math.inf
    if not (math.isfinite(shown) and low <= shown <= high):
        tail = f" {unit}" if unit else ""
        raise UsageError(f"{flag} is {shown:g}{tail}; allowed: {low:g} to {high:g}{tail}")


def number(text: str, flag: str) -> float:
    """A number such as '0.5', finite or not; raises UsageError otherwise."""
    if re.fullmatch(_NUMBER, text.strip()) is None:
        raise UsageError(f"{flag} is '{text}'; allowed: a number such as 0.5")
    return float(text)


def span(text: str, flag: str) -> tuple[float, float]:
    """Two numbers such as '3:30', the lower one above 0 and first; raises UsageError otherwise."""
    low, colon, high = text.partition(":")
    ends = (number(low, flag), number(high, flag)) if colon else (math.nan, math.nan)
    if not 0 < ends[0] < ends[1] < math.inf:
        raise UsageError(f"{flag} is '{text}'; allowed: LOW:HIGH above 0, such as 3:30")
    return ends


def count(text: str, flag: str) -> int:
    """A whole number such as '2e6' or '2000000'; raises UsageError otherwise."""
    plain = text.strip().replace("_", "")
    try:
        value = float(plain)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value != int(value) or value < 0:
        raise UsageError(f"{flag} is '{text}'; allowed: a whole number from 0, such as 2e6")
    return int(plain) if plain.isdecimal() else int(value)
