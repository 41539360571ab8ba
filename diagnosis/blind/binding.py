"""What binds results to a set: the logs' hashes, the solver's, and solving again."""

import secrets
from collections.abc import Callable, Mapping
from typing import Any

from diagnosis.blind.files import BlindError, BlindSet

SEAL = (
    "The seal proves: these are the answers that were committed, and every result is of the "
    "committed log.",
    "It does not prove: that the solver gave the results (solve some again: --replay), that nobody "
    "knew the seed or drew the set before, that no other solver was tried elsewhere.",
)
"""What a score's reader may rely on."""
SAID = ("verdict", "joints", "magnitudes", "confidence", "refused")
"""What of a result must come out alike when a case is solved again."""
DIGITS = 6
"""Significant digits of its numbers."""


def checked(blind: BlindSet) -> dict[int, dict[str, Any]]:
    """All results of a set by number; raises BlindError for missing ones and foreign logs."""
    results = {number: blind.read_result(number) for number in blind.numbers}
    missing = [number for number, said in results.items() if said is None]
    if missing:
        raise BlindError(
            f"{len(missing)} of {len(results)} cases have no result, case {missing[0]:03d} first; "
            f"solve them with: bench blind run {blind.path}"
        )
    found = {number: said for number, said in results.items() if said is not None}
    for number, said in found.items():
        _check_log(blind, number, said)
    return found


def _check_log(blind: BlindSet, number: int, said: Mapping[str, Any]) -> None:
    committed = blind.commitment().logs_sha256[f"{number:03d}"]
    for what, digest in (("log", blind.log_sha256(number)), ("result", said.get("log_sha256"))):
        if digest != committed:
            raise BlindError(
                f"the {what} of case {number:03d} is not of the log that was committed ({digest}, "
                f"committed: {committed}); take the set as it was made, and solve it again"
            )


def replay(blind: BlindSet, count: int, solve: Callable[[int], Mapping[str, Any]]) -> list[int]:
    """Cases at random that were solved again; raises BlindError where one says something else."""
    numbers = secrets.SystemRandom().sample(list(blind.numbers), min(count, len(blind.numbers)))
    for number in sorted(numbers):
        kept, again = blind.read_result(number) or {}, solve(number)
        if kept.get("solver_sha256") != again["solver_sha256"]:
            raise BlindError(
                f"the result of case {number:03d} is by another solver than this one; check out "
                "the commit that solved the set to solve it again"
            )
        changed = [name for name in SAID if _plain(kept.get(name)) != _plain(again.get(name))]
        if changed:
            raise BlindError(
                f"case {number:03d}, solved again, says something else: {changed[0]} is "
                f"{again.get(changed[0])!s:.200}, not {kept.get(changed[0])!s:.200}; "
                "its result was changed, or it is not of this solver"
            )
    return sorted(numbers)


def _plain(said: Any) -> Any:
    """Plain data with numbers to `DIGITS` digits."""
    if isinstance(said, float):
        return float(f"{said:.{DIGITS}g}")
    if isinstance(said, Mapping):
        return {name: _plain(value) for name, value in said.items()}
    return [_plain(one) for one in said] if isinstance(said, list | tuple) else said
