"""Commands killed again and again, taken up each time, and compared with a call that is left alone.

A kill is SIGKILL before an operation that changes a file, or after a share of the time that the
whole call takes. What it leaves is taken up by the command that its message advises, which may be
killed in turn; the last one ends.
"""

import dataclasses
import json
import shutil
import tempfile
import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmark.cli import app
from benchmark.parts import registry
from tests.campaign import bases
from tests.campaign.contents import differing
from tests.campaign.dying import counted, die_after, die_at
from tests.campaign.table import Case
from tests.campaign.watch import KILLED, Outcome, here, watched

OUT = "out"
MOST_KILLS = 8
"""Most kills of one command, one after the other."""
BY_TIME = 0.2
"""Share of the kills that come at a moment."""


@dataclass(frozen=True, kw_only=True)
class Killed:
    """A command that is killed."""

    words: list[str]
    again: list[str]
    """Words that are added when it is taken up."""
    base: Callable[[Path], None] | None = None
    """Writes what it works on."""
    finished: bool = False
    """Whether it begins where a whole call has ended, with --force."""
    often: int = 3
    """How often it has its turn: the quicker, the more often."""


BACKENDS = registry.usual("backend")
RUN = ["run", "--task", "line", "--smoke", "--steps", "512"]
SMALL = {"rollout_steps": 32, "updates": 2, "batch": 32}
"""Hyperparameters that keep a training short, of the learners that have them."""
RECORD = ["record", "--protocol", "steps", "--rate", "50Hz", "--effects", "backlash=1deg@J3"]
DEPLOYED = ["--effects", "none", "--episodes", "2"]
ONE = ["-j", "1", "-q"]


def _settings(algo: str) -> list[str]:
    """Words for a short training; none for what does not learn."""
    known = registry.load("algo", algo).hyperparameters
    names = () if known is None else [field.name for field in dataclasses.fields(known)]
    return [word for name in names if name in SMALL for word in ("--set", f"{name}={SMALL[name]}")]


SETTINGS = {algo: _settings(algo) for algo in registry.names("algo")}
"""Words by baseline."""


def _engines() -> dict[str, Killed]:
    """The commands that start an engine, with each."""
    out = ["--out", OUT, *ONE]
    found: dict[str, Killed] = {}
    for name in BACKENDS:
        on = ["--backend", name]
        for algo, more in SETTINGS.items():
            words = [*RUN, *more, *on, "--algo", algo, *out]
            often = 3 if algo in registry.scripted() else 1
            found[f"run {name} {algo}"] = Killed(words=words, again=["--resume"], often=often)
        found[f"record {name}"] = Killed(words=[*RECORD, *on, *out], again=["--force"])
        words = ["transfer", "run", *on, *DEPLOYED, "--include-smoke", *out]
        found[f"transfer {name}"] = Killed(words=words, again=[], base=bases.run, often=1)
        words = ["eval", "run", *on, *DEPLOYED, *out]
        found[f"eval {name}"] = Killed(words=words, again=[], base=bases.run)
    return found


def _forced() -> dict[str, Killed]:
    """Runs that begin where another has ended."""
    on = ["--backend", "mujoco", "--out", OUT, *ONE]
    return {
        f"run --force {algo}": Killed(
            words=[*RUN, *more, "--algo", algo, *on], again=["--resume"], finished=True, often=1
        )
        for algo, more in SETTINGS.items()
    }


KINDS: Mapping[str, Killed] = {
    **_engines(),
    **_forced(),
    "leaderboard": Killed(
        words=["leaderboard", "run", "--add", "--policies", "--out", OUT],
        again=[],
        base=bases.run,
        often=8,
    ),
    "excite": Killed(words=["excite", "--out", f"{OUT}/commands.csv"], again=["--force"], often=8),
    "import": Killed(
        words=["import", "bam", "bam.json", "--out", OUT],
        again=["--force"],
        base=bases.bam,
        often=8,
    ),
    "view": Killed(
        words=["view", "run", "--kind", "curve", "--out", f"{OUT}/a.png"],
        again=[],
        base=bases.run,
        often=8,
    ),
    "sweep": Killed(
        words=["sweep", "sweep.yaml", "--out", OUT, *ONE], again=[], base=bases.small_sweep, often=1
    ),
    "diagnose": Killed(
        words=["diagnose", "log", "--out", OUT, "-q"], again=[], base=bases.short_log
    ),
    **{
        f"blind make {real}": Killed(
            words=[*bases.MAKE, "--real", real, *bases.PLACES, *ONE], again=[], often=1
        )
        for real in ("presliding", *BACKENDS)
    },
    "blind run": Killed(words=["blind", "run", "set", *ONE], again=[], base=bases.blind_set),
    "blind score": Killed(
        words=["blind", "score", "set", "--answers", "answers.json", "--out", OUT, *ONE],
        again=[],
        base=bases.solved_set,
    ),
}
"""Commands by name."""
QUICK = ("run mujoco hold-still", "record mujoco", "leaderboard", "excite", "import")
"""Those that take little time."""
TURNS = [name for turn in range(8) for name in KINDS if KINDS[name].often > turn]
"""In which order they are killed."""


