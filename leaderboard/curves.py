"""Learning curves: thinned, and combined over seeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray

CURVE = ("reward", "p_err_cm", "q_err_deg")
"""The signals of a learning curve, by their names in progress.csv."""


@dataclass(frozen=True, kw_only=True)
class Band:
    """One signal of several seeds over the steps trained; every array has shape (P,)."""

    steps: Array
    mean: Array
    low: Array
    high: Array
    """Mean, minimum and maximum over the seeds."""
    seeds: int


def thin(progress: Mapping[str, Any], points: int) -> dict[str, Array]:
    """A learning curve with at most `points` points: means over neighbours, at their last step."""
    steps = np.asarray(progress["steps"])
    parts = np.array_split(np.arange(len(steps)), min(points, len(steps)))
    signals = {name: np.asarray(progress[name]) for name in CURVE}
    means = {name: np.array([v[part].mean() for part in parts]) for name, v in signals.items()}
    return {"steps": steps[[part[-1] for part in parts]], **means}


def band(curves: Sequence[tuple[Any, Any]]) -> Band:
    """Combine the curves of several seeds, on the steps of the first, as far as all reach."""
    last = min(steps[-1] for steps, _ in curves)
    steps = np.asarray([step for step in curves[0][0] if step <= last], dtype=float)
    values = np.stack([np.interp(steps, *curve) for curve in curves])
    return Band(
        steps=steps,
        mean=values.mean(axis=0),
        low=values.min(axis=0),
        high=values.max(axis=0),
        seeds=len(curves),
    )
