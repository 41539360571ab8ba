"""`bench speed`: steps per second, against the bare engine, for numbers of worlds and cores.

On one core the CPU time is measured, because other work on the machine does not lengthen it. On
several cores the wall time is measured.
"""

import os
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from backends.shard import WorkerError, simulate
from benchmark.console import Bar
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.provenance import provenance, usable_cores
from benchmark.runs.train import training_worlds
from benchmark.settings.quantities import within
from benchmark.settings.run_spec import RunSpec
from benchmark.speed import _memory
from benchmark.speed._report import table, write
from benchmark.speed._stopwatch import DifferentStepsError, Timing, measure
from tasks.batch import SimulationDivergedError

_ROOM = 0.9
"""Share of the free memory that a measurement may use."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The measurements: every engine with every number of worlds on every number of cores."""

    backends: tuple[str, ...]
    worlds: tuple[int, ...]
    workers: tuple[int, ...]
    duration_s: float
    """Time for each measurement [s]."""
    seed: int
    """Seed of the worlds, which are drawn as for training."""

    def __iter__(self) -> Iterator[tuple[str, int, int]]:
        """Engine, cores and worlds of each measurement, smallest first."""
        for backend in self.backends:
            for cores in self.workers:
                yield from ((backend, cores, n) for n in self.worlds if n >= cores)


def plan(
    backend: str, worlds: tuple[int, ...], workers: tuple[int, ...], duration_s: float, seed: int
) -> Plan:
    """The plan of these options; raises UsageError."""
    cores = usable_cores()
    for count in workers:
        within("--workers", count, 1, cores)
    made = Plan(
        backends=registry.chosen("backend", backend),
        worlds=worlds,
        workers=workers or tuple(sorted({1, min(2, cores)})),
        duration_s=duration_s,
        seed=seed,
    )
    if not list(made):
        given = ",".join(map(str, worlds))
        raise UsageError(
            f"--worlds is {given}, fewer than --workers; give each core at least one world"
        )
    return made


def speed(asked: Plan, out: Path | None) -> tuple[dict, Table]:
    """Measure and write speed.csv, speed.json and speed.png to `out`; the result and its table.

    Raises CommandError if nothing could be measured.
    """
    load = os.getloadavg()[0]
    rows, skipped = _measure_all(asked)
    if not rows:
        raise CommandError("nothing was measured: " + "; ".join(s["reason"] for s in skipped))
    for row in rows:
        row["gain"] = _gain(row, rows)
    engines = {name: _engine(rows, name) for name in asked.backends if _of(rows, name)}
    best = max(engines.values(), key=lambda engine: engine["env_steps_per_s"])
    result = {"status": "done", **best, "engines": engines, "rows": rows, "skipped": skipped}
    result["machine"] = provenance() | {"load_before": round(load, 2)}
    if out is not None:
        write(result, rows, out)
    return result, table(result)


def _measure_all(asked: Plan) -> tuple[list[dict], list[dict]]:
    rows: list[dict] = []
    skipped = []
    cells = list(asked)
    with Bar("measuring", len(cells)) as bar:
        for done, (backend, cores, worlds) in enumerate(cells):
            cell = f"{backend}, {worlds} worlds, {cores} {'core' if cores == 1 else 'cores'}"
            bar.update(done, cell)
            try:
                _check_memory(_of(rows, backend, cores), worlds)
                rows.append(_measure(asked, backend, cores, worlds))
            except (
                CommandError,
                DifferentStepsError,
                SimulationDivergedError,
                WorkerError,
            ) as error:
                skipped.append({"cell": cell, "reason": str(error)})
        bar.update(len(cells), "done")
    return rows, skipped