def case(name: str, seed: int, number: int, shelf: Path) -> Case:
    """Kill a command and what takes it up, and compare what the last one leaves."""
    whole = _whole(name, shelf)
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), number])
    places = [_place(rng, whole) for _ in range(rng.integers(1, MOST_KILLS, endpoint=True))]
    return _killed(name, seed, number, shelf, places)


def operations(name: str, shelf: Path) -> int:
    """How many operations of a whole call change a file."""
    return _whole(name, shelf)["operations"]


def at_operation(name: str, number: int, shelf: Path) -> Case:
    """Kill a command once, before this operation."""
    return _killed(name, 0, number, shelf, [("operation", number)])


def _killed(
    name: str, seed: int, number: int, shelf: Path, places: list[tuple[str, float]]
) -> Case:
    killed, _ = KINDS[name], _whole(name, shelf)
    with tempfile.TemporaryDirectory(prefix="kill-") as place:
        folder = Path(place) / "here"
        _prepare(killed, folder, shelf)
        if killed.finished:
            shutil.copytree(shelf / name / OUT, folder / OUT)
        more, kills = ["--force"] * killed.finished, 0
        for at in places:
            outcome = watched(_dying(_call(killed, more), at), folder)
            if outcome.code != KILLED or outcome.hung:
                break
            more, kills = killed.again, kills + 1
        else:
            outcome = watched(_call(killed, more), folder)
        fault, said = _judged(outcome, differing(folder, shelf / name))
    return Case(
        part="kills",
        kind=name,
        seed=seed,
        number=number,
        kills=kills,
        refused=False,
        fault=fault,
        said=f"{said}; killed at {places[:kills]}",
    )


def _judged(last: Outcome, differs: list[str]) -> tuple[str, str]:
    """The fault of what took up a killed command, if any, and what is to be said."""
    if last.fault or last.code != 0:
        return last.fault or "stuck", (last.said.strip().splitlines() or [""])[-1]
    return ("changed", f"changed: {', '.join(differs)}") if differs else ("", "")


def _whole(name: str, shelf: Path) -> dict:
    """Operations and time [s] of a call that is left alone; what it leaves is on the shelf.

    It is made in this process, so that nothing is loaded or compiled again by those that follow.
    """
    folder, facts = shelf / name, shelf / f"{name}.json"
    if not facts.exists():
        killed = KINDS[name]
        _prepare(killed, folder, shelf)
        if killed.finished:
            here(_call(killed, []), folder)
        call = _call(killed, ["--force"] * killed.finished)
        operations = [0]

        def counting() -> int:
            code, operations[0] = counted(call)
            return code

        began = time.monotonic()
        outcome = here(counting, folder)
        if outcome.code != 0:
            raise RuntimeError(f"{' '.join(killed.words)} failed unkilled: {outcome.said}")
        wall_s = time.monotonic() - began
        facts.write_text(json.dumps({"operations": operations[0], "wall_s": wall_s}))
    return json.loads(facts.read_text())


def _prepare(killed: Killed, folder: Path, shelf: Path) -> None:
    folder.mkdir(parents=True)
    if killed.base is not None:
        bases.copy(killed.base, folder, shelf)


def _call(killed: Killed, more: list[str]) -> Callable[[], int]:
    return lambda: app.call([*killed.words, *more])


def _place(rng: np.random.Generator, whole: dict) -> tuple[str, float]:
    """Where a kill comes."""
    if rng.random() < BY_TIME:
        return "second", round(float(rng.random()) * whole["wall_s"], 3)
    return "operation", int(rng.integers(whole["operations"]))


def _dying(call: Callable[[], int], at: tuple[str, float]) -> Callable[[], int]:
    kind, place = at
    return lambda: die_after(call, place) if kind == "second" else die_at(call, int(place))
