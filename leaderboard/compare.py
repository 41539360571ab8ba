"""Compare two policies with equal world and budget: how likely a new seed of one beats the other.

They are compared over all tasks on which both were trained; each task is a stratum.
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
    """Only entries with equal world and budget are compared."""
    policy: str
    """What identifies the policy, besides the task."""
    cells: dict[str, Any]
    """Its cells in the table."""
    scores: np.ndarray
    """The compared scores, higher is better, shape (S, E)."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """`first` against `second`; `first` is more likely to win."""

    first: dict[str, Any]
    second: dict[str, Any]
    """Their cells in the table of the first task."""
    tasks: tuple[str, ...]
    seeds: tuple[int, int]
    """Number of seeds of the first and the second over all tasks."""
    probability: Estimate
    """Probability that a new seed of the first scores more."""


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
