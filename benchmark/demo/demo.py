"""`bench demo`: what Stickbench does, in under a minute and without training.

A policy is played in every engine and filmed; meanwhile the log of one joint is diagnosed.
"""

import shutil
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import RenderableType

from benchmark.demo import film, texts
from benchmark.demo.diagnosis import diagnosing
from benchmark.demo.plays import Play, play, trained_in
from benchmark.demo.texts import ABOUT, FILM, LOG, PATHS, POLICY
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.pictures._pictures import Caption

DATA = Path(__file__).parent / "data"
"""The shipped policy and log."""
EPISODES = 10


def demo(out: Path, force: bool) -> tuple[dict, RenderableType]:
    """Play, film and diagnose into the folder `out`; returns the result and its text.

    Raises UsageError if the folder holds an earlier demo, CommandError if the diagnosis fails.
    """
    began_s = time.monotonic()
    _claim(out, force)
    run = trained_in(out / POLICY)
    with diagnosing(out / LOG, out) as log:
        plays = [play(out / POLICY, engine, EPISODES) for engine in registry.usual("backend")]
        skipped = _draw(plays, out)
        found = log.result()
    result = {
        "status": "done",
        "dir": str(out),
        "episodes": EPISODES,
        "engines": [one.row() for one in plays],
        "diagnosis": {key: found[key] for key in ("verdict", "joints", "magnitudes", "sentence")},
        "written": [str(out / name) for name in ABOUT if (out / name).exists()],
        "skipped": skipped,
        "seen": texts.seen(plays, run, found),
        "next": texts.next_commands(run, out / POLICY, found),
        "wall_s": round(time.monotonic() - began_s, 1),
    }
    return result, texts.ending(plays, result)


def _claim(out: Path, force: bool) -> None:
    """Copy policy and log into `out`, which must hold no earlier demo."""
    there = [name for name in ABOUT if (out / name).exists()]
    if there and not force:
        raise UsageError(
            f"{out} holds {there[0]}; choose another --out, or --force to replace an earlier demo"
        )
    for name in there:
        path = out / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for name in (POLICY, LOG):
        shutil.copytree(DATA / name, out / name)


def _draw(plays: Sequence[Play], out: Path) -> dict[str, str]:
    """Write paths and film of the engines that played; returns what was left out and why."""
    recordings = {one.engine: one.recording for one in plays if one.recording is not None}
    if not recordings:
        return dict.fromkeys((PATHS, FILM), "no engine could be run")
    home = next(one.engine for one in plays if one.trained)
    title = f"One policy, trained in {home}, in every engine: {film.DRAWN} of {EPISODES} episodes"
    film.draw_engines(recordings, title, Caption(title=title, source="bench demo"), out / PATHS)
    titles = {
        engine: f"{engine}: tracked {100 * one.scores['tracked']:.0f} %"
        for engine, one in recordings.items()
    }
    try:
        film.film(recordings, titles, out / FILM)
    except CommandError as error:
        return {FILM: str(error)}
    return {}
