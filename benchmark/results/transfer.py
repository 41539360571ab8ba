"""`bench transfer`: evaluate finished policies in other worlds, one file per policy and world.

`leaderboard.transfer` makes matrix, intervals and pictures from these files.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
from rich.table import Table

from benchmark.console import say
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.provenance import provenance, usable_cores
from benchmark.results import versions
from benchmark.runs import run_folder
from benchmark.runs.evaluate import EVALUATION_SEED, deploy, write_episodes
from benchmark.settings.run_spec import DEPLOYED, REFERENCE, RunSpec, read_settings
from files.bounded import FileError
from files.tables import read_parquet
from leaderboard.transfer import COLUMNS, IDENTITY, agreement, matrix
from leaderboard.transfer_files import write_transfer
from leaderboard.transfer_text import FLOOR, interval, title

HOME = f"{REFERENCE} {RunSpec.effects}"
"""The reference world, which stands for reality: its engine and effects."""
FLOOR_SEED = EVALUATION_SEED + 1
"""Seed of the other initial states and headings, for the noise floor."""
SETTINGS = tuple(name for name in DEPLOYED if name not in ("backend", "effects"))
"""Settings that may differ between training and deployment, besides engine and effects."""
EVALUATIONS = "evaluations"
"""Folder of the evaluations, in the output folder."""
SUMMARY_FILE, POLICIES = "transfer.json", "policies"
"""What is said of a matrix, and there the policies' folders, as seen from it."""


@dataclass(frozen=True, kw_only=True)
class World:
    """A world to deploy in."""

    fields: Mapping[str, Any]
    """Changed fields of a RunSpec."""
    version: str
    """Of its engine; empty: the one that is installed."""


@dataclass(frozen=True, kw_only=True)
class Policy:
    """A finished run."""

    folder: Path
    spec: RunSpec
    """The run that trained it, or the run of the scripted baseline."""
    sha256: str
    """SHA-256 of the policy file; empty for a scripted baseline."""


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """One policy in one world."""

    policy: Policy
    train: str
    """Name of the world in which the policy was trained."""
    deploy: str
    """Name of the world in which it is evaluated."""
    spec: RunSpec
    """The policy's run, changed to that world."""
    version: str
    """Of the engine; empty: the one that is installed."""
    floor: bool
    """Whether the episodes start from other initial states."""
    episodes: int

    @property
    def seed(self) -> int:
        """Seed of the initial states."""
        return FLOOR_SEED if self.floor else EVALUATION_SEED

    @property
    def file(self) -> str:
        """A file name that is unique to this evaluation."""
        policy = [self.policy.spec.digest, self.policy.sha256]
        version = [self.version] if self.version else []
        text = json.dumps([*policy, *_place(self.spec), self.seed, self.episodes, *version])
        key = hashlib.sha256(text.encode()).hexdigest()[:8]
        floor = "-floor" if self.floor else ""
        return f"{self.policy.spec.name}--{self.spec.backend}{floor}-{key}.parquet"


def transfer(
    sources: Sequence[Path],
    backends: str,
    effects: Sequence[str],
    settings: Sequence[str],
    out: Path,
    episodes: int,
    include_smoke: bool,
    workers: int | None,
) -> tuple[dict, Table]:
    """Evaluate every policy in every world and write the matrix; returns the result.

    Evaluations that `out` already holds are read. A failed one leaves an empty cell and a reason.
    """
    worlds = _worlds(backends, effects, settings)
    policies, left_out = read_policies(sources, include_smoke)
    plan = [item for policy in policies for item in _evaluations(policy, worlds, episodes)]
    frames, problems = [], []
    for number, item in enumerate(plan, 1):
        try:
            frames.append(evaluated(item, out, workers or usable_cores(), f"{number}/{len(plan)}"))
        except CommandError as error:
            problems.append(f"{item.policy.spec.name} in {item.deploy}: {error}")
            say(f"{number}/{len(plan)} {problems[-1]}")
    if all(frame["floor"].all() for frame in frames):
        raise CommandError(f"no policy could be evaluated: {'; '.join(dict.fromkeys(problems))}")
    scores = pd.concat(frames, ignore_index=True)
    files = write_transfer(scores, HOME, [*left_out, *problems], out)
    result, table = _summary(scores, [*files, out / SUMMARY_FILE], left_out, problems)
    result[POLICIES] = [
        os.path.relpath(policy.folder.resolve(), out.resolve()) for policy in policies
    ]
    run_folder.write_atomically(out / SUMMARY_FILE, json.dumps(result, indent=2) + "\n")
    return result, table


def policies_of(matrix: Path) -> list[Path]:
    """The folders of a matrix's policies, as far as they are still where they were."""
    try:
        said = json.loads((matrix / SUMMARY_FILE).read_text())[POLICIES]
        return [folder for one in said if (folder := matrix / one).is_dir()]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _worlds(engines: str, effects: Sequence[str], settings: Sequence[str]) -> dict[str, World]:
    """The deployment worlds: engines x effects, in the policy's own and in every other setting.

    Raises UsageError for an unknown engine or setting.
    """
    every = registry.usual("backend") if engines == "all" else engines.split(",")
    backends = {text.strip(): versions.split(text) for text in every}
    changed = {"": {}, **{f" {text}": _setting(text) for text in settings}}
    return {
        f"{named} {text}{name}": World(
            fields={"backend": backend, "effects": text, **fields}, version=version
        )
        for name, fields in changed.items()
        for text in effects
        for named, (backend, version) in backends.items()
    }


