"""`bench transfer MATRIX --explain`: deploy again, with one difference of two worlds switched.

What two engines differ in follows from what they say of themselves (`Engine.own`) and from the
effects that change these numbers; two worlds also differ in their effects. An engine that refuses
an effect is left alone: the difference is then switched in the other one.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
from rich.table import Table

from backends.effect import Effect, NumberEffect
from backends.engine import Engine
from benchmark.console import say
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.provenance import provenance, usable_cores
from benchmark.results import transfer
from benchmark.results.transfer import Evaluation, Policy
from benchmark.runs import run_folder
from benchmark.settings.effects import effect_name, effect_text, refuse
from benchmark.settings.run_spec import RunSpec, ideal
from leaderboard.causes import (
    AT_HOME,
    AWAY,
    CAUSES,
    CELL,
    HOME,
    THERE,
    TOGETHER,
    best,
    causes,
    losses,
)
from leaderboard.causes_files import write_causes
from leaderboard.transfer_files import ABOUT_FILE, read_sources
from leaderboard.transfer_text import interval

SUMMARY_FILE = "explain.json"
Effects = dict[tuple[type[Effect], str | None], float]
"""Magnitudes by kind and joint."""


@dataclass(frozen=True, kw_only=True)
class Switch:
    """A world in which one difference is switched."""

    difference: str
    """Name of the effect."""
    switched: str
    """THERE or AT_HOME."""
    spec: RunSpec
    """A run in that world."""


def explain(
    sources: Sequence[Path], out: Path, episodes: int, include_smoke: bool, workers: int | None
) -> tuple[dict, Table]:
    """Explain the losses of a matrix by the policies in the other sources; returns the result.

    Evaluations that `out` already holds are read. Raises UsageError without a matrix or a policy.
    """
    matrix, runs = _sources(sources)
    scores, reference, _ = read_sources(matrix)
    scores = scores[scores["episode"] < episodes]
    policies, left_out = transfer.read_policies(runs, include_smoke)
    by_name = {policy.spec.name: policy for policy in policies}
    frames: list[pd.DataFrame] = []
    problems: list[str] = []
    for cell in losses(scores):
        try:
            frames += _cell(scores, dict(zip(CELL, cell, strict=True)), by_name, out, workers)
        except CommandError as error:
            problems.append(f"{cell[-2]} to {cell[-1]}: {error}")
            say(problems[-1])
    if not frames:
        raise CommandError(f"no loss to explain: {'; '.join(problems) or 'none is large enough'}")
    table = pd.concat(frames, ignore_index=True)
    files = write_causes(table, reference, problems, out)
    return _summary(table, files, [*left_out, *problems], out)


def _sources(sources: Sequence[Path]) -> tuple[Path, list[Path]]:
    """The matrix, and where the policies are; raises UsageError."""
    found = [folder for folder in sources if (folder / ABOUT_FILE).exists()]
    others = [folder for folder in sources if folder not in found]
    if len(found) != 1:
        raise UsageError(
            "--explain takes one folder that 'bench transfer --out' wrote: "
            f"{', '.join(map(str, sources))}"
        )
    if not others and not (others := transfer.policies_of(found[0])):
        raise UsageError(f"the policies of {found[0]} are not where they were; give their folders")
    return found[0], others


def _cell(
    scores: pd.DataFrame,
    cell: Mapping[str, Any],
    policies: Mapping[str, Policy],
    out: Path,
    workers: int | None,
) -> Iterator[pd.DataFrame]:
    """The episodes of a cell: at home, away, and with each difference switched."""
    own = scores[(scores[list(cell)] == pd.Series(cell)).all(axis=1) & ~scores["floor"]]
    home = scores[scores["policy"].isin(own["policy"]) & ~scores["floor"]]
    home = home[home["deploy"] == cell["train"]].assign(deploy=cell["deploy"])
    for name, part in ((HOME, home), (AWAY, own)):
        yield part.assign(difference=name, effects="", switched="")[list(CAUSES)]
    names = list(dict.fromkeys(own["policy"]))
    if missing := [name for name in names if name not in policies]:
        raise UsageError(f"policies are not in the folders given: {', '.join(missing)}")
    for name in names:
        for one in switches(policies[name].spec, cell["train"], cell["deploy"]):
            yield _deployed(one, policies[name], cell, own, out, workers)


def _deployed(
    one: Switch,
    policy: Policy,
    cell: Mapping[str, Any],
    own: pd.DataFrame,
    out: Path,
    workers: int | None,
) -> pd.DataFrame:
    item = Evaluation(
        policy=policy,
        train=cell["train"],
        deploy=cell["deploy"],
        spec=one.spec,
        version="",
        floor=False,
        episodes=own["episode"].nunique(),
    )
    number = f"{cell['train']} to {cell['deploy']}, {one.difference} {one.switched}:"
    found = transfer.evaluated(item, out, workers or usable_cores(), number)
    named = {"difference": one.difference, "effects": one.spec.effects, "switched": one.switched}
    return found.assign(**named)[list(CAUSES)]


def switches(spec: RunSpec, train: str, deploy: str) -> list[Switch]:
    """The worlds in which one difference of two worlds is switched, and all that can be there.

    `spec` is a run of the policy; worlds are named by engine and effects. Raises UsageError for a
    world with a setting or a version of its own.
    """
    home, away = _world(spec, train), _world(spec, deploy)
    found: list[Switch] = []
    together: Effects = {}
    for place, size in differences(home, away).items():
        name = effect_name(place[0](magnitude=0.0))
        if run := _changed(away, {place: size}):
            together[place] = size
            found.append(Switch(difference=name, switched=THERE, spec=run))
        elif run := _changed(home, {place: -size}):
            found.append(Switch(difference=name, switched=AT_HOME, spec=run))
    if len(together) > 1 and (run := _changed(away, together)):
        found.append(Switch(difference=TOGETHER, switched=THERE, spec=run))
    return found


def differences(home: RunSpec, away: RunSpec) -> Effects:
    """Effects that make the deploy world more like the train world."""
    one, other = _effects(home), _effects(away)
    found = {place: one.get(place, 0.0) - other.get(place, 0.0) for place in (*one, *other)}
    engines: list[type[Engine]] = [registry.load("backend", run.backend) for run in (home, away)]
    for name in registry.names("effect"):
        kind = registry.load("effect", name)
        if issubclass(kind, NumberEffect):
            own = [engine.own.get(kind.number, 0.0) for engine in engines]
            found[kind, None] = found.get((kind, None), 0.0) + own[0] - own[1]
    return {place: size for place, size in found.items() if size != 0.0}


def _world(spec: RunSpec, name: str) -> RunSpec:
    """A policy's run in a world of that name."""
    backend, _, effects = name.partition(" ")
    if "@" in backend or " " in effects:
        raise UsageError(f"{name} has a version or a setting of its own; left as it is")
    return replace(spec, backend=backend, effects=effects)


