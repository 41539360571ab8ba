"""`bench view`: draw a run like the paper's figures, or make a video of it.

The data comes from the state that every engine reports, in the run's fixed evaluation episodes.
Learning curves come from the record of the training.
"""

import dataclasses
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from benchmark.console import Bar, say
from benchmark.errors import UsageError, unknown
from benchmark.pictures import _pictures, _plots
from benchmark.pictures._curve import draw_curves, read_curves
from benchmark.pictures._pictures import Caption
from benchmark.pictures._render import Scene, render
from benchmark.pictures._replay import Recording, replay
from benchmark.provenance import usable_cores
from benchmark.runs import run_folder
from benchmark.settings.run_spec import SETTINGS, RunSpec
from tasks.task import RADIUS_M

SHOWN_EPISODES = 10
SHOWN_S = 2.0
"""Default time at which the hand is shown [s]."""
AFTER_FALL_S = 0.5
"""Duration of a video after the stick has fallen [s]."""
CLOSED_M = 1e-4
"""A figure is closed if it returns to its start within this distance [m]."""
TITLE_WIDTH = 76
"""Characters per line of the title."""
PICTURE_SIZE, VIDEO_SIZE, LOOP_SIZE = (960, 1280), (480, 640), (384, 512)
"""Width and height of the drawn hand [pixels]."""
EVERY = {".mp4": 2, ".gif": 2}
"""Policy steps from one frame of a video to the next, by the file's ending."""
_PLOTS: dict[str, Callable[[Recording, str], Figure]] = {
    "figure": _plots.draw_figure,
    "joints": _plots.draw_joints,
    "touch": _plots.draw_touch,
}
KINDS = (*_PLOTS, "hand", "curve")


def view(
    folders: Sequence[Path],
    out: Path,
    kind: str | None,
    changed: dict,
    episodes: int | None = None,
    time_s: float | None = None,
    workers: int | None = None,
) -> dict:
    """Draw the run in a folder under changed settings to `out`; returns what was drawn.

    `kind` is one of `KINDS`; the default is the hand for a video, else the figure. The episodes are
    the first of the run's evaluation, and the scores are those of these episodes. Learning curves
    take several folders.
    """
    video = out.suffix.lower() in EVERY
    kind = kind or ("hand" if video else "figure")
    _check(folders, out, kind, changed, episodes, time_s)
    if kind == "curve":
        return _view_curves(folders, out)
    (folder,) = folders
    trained = run_folder.run_spec(run_folder.finished_run(folder))
    run = dataclasses.replace(trained, **changed)
    count = episodes or (SHOWN_EPISODES if kind == "figure" else 1)
    recording = replay(run, folder, count, workers or usable_cores())
    title = _title(run, trained, recording)
    caption = Caption(title=" ".join(title.split()), source=_command(folder, out, kind, changed))
    shown: dict = {k: getattr(run, k) for k in ("backend", "task", "algo", "effects", "stick")}
    if video:
        shown |= _film(recording, out)
    elif kind == "hand":
        shown |= _photograph(recording, SHOWN_S if time_s is None else time_s, caption, out)
    else:
        _pictures.write_figure(_PLOTS[kind](recording, title), caption, out)
    drawn = {"status": "done", "written": str(out), "kind": kind}
    return {**drawn, **shown, **recording.scores, "run": str(folder)}


def view_log(folder: Path, diagnosis: Path | None, port: int) -> dict:
    """Show a log beside its worlds in the browser until Ctrl-C; returns where it was shown."""
    from benchmark.gap.overlay import read_overlay
    from benchmark.pictures.live_log import LiveLog

    overlay, said = read_overlay(folder, diagnosis)
    live = LiveLog(overlay, f"{folder.resolve().name}\n{said}", port)
    say(f"open {live.url} in a browser; Ctrl-C ends it")
    live.play()
    return {"status": "done", "kind": "live", "url": live.url, "log": str(folder)}


def view_live(folder: Path, changed: dict, port: int, workers: int | None) -> dict:
    """Show episode 0 of a run in the browser until Ctrl-C; returns where it was shown."""
    from benchmark.pictures.live import Live

    trained = run_folder.run_spec(run_folder.finished_run(folder))
    run = dataclasses.replace(trained, **changed)
    recording = replay(run, folder, 1, workers or usable_cores())
    live = Live(recording, _title(run, trained, recording), port)
    say(f"open {live.url} in a browser; Ctrl-C ends it")
    live.play()
    return {"status": "done", "kind": "live", "url": live.url, "run": str(folder)}


def _view_curves(folders: Sequence[Path], out: Path) -> dict:
    curves = read_curves(folders)
    title = "Learning curves: mean over seeds, and the range from lowest to highest"
    names = " ".join(folder.resolve().name for folder in folders)
    caption = Caption(title=title, source=f"bench view {names} --kind curve --out {out.name}")
    _pictures.write_figure(draw_curves(curves, title), caption, out)
    return {
        "status": "done",
        "written": str(out),
        "kind": "curve",
        "runs": len(folders),
        "curves": len(curves),
    }


def _photograph(recording: Recording, time_s: float, caption: Caption, out: Path) -> dict:
    """The hand at one moment of episode 0 as a PNG."""
    moment = int(np.abs(recording.time_s - time_s).argmin())
    (pixels,) = render(scene_of(recording, (moment,), PICTURE_SIZE))
    _pictures.write_png(Image.fromarray(pixels), caption, out)
    return {"time_s": time_s, "stick_has_fallen": not bool(recording.held[moment, 0])}


