"""Two policies in one world with one budget: how likely a new seed of one beats one of the other.

They are compared over all tasks that both were trained on, each task a stratum.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leaderboard.statistics import Estimate, improvement


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One policy on one task in one world."""

    task: str
    world: tuple
    """Only entries of equal worlds, budget included, are compared."""
    policy: str
    """What else identifies it, but for the task."""
    cells: dict[str, Any]
    """What the table says of it."""
    scores: np.ndarray
    """What is compared, the more the better, shape (S, E)."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """`first` against `second`, of which `first` is the likelier to win."""

    first: dict[str, Any]
    second: dict[str, Any]
    """What the table says of them on the first of the tasks."""
    tasks: tuple[str, ...]
    seeds: tuple[int, int]
    """Seeds of the first and the second over all tasks."""
    probability: Estimate
    """That a new seed of the first scores more."""


def compare(entries: Sequence[Entry]) -> list[Comparison]:
    """Every pair of policies that share a world and a task, in the order of `entries`."""
    worlds: dict[tuple, dict[str, dict[str, Entry]]] = {}
    for entry in entries:
        policies = worlds.setdefault(entry.world, {})
        policies.setdefault(entry.policy, {})[entry.task] = entry
    return [
        _comparison(x, y, tasks)
        for policies in worlds.values()
        for x, y in itertools.combinations(policies.values(), 2)
        if (tasks := tuple(task for task in x if task in y))
    ]


def _comparison(x: dict[str, Entry], y: dict[str, Entry], tasks: tuple[str, ...]) -> Comparison:
    found = improvement([(x[task].scores, y[task].scores) for task in tasks])
    if found.value < 0.5:
        x, y = y, x
        found = Estimate(value=1 - found.value, low=1 - found.high, high=1 - found.low)
    return Comparison(
        first=x[tasks[0]].cells,
        second=y[tasks[0]].cells,
        tasks=tasks,
        seeds=(_seeds(x, tasks), _seeds(y, tasks)),
        probability=found,
    )


def _seeds(entries: dict[str, Entry], tasks: tuple[str, ...]) -> int:
    return sum(len(entries[task].scores) for task in tasks)
