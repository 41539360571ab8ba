"""The state of a sweep's cells while they run: shown on the terminal, kept in sweep.csv."""

import csv
import io
import threading
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmark.console import Bar, say
from benchmark.sweep._cell import Cell, Outcome, finished
from files.atomic import write_atomically

TABLE_FILE = "sweep.csv"
SPEC_COLUMNS = (
    *("backend", "task", "observation", "algo", "effects", "stick", "radius_m", "speed"),
    *("steps", "seed", "randomize", "spread", "start_spread", "smoke"),
)
SCORE_COLUMNS = ("tracked", "held", "p_err_cm", "q_err_deg", "episodes", "env_steps_per_s")
COLUMNS = ("name", "state", "reason", *SPEC_COLUMNS, *SCORE_COLUMNS, "wall_s", "dir", "log")
SHOWN_RUNNING = 3
"""Number of running cells whose progress is shown next to the bar."""


class Board:
    """The cells of a sweep and their outcomes; safe to use from several threads."""

    def __init__(self, cells: Sequence[Cell], out: Path) -> None:
        self.cells, self.out = cells, out
        self.outcomes = {c.spec.name: done for c in cells if (done := finished(c)) is not None}
        self.stopped = threading.Event()
        """Set when running cells shall end and waiting ones shall not begin."""
        self._running: dict[str, Cell] = {}
        self._lock = threading.Lock()
        self._bar = Bar("sweep", len(cells))

    def __enter__(self) -> "Board":
        self._bar.__enter__()
        self._show()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)
        self.write_table()

    @property
    def open(self) -> list[Cell]:
        """The cells that are not finished."""
        return [c for c in self.cells if not self._good(c)]

    def beat(self, cell: Cell) -> bool:
        """Note that a cell is alive and show the progress; returns whether it shall stop."""
        with self._lock:
            self._running[cell.spec.name] = cell
            self._show()
        return self.stopped.is_set()

    def ended(self, outcome: Outcome) -> None:
        """Record and print how a cell ended."""
        with self._lock:
            self._running.pop(outcome.name, None)
            self.outcomes[outcome.name] = outcome
            tracked = f"tracked {outcome.row['tracked']:.3f}" if outcome.row else outcome.reason
            say(f"{outcome.state}: {outcome.name}, {tracked}")
            self._show()
            self.write_table()

    def rows(self) -> list[dict]:
        """One row per cell, in the order of the sweep; missing scores are None."""
        return [self._row(cell) for cell in self.cells]

    def write_table(self) -> None:
        """Write sweep.csv."""
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.rows())
        self.out.mkdir(parents=True, exist_ok=True)
        write_atomically(self.out / TABLE_FILE, text.getvalue())

    def _row(self, cell: Cell) -> dict:
        waiting = Outcome(name=cell.spec.name, state="waiting")
        outcome = self.outcomes.get(cell.spec.name, waiting)
        spec, scores = asdict(cell.spec), outcome.row or {}
        return {
            "name": outcome.name,
            "state": outcome.state,
            "reason": outcome.reason,
            **{name: spec[name] for name in SPEC_COLUMNS},
            **{name: scores.get(name) for name in SCORE_COLUMNS},
            "wall_s": scores.get("wall_s", round(outcome.wall_s, 2)),
            "dir": str(cell.path),
            "log": str(cell.log),
        }

    def _good(self, cell: Cell) -> bool:
        outcome = self.outcomes.get(cell.spec.name)
        return outcome is not None and outcome.good

    def _show(self) -> None:
        running = list(self._running.values())
        shares = ", ".join(cell.progress() for cell in running[:SHOWN_RUNNING])
        more = ", ..." if len(running) > SHOWN_RUNNING else ""
        note = f"{len(running)} running: {shares}{more}" if running else ""
        self._bar.update(len(self.outcomes), note)
