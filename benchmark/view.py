"""`bench view`: a run's policy replayed in its fixed evaluation episodes, as one picture.

`figure` draws the lower end of the stick as the paper does; `hand` shows the grasp at one moment.
What is drawn comes from the state that every engine reports.
"""

import dataclasses
import os
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmark import _scene, run_folder
from benchmark._replay import Recording, replay
from benchmark.errors import UsageError, unknown
from benchmark.evaluate import EPISODES
from benchmark.provenance import usable_cores
from benchmark.run_spec import RunSpec, within

SHOWN_EPISODES = 10
SHOWN_S = 2.0
"""When the hand is shown unless told [s]."""
TITLE_WIDTH = 76
"""Characters in a line of the title."""
_ACTUAL, _REFERENCE = "tab:blue", "tab:red"


def view(
    folder: Path,
    out: Path,
    kind: str,
    changed: dict,
    episodes: int = SHOWN_EPISODES,
    time_s: float | None = None,
    workers: int | None = None,
) -> dict:
    """Replay the run in `folder` under changed settings and draw it to `out`; what was drawn.

    The episodes are the first of the run's evaluation; the scores are theirs alone.
    """
    _check(out, kind, episodes, time_s)
    source = run_folder.read_run(folder)
    run_folder.check_policy(folder, source)
    if source["status"] != "done":
        raise UsageError(f"{folder} is {source['status']}: {source['reason']}; finish it first")
    trained = run_folder.run_spec(source)
    run = dataclasses.replace(trained, **changed)
    moment_s = SHOWN_S if time_s is None else time_s
    recording = replay(run, folder, episodes, moment_s, workers or usable_cores())
    _write(out, lambda path: _KINDS[kind](recording, _title(run, trained, recording), path))
    shown = {k: getattr(run, k) for k in ("backend", "task", "algo", "effects", "stick")}
    if kind == "hand":
        fallen = not recording.held[recording.moment, 0]
        shown |= {"time_s": moment_s, "stick_has_fallen": bool(fallen)}
    return {"written": str(out), "kind": kind, **shown, **recording.scores, "policy": str(folder)}


def draw_figure(recording: Recording, title: str, path: Path) -> None:
    """Lower end and reference in the X-Y plane [cm], from the grip; a fall is marked."""
    grip = np.array(recording.spec.hand.grip_m)[:2]
    reference_cm = 100 * (recording.reference_m[recording.first :, :, :2] - grip)
    actual_cm = 100 * (recording.lower_m[..., :2] - grip)
    figure = Figure(figsize=(6.4, 6.8), layout="constrained")
    axes = figure.add_subplot()
    reach_cm = [np.abs(reference_cm).max()]
    for e, steps_held in enumerate(recording.held.sum(axis=0)):
        axes.plot(*reference_cm[:, e].T, color=_REFERENCE, lw=1.4, zorder=3, label="reference")
        reach_cm.append(_draw_path(axes, actual_cm[:, e], recording.first, steps_held))
    half = 1.12 * max(reach_cm)
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.set(xlabel="X from the grip [cm]", ylabel="Y from the grip [cm]")
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.25)
    once = {label: line for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    axes.legend(once.values(), once.keys(), loc="upper right", fontsize=9)
    figure.savefig(path, format="png", dpi=150)


def _draw_path(axes: Axes, path_cm: np.ndarray, first: int, steps_held: int) -> float:
    """One episode's path (T, 2) [cm] until its fall; its farthest drawn coordinate [cm]."""
    line = path_cm[first:steps_held]
    axes.plot(*line.T, color=_ACTUAL, lw=0.9, alpha=0.75, label="actual")
    if steps_held < len(path_cm):
        line = np.vstack([line, path_cm[max(steps_held - 1, 0)]])
        axes.plot(*line[-1], "x", color="black", ms=7, mew=1.6, zorder=4, label="dropped")
    return np.abs(line).max()


def draw_hand(recording: Recording, title: str, path: Path) -> None:
    """The hand, the stick, the touched taxels and the reference at one moment of episode 0."""
    reference = recording.reference_m[:, 0]
    moment = _scene.Moment(
        spec=recording.spec,
        state=recording.state,
        reference_m=reference[recording.moment],
        path_m=reference[recording.first :],
    )
    _scene.render(moment, path)


_KINDS: dict[str, Callable[[Recording, str, Path], None]] = {
    "figure": draw_figure,
    "hand": draw_hand,
}


def _title(run: RunSpec, trained: RunSpec, recording: Recording) -> str:
    s = recording.scores
    parts = [run.task, run.backend, run.algo, f"{s['episodes']} episodes"]
    if run.backend != trained.backend:
        parts.insert(2, f"trained on {trained.backend}")
    parts += [f"effects {run.effects}"] if run.effects != "built" else []
    parts += [f"{run.stick} stick"] if run.stick != "reference" else []
    errors = f"errors {s['p_err_cm']:.2f} cm and {s['q_err_deg']:.1f}°"
    fractions = f"held {100 * s['held']:.0f} %, tracked {100 * s['tracked']:.0f} %"
    what = textwrap.wrap(", ".join(parts), TITLE_WIDTH, break_on_hyphens=False)
    return "\n".join([*what, f"{errors}, {fractions}"])


def _check(out: Path, kind: str, episodes: int, time_s: float | None) -> None:
    """Refuse what cannot be drawn before anything is simulated."""
    if kind not in _KINDS:
        raise unknown("kind of picture", kind, _KINDS)
    if kind != "hand" and time_s is not None:
        raise UsageError(f"--time is {time_s:g} with --kind {kind}; give it with --kind hand only")
    within("--episodes", episodes, 1, EPISODES)
    if out.suffix.lower() != ".png":
        raise UsageError(f"--out is {out}; allowed: a file name that ends in .png")
    if out.is_dir():
        raise UsageError(f"--out is {out}, a folder; name a file in it")


def _write(out: Path, draw: Callable[[Path], None]) -> None:
    """Draw under a temporary name, then rename it into place."""
    out.parent.mkdir(parents=True, exist_ok=True)
    temporary = out.with_name(f".{out.name}.tmp")
    try:
        draw(temporary)
        os.replace(temporary, out)
    finally:
        temporary.unlink(missing_ok=True)
