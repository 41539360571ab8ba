"""Learners, observations, and what training draws."""

from typing import Any

import pandas as pd

from files.plugins import KINDS, parts
from leaderboard._grid import grid
from leaderboard._wording import with_interval
from leaderboard.publish.kept import USUAL, Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import listed, million, shown
from leaderboard.statistics import improvement
from leaderboard.tables import scores_of
from leaderboard.transfer import IDENTITY
from leaderboard.transfer_text import interval

STEPS = 1_000_000
QUICK = f"{USUAL['algo']} epochs=8 gamma=0.98 anneal=0.4 critic=state"
"""The usual learner with what lets it learn in fewer steps."""
FEWER = ("circle", "mujoco"), ("circle", "bullet"), ("eight", "bullet")
"""Tasks and engines where it was tried."""
TRAINING: tuple[tuple[str, dict[str, Any]], ...] = (
    ("worlds around the nominal one, starts of the paper's Algorithm 1", {}),
    ("the nominal world alone (`--no-randomize`)", {"randomize": False}),
    ("worlds around it, a single start (`--start-spread 0`)", {"start_spread": 0.0}),
)
"""What was trained on, and the settings that say so."""
REFERENCE = f"{USUAL['backend']} {USUAL['effects']}"
AS_BUILT = [USUAL["effects"]]
SCORES = ("tracked", "held", "p_err [cm]", "q_err [deg]")


def compared(kept: Kept) -> tuple[list[str], list[str]]:
    """Engines and learners of the circle's policies, the usual learner first."""
    lines = kept.lines("circle", backend=..., algo=..., steps=STEPS)
    algos = {line.cells["algo"] for line in lines}
    engines = sorted({line.cells["backend"] for line in lines})
    return engines, sorted(algos, key=lambda name: (name != USUAL["algo"], name))


@block
def learners(kept: Kept) -> str:
    """Both learners on the circle in every engine."""
    engines, algos = compared(kept)
    rows = []
    for backend in engines:
        for algo in algos:
            cells = kept.line("circle", backend=backend, algo=algo, steps=STEPS).cells
            rows.append((shown(backend), f"`{algo}`", *_with_minutes(cells)))
    return grid(("engine", "learner", *SCORES, "minutes a seed"), rows)


@block
def fewer_steps(kept: Kept) -> str:
    """Tasks in fewer steps."""
    rows = []
    for task, backend in FEWER:
        tried = [line.cells for line in kept.lines(task, backend=backend, algo=QUICK, steps=...)]
        fewest = min(tried, key=lambda cells: cells["steps"])
        for cells in (kept.line(task, backend=backend, steps=STEPS).cells, fewest):
            said = shown(backend), f"`{cells['algo']}`", million(cells["steps"])
            rows.append((task, *said, *_with_minutes(cells)))
    return grid(("task", "engine", "learner", "steps", *SCORES, "minutes a seed"), rows)


@block
def learners_compared(kept: Kept) -> str:
    """How likely a new seed of the first learner beats one of the second."""
    chances = []
    engines, algos = compared(kept)
    for backend in engines:
        lines = [kept.line("circle", backend=backend, algo=a, steps=STEPS) for a in algos[:2]]
        first, second = (scores_of(line.rows, "tracked") for line in lines)
        p = improvement([(first, second)])
        chances.append(f"{p.value:.2f} [{p.low:.2f}, {p.high:.2f}] in {shown(backend)}")
    better, worse = (f"`{algo}`" for algo in algos[:2])
    return f"A new seed of {better} tracks better than one of {worse} with probability " + (
        f"{listed(chances)}."
    )


