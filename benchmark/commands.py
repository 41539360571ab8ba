"""What the commands do, with text already split into options."""

import dataclasses
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

from benchmark import quantities, run_folder
from benchmark.errors import CommandError, UsageError
from benchmark.evaluate import EPISODES, SMOKE_EPISODES
from benchmark.provenance import provenance, usable_cores
from benchmark.run_spec import SMOKE_STEPS, SMOKE_WORLDS, RunSpec, make_env

RUNS, LEADERBOARD, POLICIES = Path("runs"), Path("leaderboard"), "policies"
_SCRIPTED = ("hold-still", "random")
_PROBE_STEPS = 15


def changes(**options: object) -> dict:
    """Fields of a RunSpec from the options that were given."""
    given = {key: value for key, value in options.items() if value is not None}
    if "radius" in given:
        given["radius_m"] = quantities.length_m(str(given.pop("radius")), "--radius")
    if "steps" in given:
        given["steps"] = quantities.count(str(given["steps"]), "--steps")
    return given


def settings(**options: object) -> RunSpec:
    """The RunSpec that the options of `bench run` ask for; raises UsageError."""
    given = changes(**options)
    if "calibration" in given:
        given |= _calibrated(given)
    if given.get("steps") == 0 and given["algo"] not in _SCRIPTED:
        raise UsageError("--steps is 0; allowed: from 1, or --algo hold-still or random")
    if given["algo"] in _SCRIPTED:
        given |= {"steps": 0, "randomize": False}
    if given["smoke"]:
        given["worlds"] = SMOKE_WORLDS
        given["steps"] = min(given.get("steps", SMOKE_STEPS), SMOKE_STEPS)
    return RunSpec(**given)


def _calibrated(given: dict) -> dict:
    """Effects and spread of the calibration that is given; raises UsageError."""
    from benchmark.calibrate import world_of

    path = given.pop("calibration")
    for option in ("effects", "spread"):
        if option in given:
            raise UsageError(f"--calibration and --{option} both say which worlds; leave one out")
    return world_of(path, RunSpec.hand)


def run(spec: RunSpec, out: Path | None, workers: int | None, resume: bool, force: bool) -> dict:
    """Run or continue `spec`; the row."""
    from benchmark.run import row, run

    path = out or RUNS / spec.name
    return row(run(spec, path, workers or usable_cores(), resume, force), path)


def plan(spec: RunSpec, out: Path | None, workers: int | None) -> dict:
    """What a run would do and about how long it would take, from a short measurement."""
    workers = workers or usable_cores()
    worlds = [spec.world()] * min(spec.worlds, 16 * workers)
    env = make_env(spec, worlds, seed=0, workers=workers)
    try:
        env.reset()
        import numpy as np

        still = np.zeros((env.worlds, env.action_width))
        rate = env.worlds / typical_s(lambda: env.step(still))
    finally:
        env.close()
    evaluation = (SMOKE_EPISODES if spec.smoke else EPISODES) * env.horizon
    return {
        "would_run": dataclasses.asdict(spec),
        "dir": str(out or RUNS / spec.name),
        "digest": spec.digest,
        "measured_env_steps_per_s": round(rate, 1),
        "simulation_minutes": round((spec.steps + evaluation) / rate / 60, 1),
    }


def typical_s(call: Callable[[], object]) -> float:
    """The median time of a call [s]: in a fresh installation some calls compile what they need."""
    took = []
    for _ in range(_PROBE_STEPS):
        began = time.monotonic()
        call()
        took.append(time.monotonic() - began)
    return statistics.median(took)


def evaluate(folder: Path, changed: dict, out: Path | None, workers: int | None) -> dict:
    """Evaluate a finished run's policy under changed settings; the row."""
    from benchmark import run

    source = run_folder.read_run(folder)
    run_folder.check_policy(folder, source)
    if source["status"] != "done":
        raise UsageError(f"{folder} is {source['status']}: {source['reason']}; finish it first")
    spec = dataclasses.replace(run_folder.run_spec(source), **changed)
    episodes = run.deploy(spec, folder, workers or usable_cores())
    row = {
        "status": "done",
        **{k: getattr(spec, k) for k in ("backend", "task", "algo", "observation", "effects")},
        **episodes.scores(),
        "stick": spec.stick,
        "radius_m": spec.radius_m,
        "speed": spec.speed,
        "policy": str(folder),
        "trained": source["spec"],
        "spec_digest": spec.world().digest,
        "provenance": provenance(),
    }
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        run.write_episodes(episodes, out / run_folder.EPISODES_FILE)
        run_folder.write_atomically(out / "eval.json", json.dumps(row, indent=2) + "\n")
    return row


def leaderboard(
    sources: list[Path], out: Path | None, add: bool, policies: bool, html: bool
) -> dict:
    """Write the leaderboard's files; what was written and what could not be read.

    `add` keeps the rows of the sources beside them, `policies` their policies.
    """
    from benchmark.keep import keep_policies, keep_rows
    from leaderboard.files import write
    from leaderboard.rows import read_rows
    from leaderboard.tables import board

    out = out or LEADERBOARD
    results = out / "results"
    kept_rows = [results] if results.is_dir() else []
    given = sources or ([] if kept_rows and not (add or policies) else [RUNS])
    sources = given + kept_rows
    rows, problems = read_rows(sources)
    if not rows:
        found = "; ".join(problems) or "no run.json was found"
        where = ", ".join(map(str, sources))
        raise CommandError(f"nothing to rank in {where}: {found}")
    if add:
        keep_rows(given, results)
    kept = keep_policies(given, out / POLICIES) if policies else []
    files = [str(file) for file in write(board(rows, problems), out, html)]
    return {"rows": len(rows), "policies": len(kept), "written": files, "problems": problems}