def _effects(run: RunSpec) -> Effects:
    return {(type(effect), effect.joint): effect.magnitude for effect in run.added}


def _changed(run: RunSpec, more: Effects) -> RunSpec | None:
    """A run with these effects more, or None where the engine cannot have them."""
    effects = _effects(run)
    for place, size in more.items():
        effects[place] = effects.get(place, 0.0) + size
    made = [kind(magnitude=size, joint=joint) for (kind, joint), size in effects.items() if size]
    world = ideal(run.hand, run.stick)
    try:
        refuse(made, registry.load("backend", run.backend).support, run.backend)
        text = ",".join(effect_text(effect, world) for effect in made) or "none"
        return replace(run, effects=text)
    except UsageError:
        return None


def _summary(
    episodes: pd.DataFrame, files: Sequence[Path], left_out: list[str], out: Path
) -> tuple[dict, Table]:
    lines = causes(episodes)
    table = Table(header_style="bold")
    for column in ("trained in", "deployed in", "loss", "difference", "switched", "won back"):
        table.add_column(column, overflow="fold")
    for line in best(lines):
        loss = f"{line['home'] - line['away']:.2f}"
        where = (line["train"], line["deploy"], loss, line["difference"], line["switched"])
        table.add_row(*where, interval(line, "won", 2))
    result = {
        "status": "failed" if left_out else "done",
        "written": [str(file) for file in [*files, out / SUMMARY_FILE]],
        "causes": transfer.plain_lines(lines.to_dict("records")),
        "left_out": left_out,
        "provenance": provenance(),
    }
    run_folder.write_atomically(out / SUMMARY_FILE, json.dumps(result, indent=2) + "\n")
    return result, table