def _film(recording: Recording, out: Path) -> dict:
    """Episode 0 in real time as a video; of a GIF, which begins anew when it ends, one lap."""
    kind = out.suffix.lower()
    every, gif = EVERY[kind], kind == ".gif"
    steps = one_lap(recording, every) if gif else filmed(recording, every)
    size = LOOP_SIZE if gif else VIDEO_SIZE
    rate = 1 / (every * recording.spec.timing.policy_s)
    frames = counted(render(scene_of(recording, steps, size)), len(steps))
    if gif:
        _pictures.write_gif(frames, rate, out)
    else:
        _pictures.write_mp4(frames, size, rate, out)
    fallen = not recording.held[-1, 0]
    return {"frames": len(steps), "frames_per_s": rate, "stick_has_fallen": bool(fallen)}


def filmed(recording: Recording, every: int) -> tuple[int, ...]:
    """Every `every`-th step of episode 0, until shortly after a fall."""
    held = recording.held[:, 0].sum()
    last = held + round(AFTER_FALL_S / recording.spec.timing.policy_s)
    return tuple(range(0, min(len(recording.time_s), last), every))


def one_lap(recording: Recording, every: int) -> tuple[int, ...]:
    """One in `every` steps of the last lap, after which a closed figure is where it was.

    All that is filmed where the figure is not closed, or the stick falls.
    """
    steps, lap = filmed(recording, every), recording.period
    reference_m = recording.reference_m[:, 0]
    end, start = reference_m[-lap:], reference_m[-2 * lap : -lap]
    closed = len(start) == len(end) and np.allclose(end, start, atol=CLOSED_M)
    if not (closed and recording.held[-1, 0]):
        return steps
    return tuple(range(len(reference_m) - lap, len(reference_m), every))


def counted(frames: Iterable[np.ndarray], count: int) -> Iterator[np.ndarray]:
    """So many frames under a progress bar."""
    with Bar("draw", count) as bar:
        for number, frame in enumerate(frames, start=1):
            bar.update(number)
            yield frame


def scene_of(recording: Recording, frames: tuple[int, ...], size: tuple[int, int]) -> Scene:
    """What is drawn of episode 0."""
    return Scene(
        spec=recording.spec,
        states=recording.states,
        active=recording.touch.active,
        reference_m=recording.reference_m[:, 0],
        lower_m=recording.lower_m[:, 0],
        first=recording.first,
        frames=frames,
        size=size,
    )


def _title(run: RunSpec, trained: RunSpec, recording: Recording) -> str:
    s = recording.scores
    count = s["episodes"]
    parts = [run.task, run.backend, run.algo, f"{count} episode{'s' * (count > 1)}"]
    pairs = ((trained.task, run.task), (trained.backend, run.backend))
    other = [before for before, now in pairs if before != now]
    if other:
        parts.insert(2, f"trained on {' and '.join(other)}")
    parts += [f"effects {run.effects}"] if run.effects != "built" else []
    parts += [f"{run.stick} stick"] if run.stick != "reference" else []
    parts += [f"radius {100 * run.radius_m:g} cm"] if run.radius_m != RADIUS_M else []
    parts += [f"{run.speed:g} times the pace"] if run.speed != 1 else []
    errors = f"errors {s['p_err_cm']:.2f} cm and {s['q_err_deg']:.1f}°"
    fractions = f"held {100 * s['held']:.0f} %, tracked {100 * s['tracked']:.0f} %"
    what = textwrap.wrap(", ".join(parts), TITLE_WIDTH, break_on_hyphens=False)
    return "\n".join([*what, f"{errors}, {fractions}"])


def _command(folder: Path, out: Path, kind: str, changed: dict) -> str:
    """The command that draws this again, without paths of this machine."""
    given = [one for one in SETTINGS.values() if one.field in changed]
    options = " ".join(f"{one.flag} {one.kind.show(changed[one.field])}" for one in given)
    made = f"bench view {folder.resolve().name} --kind {kind} {options} --out {out.name}"
    return " ".join(made.split())


def _check(
    folders: Sequence[Path],
    out: Path,
    kind: str,
    changed: dict,
    episodes: int | None,
    time_s: float | None,
) -> None:
    """Refuse invalid requests before anything is simulated."""
    if kind not in KINDS:
        raise unknown("kind of picture", kind, KINDS)
    if len(folders) > 1 and kind != "curve":
        raise UsageError(f"--kind {kind} draws one run, but {len(folders)} are given; give one")
    endings = (".png", *EVERY) if kind == "hand" else (".png",)
    if out.suffix.lower() not in endings:
        allowed = " or ".join(endings)
        raise UsageError(f"--out is {out}; allowed with --kind {kind}: a name ending in {allowed}")
    if out.is_dir():
        raise UsageError(f"--out is {out}, which is a folder; give a file name")
    if time_s is not None and (kind != "hand" or out.suffix.lower() in EVERY):
        raise UsageError(f"--time is {time_s:g} s; give it with --kind hand and a .png only")
    if kind == "curve" and (changed or episodes):
        raise UsageError(
            "--kind curve replays nothing; leave out --episodes and options that change the world"
        )
