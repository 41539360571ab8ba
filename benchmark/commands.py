"""The work of the commands, given their parsed options."""

import dataclasses
import json
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmark.errors import CommandError, UsageError
from benchmark.provenance import provenance, usable_cores
from benchmark.runs import run_folder
from benchmark.runs.worlds import make_env
from benchmark.settings.quantities import within
from benchmark.settings.request import read_pairs, requested
from benchmark.settings.run_spec import RunSpec, read_settings
from leaderboard.identity import EPISODES, SMOKE_EPISODES

RUNS, LEADERBOARD, POLICIES = Path("runs"), Path("leaderboard"), "policies"
EPISODES_RANGE = (1, EPISODES)
_PROBE_STEPS = 15


def settings(
    given: Mapping[str, Any],
    calibration: Path | None,
    pairs: Sequence[str],
    config: Path | None,
    start: Path | None,
) -> RunSpec:
    """The RunSpec of the options of `bench run`; raises UsageError."""
    return requested(given, calibration, read_pairs(pairs), config, start)


def run(
    spec: RunSpec,
    start: Path | None,
    out: Path | None,
    workers: int | None,
    resume: bool,
    force: bool,
    logger: str | None = None,
) -> dict:
    """Run or continue `spec`, from the policy of the run `start` if given; returns the row."""
    from benchmark.runs import tensorboard
    from benchmark.runs.run import row, run

    path = out or RUNS / spec.name
    events = tensorboard.logger(logger, path)
    try:
        watch = events.add if events else None
        return row(run(spec, path, workers or usable_cores(), resume, force, start, watch), path)
    finally:
        if events:
            events.close()


def plan(spec: RunSpec, out: Path | None, workers: int | None) -> dict:
    """The settings of a run and an estimate of its duration from a short measurement."""
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
    """The median time of a call [s]; in a new installation some calls compile code first."""
    took = []
    for _ in range(_PROBE_STEPS):
        began = time.monotonic()
        call()
        took.append(time.monotonic() - began)
    return statistics.median(took)


def evaluate(
    folder: Path,
    given: Mapping[str, Any],
    episodes: int | None,
    out: Path | None,
    workers: int | None,
) -> dict:
    """Evaluate a finished run's policy under changed settings; returns the row."""
    from benchmark.runs import run

    if episodes is not None:
        within("--episodes", episodes, *EPISODES_RANGE)
    source = run_folder.finished_run(folder)
    spec = dataclasses.replace(run_folder.run_spec(source), **read_settings(given))
    found = run.deploy(spec, folder, workers or usable_cores(), episodes=episodes)
    row = {
        "status": "done",
        **{k: getattr(spec, k) for k in ("backend", "task", "algo", "observation", "effects")},
        **found.scores(),
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
        run.write_episodes(found, out / run_folder.EPISODES_FILE)
        run_folder.write_atomically(out / "eval.json", json.dumps(row, indent=2) + "\n")
    return row


def _marks(out: Path) -> dict[str, dict]:
    """Which rows of a leaderboard were verified; raises CommandError where that is damaged."""
    from leaderboard.verified import read_verified

    try:
        return read_verified(out)
    except (OSError, ValueError) as error:
        raise CommandError(
            f"{error}; remove the file, and `bench verify` makes it again"
        ) from error


def leaderboard(
    sources: list[Path],
    out: Path | None,
    add: bool,
    policies: bool,
    html: bool,
    include_smoke: bool,
) -> dict:
    """Write the leaderboard's files; returns what was written and what could not be read.

    `add` copies the rows of the sources there, `policies` their policies.
    """
    from benchmark.results.keep import keep_policies, keep_rows
    from leaderboard.files import write
    from leaderboard.rows import read_rows
    from leaderboard.tables import board

    out = out or LEADERBOARD
    results = out / "results"
    kept_rows = [results] if any(results.glob("*.json")) else []
    given = sources or ([] if kept_rows and not (add or policies) else [RUNS])
    sources = given + kept_rows
    rows, problems = read_rows(sources)
    smoke = [row for row in rows if row.spec.smoke]
    if not include_smoke:
        rows = [row for row in rows if not row.spec.smoke]
    if not rows:
        left = f"{len(smoke)} smoke runs; --include-smoke shows them" if smoke else ""
        found = "; ".join(filter(None, [left, *problems])) or "no run.json was found"
        where = ", ".join(map(str, sources))
        raise CommandError(f"nothing to rank in {where}: {found}")
    if add:
        keep_rows(given, results)
    kept = keep_policies(given, out / POLICIES) if policies else []
    made = board(rows, problems, smoke=include_smoke, verified=_marks(out))
    files = [str(file) for file in write(made, out, html)]
    return {
        "status": "done",
        "rows": len(rows),
        "smoke_left_out": 0 if include_smoke else len(smoke),
        "policies": len(kept),
        "written": files,
        "problems": problems,
    }


def view(
    folders: list[Path],
    given: Mapping[str, Any],
    out: Path | None,
    kind: str | None,
    episodes: int | None,
    time: str | None,
    workers: int | None,
) -> dict:
    """Draw runs to a file; returns what was drawn."""
    from benchmark.pictures.view import view
    from benchmark.settings import quantities

    if out is None:
        raise UsageError("where to? give --out FILE, or --live for the browser")
    moment = None if time is None else quantities.quantity(time, "--time", "s")
    return view(folders, out, kind, read_settings(given), episodes, moment, workers)


def view_live(
    folders: list[Path],
    given: Mapping[str, Any],
    out: Path | None,
    port: int,
    workers: int | None,
) -> dict:
    """Show one run in the browser; returns where it was shown."""
    from benchmark.pictures.view import view_live

    if len(folders) > 1 or out is not None:
        raise UsageError("--live shows one run and writes no file; leave --out out")
    (folder,) = folders
    trained = run_folder.run_spec(run_folder.finished_run(folder))
    changed = dataclasses.replace(trained, **read_settings(given))
    return view_live(changed, trained, folder, port, workers)