def _measure(asked: Plan, backend: str, cores: int, worlds: int) -> dict:
    run = RunSpec(backend=backend, task="circle", worlds=worlds, seed=asked.seed)
    _memory.give_back()
    began = time.perf_counter()
    env = run.make_env(training_worlds(run, 0), asked.seed, cores)
    built_s = time.perf_counter() - began
    engine, specs = registry.load("backend", backend), env.simulator.specs
    clock = time.process_time if cores == 1 else time.perf_counter
    try:
        env.reset()
        env.step(np.zeros((worlds, env.action_width)))
        memory_mb = _memory.held_mb()
        with closing(simulate(engine, specs, cores)) as bare:
            timing = measure(env, bare, asked.duration_s, clock)
    finally:
        env.close()
    return {
        "backend": backend,
        "envs": worlds,
        "processes": cores,
        "parallel_by": "threads" if engine.steps_in_threads else "processes",
        "clock": "processor" if cores == 1 else "wall",
        **_rates(timing, worlds, specs[0].timing.substeps),
        "memory_mb": round(memory_mb, 1),
        "build_s": round(built_s, 2),
    }


def _rates(timing: Timing, worlds: int, substeps: int) -> dict:
    step_s = timing.step_s + timing.restart_s
    parts = {
        "engine": timing.raw_s,
        "drives_and_readings": timing.advance_s - timing.raw_s,
        "touch_and_task": timing.step_s - timing.advance_s,
        "restarts": timing.restart_s,
    }
    low, middle, high = timing.overhead
    return {
        "env_steps_per_s": round(worlds / step_s, 1),
        "wall_env_steps_per_s": round(worlds / timing.wall_s, 1),
        "physics_steps_per_s": round(worlds * substeps / step_s, 1),
        "raw_physics_steps_per_s": round(worlds * substeps / timing.raw_s, 1),
        "overhead": round(middle, 4),
        "overhead_quartiles": [round(low, 4), round(high, 4)],
        "us_per_env_step": {name: round(1e6 * s / worlds, 2) for name, s in parts.items()},
        "steps": timing.steps,
    }


def _of(rows: list[dict], backend: str, cores: int | None = None) -> list[dict]:
    """The rows of an engine with a number of cores."""
    return [r for r in rows if r["backend"] == backend and cores in (None, r["processes"])]


def _engine(rows: list[dict], backend: str) -> dict:
    """An engine's fastest row on the fewest cores, the gain of more cores, and memory per world."""
    own = _of(rows, backend)
    few = _of(rows, backend, own[0]["processes"])
    best = max(few, key=lambda row: row["env_steps_per_s"])
    more = [row for row in own if row["envs"] == best["envs"] and row is not best]
    gain = {row["processes"]: row["gain"] for row in more}
    return {**best, "gain_of_processes": gain, "memory_mb_per_world": _slope_mb(few)}


def _gain(row: dict, rows: list[dict]) -> float:
    """Steps per second (wall time) over those of the same number of worlds on the fewest cores."""
    same = [other for other in _of(rows, row["backend"]) if other["envs"] == row["envs"]]
    few = min(same, key=lambda other: other["processes"])
    return round(row["wall_env_steps_per_s"] / few["wall_env_steps_per_s"], 3)


def _slope_mb(rows: list[dict]) -> float | None:
    """Memory per additional world [MB], from the smallest to the largest batch."""
    small, large = rows[0], rows[-1]
    if small is large:
        return None
    return round((large["memory_mb"] - small["memory_mb"]) / (large["envs"] - small["envs"]), 3)


def _check_memory(rows: list[dict], worlds: int) -> None:
    """Raise CommandError if, by the smaller batches, this one does not fit into memory."""
    slope_mb, free_mb = _slope_mb(rows) if rows else None, _memory.free_mb()
    if slope_mb is None or 2 * slope_mb * worlds <= _ROOM * free_mb:
        return
    needs, free = f"{2 * slope_mb * worlds / 1e3:.1f} GB", f"{free_mb / 1e3:.1f} GB"
    raise CommandError(
        f"{worlds} worlds, and as many of the bare engine, need about {needs} of memory; free are "
        f"{free}"
    )
