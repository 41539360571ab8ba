"""Result rows as a run would write them, for the tests of the leaderboard."""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from leaderboard.files import write
from leaderboard.identity import EPISODES, SMOKE_EPISODES, run_digest
from leaderboard.rows import Row
from leaderboard.tables import board

SPEC = {
    **{"backend": "mujoco", "hand": "trx", "stick": "reference", "effects": "built"},
    **{"task": "eight", "radius_m": 0.02, "speed": 1.0, "observation": "pose", "algo": "ppo"},
    **{"steps": 1000, "seed": 0, "randomize": True, "worlds": 256, "smoke": False},
}


def run(tracked: float = 0.5, **changes: object) -> dict:
    """A finished run; `changes` go to its spec, or to the row where the spec has no such field."""
    spec = SPEC | {name: value for name, value in changes.items() if name in SPEC}
    row = {name: value for name, value in changes.items() if name not in SPEC}
    scores = {"p_err_cm": 1.25, "q_err_deg": 2.5, "held": 1.0, "tracked": tracked}
    scores["episodes"] = SMOKE_EPISODES if spec["smoke"] else EPISODES
    provenance = {
        **{"command": f"bench run --seed {spec['seed']}", "cpu": "x", "cores": 2, "commit": "c"},
        **{"versions": {"mujoco": "3.3", "numpy": "2.0", "ppo": "2.7"}, "platform": "linux"},
        "finished": "2026-01-01T00:00:00",
    }
    world = str(row.get("spec_digest", "w0"))
    digest = run_digest(spec, world)
    return {
        **{"schema": 1, "status": "done", "reason": "", "spec": spec, "digest": digest},
        **{"spec_digest": world, "scores": scores, "steps": 1000, "wall_s": 90.0},
        **{"env_steps_per_s": 12.5, "policy_sha256": "0" * 64, "provenance": provenance},
    } | row


def resigned(item: dict) -> dict:
    """A row whose digest is that of its spec and world."""
    return item | {"digest": run_digest(item["spec"], item["spec_digest"])}


def seeds(tracked: float, count: int = 3, **changes: object) -> list[dict]:
    """Finished runs that differ in their seed alone."""
    return [run(tracked, seed=seed, **changes) for seed in range(count)]


def rows(*runs: dict) -> list[Row]:
    return [Row.model_validate(item) for item in runs]


def save(folder: Path, item: dict) -> Path:
    folder.mkdir(parents=True)
    (folder / "run.json").write_text(json.dumps(item))
    return folder


def table(read: list[Row], smoke: bool = False) -> pd.DataFrame:
    return board(read, smoke=smoke).frame


def rendered(folder: Path, read: list[Row], problems: tuple[str, ...] = ()) -> str:
    write(board(read, problems), folder)
    return (folder / "leaderboard.md").read_text()


def page(folder: Path, read: list[Row], problems: tuple[str, ...] = ()) -> str:
    write(board(read, problems), folder)
    return (folder / "leaderboard.html").read_text()


def detailed(mean: float = 0.5, spread: float = 0.2, **changes: object) -> dict:
    """A finished run with its scores per episode, even ones, and its learning curve."""
    steps = np.linspace(-1, 1, 100)
    tracked = [float(f"{x:.6g}") for x in mean + spread * steps]
    same = {"held": [1.0] * 100, "p_err_cm": [1.25] * 100, "q_err_deg": [2.5] * 100}
    curve = {"steps": [500, 1000], "reward": [0.1, 0.2]}
    curve |= {"p_err_cm": [2.0, 1.5], "q_err_deg": [9.0, 3.0]}
    return run(mean, **changes) | {"episodes": {"tracked": tracked, **same}, "curve": curve}