@block
def learners_elsewhere(kept: Kept) -> str:
    """Both learners on line and eight."""
    head = ("engine", "learner", "steps", "seeds", "line", "eight")
    rows = []
    engines, algos = compared(kept)
    for backend in engines:
        for algo in algos:
            twice = algo == USUAL["algo"] and backend == USUAL["backend"]
            steps = 2 * STEPS if twice else STEPS
            cells = [
                kept.line(task, backend=backend, algo=algo, steps=steps).cells
                for task in ("line", "eight")
            ]
            tracked = [with_interval(line, "tracked", 3) for line in cells]
            count = " and ".join(dict.fromkeys(str(line["seeds"]) for line in cells))
            rows.append((shown(backend), f"`{algo}`", million(steps), count, *tracked))
    return grid(head, rows)


@block
def observations(kept: Kept) -> str:
    """What a policy sees, what it reaches on the reference, and what it keeps elsewhere."""
    known, found = parts(KINDS["observation"]), observed(kept)
    rows = [
        (f"`{name}`", known[name].summary if name in known else "", *_scores(lines, found))
        for name, lines in found.groupby("observation", sort=False)
    ]
    return grid(("observation", "what it is", *SCORES, *_kept_in(found)), rows)


def observed(kept: Kept) -> pd.DataFrame:
    """The usual policies of the circle: a line per observation and world, the best at home first.

    What an observation shows is what its own file says.
    """
    lines = pd.concat([kept.matrix(folder) for folder in kept.transfers], ignore_index=True)
    usual = {name: USUAL[name] for name in IDENTITY if name in USUAL and name != "observation"}
    wanted = {**usual, "task": "circle", "steps": STEPS, "train": REFERENCE}
    same = (lines[list(wanted)] == pd.Series(wanted)).all(axis=1)
    lines = lines[same].drop_duplicates(["observation", "deploy"])
    home = lines[lines["deploy"] == REFERENCE].set_index("observation")["tracked"]
    order = lines["observation"].map(home).sort_values(ascending=False, kind="stable").index
    return lines.loc[order]


@block
def training(kept: Kept) -> str:
    """What training draws, what comes of it on the reference, and what is kept elsewhere."""
    matrix = kept.matrix("circle-training")
    rows = []
    for words, changes in TRAINING:
        wanted = {"randomize": True, "start_spread": 1.0, **changes}
        same = (matrix[list(wanted)] == pd.Series(wanted)).all(axis=1)
        rows.append((words, *_scores(matrix[same], matrix)))
    return grid(("trained on", *SCORES, *_kept_in(matrix)), rows)


def _with_minutes(cells: dict[str, Any]) -> tuple[str, ...]:
    """`SCORES` with their intervals, and the time that a seed took."""
    errors = [with_interval(cells, name, 2) for name in ("p_err_cm", "q_err_deg")]
    scores = (with_interval(cells, "tracked", 3), f"{cells['held']:.3f}", *errors)
    return (*scores, f"{cells['wall_s'] / 60:.1f}")


def _elsewhere(matrix: pd.DataFrame) -> list[str]:
    """The hand as built in other engines, as installed."""
    worlds = sorted({name for name in matrix["deploy"] if "@" not in name})
    return [name for name in worlds if name != REFERENCE and name.split(" ")[1:] == AS_BUILT]


def _kept_in(matrix: pd.DataFrame) -> list[str]:
    return [f"kept in {shown(name.split(' ')[0])}" for name in _elsewhere(matrix)]


def _scores(lines: pd.DataFrame, matrix: pd.DataFrame) -> list[str]:
    """Scores of one kind of policy on the reference, and its retention in the matrix's engines."""
    lines = lines[lines["train"] == REFERENCE]
    by_world = {line["deploy"]: line for line in lines.to_dict("records")}
    home = by_world[REFERENCE]
    return [
        interval(home, "tracked", 2),
        f"{home['held']:.3f}",
        f"{home['p_err_cm']:.2f}",
        f"{home['q_err_deg']:.2f}",
        *(
            interval(by_world[world], "retention", 2) if world in by_world else ""
            for world in _elsewhere(matrix)
        ),
    ]
