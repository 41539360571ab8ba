"""`bench view`: a run's policy replayed in its fixed evaluation episodes, as one picture.

`figure` draws the lower end of the stick as the paper does; `hand` shows the grasp at one moment.
What is drawn comes from the state that every engine reports.
"""

import dataclasses
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from backends.shard import WorkerError
from backends.spec import Spec
from backends.state import Array, State
from baselines.saved import PolicyError
from benchmark import _scene, run_folder
from benchmark.console import Bar
from benchmark.errors import CommandError, UsageError, unknown
from benchmark.evaluate import EPISODES, evaluate
from benchmark.provenance import usable_cores
from benchmark.run import _actor
from benchmark.run_spec import RunSpec, _within, make_env
from tasks.batch import BatchEnv, SimulationDivergedError, Step
from tasks.task import EPISODE_S

SHOWN_EPISODES = 10
SHOWN_S = 2.0
"""When the hand is shown unless told [s]."""
_LAPS = ("circle",)
"""Tasks that repeat one closed lap: their entry is left out, as in the paper's figure."""
_ACTUAL, _REFERENCE = "tab:blue", "tab:red"


@dataclass(frozen=True, kw_only=True)
class Recording:
    """T policy steps of E episodes."""

    spec: Spec
    """The world that was simulated."""
    first: int
    """Step from which the figure is drawn."""
    lower_m: Array
    """Lower end of the stick [m], world frame, shape (T, E, 3)."""
    reference_m: Array
    """Drawn point [m], world frame, shape (T, E, 3)."""
    held: Array
    """Whether the stick has not fallen so far, shape (T, E), bool."""
    moment: int
    """The step whose state was kept."""
    state: State
    """Episode 0 at that step: arrays of one world."""
    scores: dict[str, float]
    """Means over these episodes, and their count."""


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

    The initial states follow from the number of episodes: the run's own 100 need `episodes` 100.
    """
    if kind not in _KINDS:
        raise unknown("kind of picture", kind, _KINDS)
    if kind != "hand" and time_s is not None:
        raise UsageError(f"--time is {time_s:g} with --kind {kind}; give it with --kind hand only")
    _within("--episodes", episodes, 1, EPISODES)
    _check_file(out)
    source = run_folder.read_run(folder)
    run_folder.check_policy(folder, source)
    if source["status"] != "done":
        raise UsageError(f"{folder} is {source['status']}: {source['reason']}; finish it first")
    trained = run_folder.run_spec(source)
    run = dataclasses.replace(trained, **changed)
    time_s = SHOWN_S if time_s is None else time_s
    recording = replay(run, folder, episodes, time_s, workers or usable_cores())
    _write(out, lambda path: _KINDS[kind](recording, _title(run, trained, recording), path))
    shown = {k: getattr(run, k) for k in ("backend", "task", "algo", "effects", "stick")}
    return {"written": str(out), "kind": kind, **shown, **recording.scores, "policy": str(folder)}


def replay(run: RunSpec, policy: Path, episodes: int, time_s: float, workers: int) -> Recording:
    """Evaluate a policy and keep what is drawn; `time_s` is the moment whose state is kept [s]."""
    world = run.world()
    _within("--time", time_s, world.timing.policy_s, EPISODE_S)
    moment = round(time_s / world.timing.policy_s) - 1
    env = make_env(run, [world] * episodes, seed=0, workers=workers)
    lower, reference, fallen, states = [], [], [], []
    try:
        with Bar(f"replay {run.backend} {run.task}", env.horizon) as bar:

            def on_step(env: BatchEnv, step: Step) -> None:
                if len(lower) == moment:
                    states.append(_first_world(env.state))
                lower.append(env.lower_end())
                reference.append(env.reference()[0])
                fallen.append(step.terminated)
                bar.update(len(lower))

            scores = evaluate(env, _actor(run, policy, env), on_step).scores()
        lap_s = 2 * math.pi / env.task.rate_rad_s
        laps = run.task in _LAPS and 2 * lap_s <= EPISODE_S
        return Recording(
            spec=world,
            first=round(lap_s / env.policy_s) if laps else 0,
            lower_m=np.stack(lower),
            reference_m=np.stack(reference),
            held=~np.logical_or.accumulate(np.stack(fallen)),
            moment=moment,
            state=states[0],
            scores=scores,
        )
    except PolicyError as error:
        raise UsageError(str(error)) from error
    except (SimulationDivergedError, WorkerError) as error:
        raise CommandError(f"the replay on {run.backend} stopped: {error}") from error
    finally:
        env.close()


def _first_world(state: State) -> State:
    one = state.rows(slice(0, 1))
    return State(**{f.name: getattr(one, f.name).copy() for f in dataclasses.fields(one)})


def _title(run: RunSpec, trained: RunSpec, recording: Recording) -> str:
    s = recording.scores
    parts = [run.task, run.backend, run.algo, f"{s['episodes']} episodes"]
    if run.backend != trained.backend:
        parts.insert(2, f"trained on {trained.backend}")
    parts += [f"effects {run.effects}"] if run.effects != "built" else []
    parts += [f"{run.stick} stick"] if run.stick != "reference" else []
    errors = f"errors {s['p_err_cm']:.2f} cm and {s['q_err_deg']:.1f}°"
    fractions = f"held {100 * s['held']:.0f} %, tracked {100 * s['tracked']:.0f} %"
    return f"{', '.join(parts)}\n{errors}, {fractions}"


def draw_figure(recording: Recording, title: str, path: Path) -> None:
    """Lower end and reference in the X-Y plane [cm], from the grip; a fall is marked."""
    grip = np.array(recording.spec.hand.grip_m)[:2]
    actual_cm = 100 * (recording.lower_m[..., :2] - grip)
    reference_cm = 100 * (recording.reference_m[recording.first :, :, :2] - grip)
    figure = Figure(figsize=(6.4, 6.8), layout="constrained")
    axes = figure.add_subplot()
    shown = [reference_cm.reshape(-1, 2)]
    for e in range(actual_cm.shape[1]):
        steps_held = int(recording.held[:, e].sum())
        line = actual_cm[recording.first : steps_held, e]
        axes.plot(*line.T, color=_ACTUAL, lw=0.9, alpha=0.75, label=None if e else "actual")
        shown.append(line)
        if steps_held < len(actual_cm):
            end = actual_cm[max(steps_held - 1, 0), e]
            axes.plot(*end, "x", color="black", ms=7, mew=1.6, zorder=4, label="dropped")
            shown.append(end[None])
    for e in range(reference_cm.shape[1]):
        label = None if e else "reference"
        axes.plot(*reference_cm[:, e].T, color=_REFERENCE, lw=1.6, zorder=3, label=label)
    half = 1.12 * np.abs(np.concatenate(shown)).max()
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.set(xlabel="X from the grip [cm]", ylabel="Y from the grip [cm]")
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.25)
    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(handles.values(), handles.keys(), loc="upper right", fontsize=9)
    figure.savefig(path, format="png", dpi=150)


def draw_hand(recording: Recording, title: str, path: Path) -> None:
    """The hand, the stick, the touched taxels and the reference at one moment of episode 0."""
    reference = recording.reference_m[:, 0]
    scene = _scene.Moment(
        spec=recording.spec,
        state=recording.state,
        reference_m=reference[recording.moment],
        path_m=reference[recording.first :],
    )
    _scene.render(scene, path)


_KINDS: dict[str, Callable[[Recording, str, Path], None]] = {
    "figure": draw_figure,
    "hand": draw_hand,
}


def _check_file(out: Path) -> None:
    if out.suffix.lower() != ".png":
        raise UsageError(f"--out is {out}; allowed: a file name that ends in .png")
    if out.is_dir():
        raise UsageError(f"--out is {out}, a folder; name a file in it")
    out.parent.mkdir(parents=True, exist_ok=True)


def _write(out: Path, draw: Callable[[Path], None]) -> None:
    """Draw under a temporary name, then rename it into place."""
    temporary = out.with_name(f".{out.name}.tmp")
    try:
        draw(temporary)
        os.replace(temporary, out)
    finally:
        temporary.unlink(missing_ok=True)
