"""`bench sweep`: run all unfinished cells of a grid, here or on a cluster.

A cell is one run with its folder. This file knows neither what a run does nor how Slurm works.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from rich.table import Table

from benchmark.console import say
from benchmark.errors import UsageError
from benchmark.provenance import usable_cores
from benchmark.runs.run_folder import RUNS
from benchmark.sweep._board import TABLE_FILE, Board
from benchmark.sweep._cell import Cell, run_cell
from benchmark.sweep._estimate import makespan, measure
from benchmark.sweep._grid import Grid, read_grid


def sweep(
    file: Path, out: Path | None, jobs: int | None, slurm: bool, partition: str | None
) -> tuple[dict, Table]:
    """Run the unfinished cells of a grid; returns the outcomes of all cells.

    Writes one run folder per cell and `sweep.csv` into `out`. A failed cell does not affect the
    others, and finished cells stay finished if the sweep is stopped.
    """
    grid = read_grid(file)
    if partition is not None and not slurm:
        raise UsageError(f"--partition is {partition} without --slurm; give both or neither")
    board = _board(grid, out or RUNS)
    began = time.monotonic()
    with board:
        if slurm:
            from benchmark.sweep._slurm import run_on_slurm

            asked = {} if partition is None else {"partition": partition}
            run_on_slurm(board, grid.time_limit_s, jobs, grid.slurm.model_copy(update=asked))
        else:
            _run_here(board, grid.time_limit_s, jobs or usable_cores())
    return _summary(board, time.monotonic() - began)


def preview(file: Path, out: Path | None, jobs: int | None) -> tuple[dict, Table]:
    """The cells of a grid and an estimate of their time on one core each."""
    grid = read_grid(file)
    board = _board(grid, out or RUNS)
    jobs = jobs or usable_cores()
    rates = measure([cell.spec for cell in board.open])
    cells = []
    for cell, row in zip(board.cells, board.rows(), strict=True):
        cell_s = rates.seconds(cell) if cell in board.open else 0.0
        named = {name: row[name] for name in ("name", "state")}
        cells.append({**named, "minutes": None if cell_s is None else cell_s / 60})
    known = [cell["minutes"] for cell in cells if cell["minutes"] is not None]
    result = {
        "cells": cells,
        "to_run": len(board.open),
        "jobs": jobs,
        "minutes": makespan(known, jobs),
        "core_minutes": sum(known),
        "time_limit_s": grid.time_limit_s,
        "env_steps_per_s": rates.steps_per_s,
        "problems": rates.problems,
    }
    return result, _preview_table(result)


def _preview_table(result: dict) -> Table:
    table = Table("cell", "state", "minutes", header_style="bold")
    for cell in result["cells"]:
        minutes = "-" if cell["minutes"] is None else f"{cell['minutes']:.1f}"
        table.add_row(cell["name"], cell["state"], minutes)
    for backend, problem in result["problems"].items():
        table.add_row(f"{backend} was not measured: {problem}", "", "")
    table.add_section()
    what = f"{result['to_run']} cells to run, {result['jobs']} at a time"
    table.add_row(what, "", f"{result['minutes']:.1f}")
    return table


def _board(grid: Grid, out: Path) -> Board:
    cells = [Cell(options=c.options, spec=c.spec, out=out) for c in grid.choices]
    return Board(cells, out)


def _run_here(board: Board, limit_s: float, jobs: int) -> None:
    """Run the unfinished cells on this machine, one core and one process each."""

    def work(cell: Cell) -> None:
        board.ended(run_cell(cell, limit_s, 1, board.beat))

    pool = ThreadPoolExecutor(jobs)
    try:
        for done in [pool.submit(work, cell) for cell in board.open]:
            done.result()
    except KeyboardInterrupt:
        say("stopping the cells; the same command continues from here")
        raise
    finally:  # however it ends, no cell is left running
        pool.shutdown(wait=False, cancel_futures=True)
        board.stopped.set()
        pool.shutdown()


def _summary(board: Board, wall_s: float) -> tuple[dict, Table]:
    rows = board.rows()
    open_names = [cell.spec.name for cell in board.open]
    table = Table(header_style="bold")
    for column in ("cell", "state", "tracked", "wall time", "reason"):
        table.add_column(column, overflow="fold")
    for row in rows:
        tracked = "-" if row["tracked"] is None else f"{row['tracked']:.3f}"
        table.add_row(row["name"], row["state"], tracked, _duration(row["wall_s"]), row["reason"])
    return {
        "status": "failed" if open_names else "done",
        "cells": len(rows),
        "was_done": sum(row["state"] == "was done" for row in rows),
        "done": sum(row["state"] == "done" for row in rows),
        "failed": [row["name"] for row in rows if row["name"] in open_names],
        "wall_s": round(wall_s, 1),
        "table": str(board.out / TABLE_FILE),
        "rows": rows,
    }, table


def _duration(time_s: float) -> str:
    return f"{time_s:.0f} s" if time_s < 120 else f"{time_s / 60:.1f} min"
