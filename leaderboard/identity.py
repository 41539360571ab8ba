"""What identifies a run and a row: digests that anyone can compute again from what they name."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

EPISODES, SMOKE_EPISODES = 100, 8
"""Fixed episodes that the scores of a row are means of; those of a smoke run."""
BUDGET, CONVERGED = ENDS = "budget", "converged"
"""When a training ends: at its budget, or where its learning curve rises no more before that."""
LATER: dict[str, Any] = {
    **{"start_spread": 1.0, "overrides": {}, "start_sha256": None},
    "until": BUDGET,
}
"""Fields that older runs do not have, and what they were run with."""


def run_digest(fields: Mapping[str, Any], world_digest: str) -> str:
    """First 12 hex digits of the SHA-256 of a run's fields and of its nominal world.

    Fields that came later count where they are not their default: they rename no older run.
    """
    counted = {n: v for n, v in fields.items() if n not in LATER or LATER[n] != v}
    return _sha256([counted, world_digest])[:12]


def learner_name(
    algo: str, overrides: Mapping[str, Any], start_sha256: str | None, until: str
) -> str:
    """The algorithm with its changed hyperparameters, start and end: 'sb3-ppo lr=0.0003'."""
    changed = [f"{name}={value}" for name, value in overrides.items()]
    start = [] if start_sha256 is None else [f"from {start_sha256[:8]}"]
    end = [] if until == BUDGET else [f"until {until}"]
    return " ".join([algo, *changed, *start, *end])


def row_key(digest: str, policy_sha256: str | None, scores: Mapping[str, Any]) -> str:
    """What a row claims, as 16 hex digits: the run, its policy and its scores."""
    return _sha256([digest, policy_sha256, dict(scores)])[:16]


def _sha256(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()
