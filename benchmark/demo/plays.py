"""Play one policy in every engine; for a missing engine, say how to install it."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from benchmark.errors import CommandError
from benchmark.pictures._replay import Recording, replay
from benchmark.runs import run_folder
from benchmark.settings.run_spec import RunSpec

_SCORES = ("tracked", "held", "p_err_cm", "q_err_deg")


@dataclass(frozen=True, kw_only=True)
class Play:
    """The result of a policy in one engine."""

    engine: str
    trained: bool
    """Whether the policy was trained in it."""
    recording: Recording | None
    """None where the engine could not be run."""
    reason: str = ""
    """Why it could not, and what to do."""

    def row(self) -> dict:
        """A row of the table, as plain data."""
        scores = self.recording.scores if self.recording else {}
        return {
            "backend": self.engine,
            "trained_here": self.trained,
            "status": "done" if self.recording else "skipped",
            "reason": self.reason,
            **{name: scores.get(name) for name in _SCORES},
        }


def trained_in(policy: Path) -> RunSpec:
    """The settings under which a policy was trained."""
    return run_folder.run_spec(run_folder.read_run(policy))


def play(policy: Path, engine: str, episodes: int) -> Play:
    """The first evaluation episodes of the policy in an engine, on one core."""
    trained = trained_in(policy)
    run = dataclasses.replace(trained, backend=engine)
    recording, reason = None, ""
    try:
        recording = replay(run, policy, episodes, workers=1)
    except CommandError as error:
        reason = str(error)
    home = engine == trained.backend
    return Play(engine=engine, trained=home, recording=recording, reason=reason)
