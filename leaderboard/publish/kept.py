"""What the repository keeps of its results, read once and as it is needed."""

import io
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from leaderboard.blind.add import latest
from leaderboard.blind.history import Line as BlindLine
from leaderboard.blind.history import read_history
from leaderboard.blind.score import Kind, Score
from leaderboard.causes import causes
from leaderboard.causes_files import CAUSES_FILE, read_causes
from leaderboard.causes_files import derived as derived_causes
from leaderboard.rows import read_rows
from leaderboard.tables import Board, Line, board
from leaderboard.transfer_files import EPISODES_FILE, derived, read_sources
from leaderboard.verified import read_verified

USUAL = {
    **{"backend": "mujoco", "effects": "built", "stick": "reference", "algo": "sb3-ppo"},
    **{"observation": "contact-centers", "radius_m": 0.02, "speed": 1.0, "steps": 2_000_000},
    **{"randomize": True, "spread": "paper", "start_spread": 1.0},
}
"""Settings of a policy, where nothing else is said: the paper's, on the reference."""


class KeptError(LookupError):
    """The repository does not keep what a table needs; the message is complete."""


@dataclass(frozen=True)
class Kept:
    """The results below a repository's root."""

    root: Path

    @property
    def leaderboard(self) -> Path:
        """Folder of the rows, the matrices and the leaderboard itself."""
        return self.root / "leaderboard"

    @cached_property
    def board(self) -> Board:
        """The leaderboard of all kept rows."""
        rows, problems = read_rows([self.leaderboard / "results"])
        return board(rows, problems, verified=read_verified(self.leaderboard))

    def line(self, task: str, **changes: Any) -> Line:
        """The policy of a task with the usual settings, but for `changes`; raises KeptError."""
        found = self.lines(task, **changes)
        if len(found) != 1:
            wanted = {"task": task, **USUAL, **changes}
            raise KeptError(f"{len(found)} policies, not one, in leaderboard/results: {wanted}")
        return found[0]

    def lines(self, task: str, **changes: Any) -> list[Line]:
        """The policies of a task with the usual settings, but for `changes`; `...` is any value."""
        wanted = {"task": task, **USUAL, **changes}
        return [
            line
            for line in self.board.lines
            if all(value in (..., line.cells[name]) for name, value in wanted.items())
        ]

    @cached_property
    def transfers(self) -> dict[str, dict[str, bytes]]:
        """What follows from the episodes of each transfer, by its folder and by file."""
        folders = sorted((self.leaderboard / "transfer").glob(f"*/{EPISODES_FILE}"))
        return {file.parent.name: derived(*read_sources(file.parent)) for file in folders}

    @cached_property
    def explained(self) -> dict[str, dict[str, bytes]]:
        """What follows from the episodes of each explained matrix, by its folder and by file."""
        folders = sorted((self.leaderboard / "transfer").glob(f"*/{CAUSES_FILE}"))
        return {file.parent.name: derived_causes(*read_causes(file.parent)) for file in folders}

    def causes(self, name: str) -> pd.DataFrame:
        """What makes the losses of a matrix, from the folder that explains it."""
        return causes(read_causes(self.leaderboard / "transfer" / name)[0])

    def matrix(self, name: str) -> pd.DataFrame:
        """The transfer matrix of a folder."""
        return pd.read_parquet(io.BytesIO(self.transfers[name]["matrix.parquet"]))

    def episodes(self, name: str) -> pd.DataFrame:
        """The episodes of a transfer's folder."""
        return read_sources(self.leaderboard / "transfer" / name)[0]

    def agreement(self, name: str) -> pd.DataFrame:
        """The rank agreement of a folder."""
        return pd.read_csv(io.BytesIO(self.transfers[name]["agreement.csv"])).fillna({"note": ""})

    @cached_property
    def blind_sets(self) -> list[BlindLine]:
        """The history of the blind sets, oldest first."""
        return read_history(self.leaderboard / "blind")

    @cached_property
    def blind_scores(self) -> dict[Kind, dict[str, Score]]:
        """The latest blind scores in full, by kind and by name."""
        return latest(self.leaderboard / "blind")

    @cached_property
    def speed(self) -> dict[str, Any]:
        """What `bench speed --json` measured."""
        return self._json("speed.json")

    @cached_property
    def physics(self) -> dict[str, Any]:
        """What `bench doctor physics --json` found."""
        return self._json("physics.json")

    def _json(self, name: str) -> dict[str, Any]:
        return json.loads((self.leaderboard / name).read_text(encoding="utf-8"))