def _setting(text: str) -> dict[str, Any]:
    """Fields of a RunSpec from text such as 'radius=3cm,pace=0.5'; raises UsageError."""
    pairs = [item.strip().partition("=") for item in text.split(",")]
    for name, _, value in pairs:
        if name not in SETTINGS or not value:
            allowed = ", ".join(f"{name}=..." for name in SETTINGS)
            raise UsageError(f"--setting is '{text}'; allowed: {allowed}, several between commas")
    return read_settings({name: value for name, _, value in pairs})


def read_policies(sources: Sequence[Path], include_smoke: bool) -> tuple[list[Policy], list[str]]:
    """The policies in the sources, each once, and the reasons why others are left out."""
    found: dict[str, Policy] = {}
    left_out = []
    for folder in _folders(sources):
        try:
            policy = _policy(folder, include_smoke)
            found.setdefault(policy.spec.digest, policy)
        except CommandError as error:
            left_out.append(str(error))
    if not found:
        raise UsageError(f"no policy to deploy: {'; '.join(left_out)}")
    return list(found.values()), left_out


def _folders(sources: Sequence[Path]) -> Iterator[Path]:
    for source in sources:
        found = sorted(file.parent for file in source.rglob(run_folder.RUN_FILE))
        yield from found or [source]


def _policy(folder: Path, include_smoke: bool) -> Policy:
    """The policy in a run folder; raises CommandError if there is none that can be used."""
    found = run_folder.read_run(folder)
    if found["status"] != "done":
        raise UsageError(f"{folder} is {found['status']}: {found['reason']}")
    run_folder.check_policy(folder, found)
    spec = run_folder.run_spec(found)
    if spec.smoke and not include_smoke:
        raise UsageError(f"{folder} is a smoke run; --include-smoke includes it")
    return Policy(folder=folder, spec=spec, sha256=found["policy_sha256"] or "")


def _evaluations(policy: Policy, worlds: Mapping[str, World], episodes: int) -> list[Evaluation]:
    """All evaluations of a policy: in every world, and again in its own and in the reference."""
    moved = {name: replace(policy.spec, **world.fields) for name, world in worlds.items()}
    version = {name: world.version for name, world in worlds.items()}
    installed = {name: spec for name, spec in moved.items() if not version[name]}
    home = _same(policy.spec, installed) or f"{policy.spec.backend} {policy.spec.effects}"
    moved.setdefault(home, policy.spec)
    again = dict.fromkeys(name for name in (home, HOME) if name in moved)
    places = [(name, False) for name in moved] + [(name, True) for name in again]
    return [
        Evaluation(
            policy=policy,
            train=home,
            deploy=name,
            spec=moved[name],
            version=version.get(name, ""),
            floor=floor,
            episodes=episodes,
        )
        for name, floor in places
    ]


def _same(spec: RunSpec, moved: Mapping[str, RunSpec]) -> str | None:
    """The name of the world that equals a run's own world."""
    own = _place(spec)
    return next((name for name, other in moved.items() if _place(other) == own), None)


def _place(spec: RunSpec) -> tuple[str, str, str, float, float]:
    return spec.backend, spec.world().digest, spec.task, spec.radius_m, spec.speed


def evaluated(item: Evaluation, out: Path, workers: int, number: str) -> pd.DataFrame:
    """The episodes of one evaluation with what identifies them; evaluated unless on disk."""
    path = out / EVALUATIONS / item.file
    if not path.exists():
        floor = ", other initial states" if item.floor else ""
        say(f"{number} {item.policy.spec.name} in {item.deploy}{floor}")
        options = {"episodes": item.episodes, "seed": item.seed, "workers": workers}
        path.parent.mkdir(parents=True, exist_ok=True)
        if item.version:
            versions.evaluate(item.spec, item.version, item.policy.folder, path, **options)
        else:
            write_episodes(deploy(item.spec, item.policy.folder, **options), path)
    spec = asdict(item.policy.spec) | {"algo": item.policy.spec.learner}
    shared = {name: spec[name] for name in (*IDENTITY, "seed")}
    shared |= {"policy": item.policy.spec.name, "train": item.train}
    shared |= {"deploy": item.deploy, "floor": item.floor}
    return _read(path).assign(**shared)[list(COLUMNS)]


def _read(path: Path) -> pd.DataFrame:
    try:
        return read_parquet(path)
    except FileError as error:
        raise CommandError(
            f"an evaluation of before cannot be read: {error}; remove it to evaluate again"
        ) from error


def _summary(
    episodes: pd.DataFrame, files: Sequence[Path], left_out: list[str], problems: list[str]
) -> tuple[dict, Table]:
    lines = matrix(episodes).to_dict("records")
    table = Table(header_style="bold")
    for column in ("policy", "trained in", "deployed in", "seeds", "tracked", "retention", FLOOR):
        table.add_column(column, overflow="fold")
    for line in lines:
        scores = (interval(line, "tracked", 2), interval(line, "retention", 2))
        where = (line["train"], line["deploy"], str(line["seeds"]))
        table.add_row(title(line), *where, *scores, interval(line, "floor", 2))
    return {
        "status": "failed" if problems else "done",
        "written": [str(file) for file in files],
        "reference": HOME,
        "matrix": plain_lines(lines),
        "agreement": plain_lines(agreement(episodes, HOME).to_dict("records")),
        "left_out": left_out,
        "problems": problems,
        "provenance": provenance(),
    }, table


def plain_lines(lines: Iterable[dict]) -> list[dict[str, Any]]:
    """The lines, with None for unknown values."""
    return [
        {name: None if pd.isna(value) else value for name, value in line.items()} for line in lines
    ]
