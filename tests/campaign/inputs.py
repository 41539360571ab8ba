"""Files and options, spoilt at random, given to the commands that read them."""

import json
import sys
import tempfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from benchmark.cli import app
from diagnosis.logs.log import LogError, read_log
from diagnosis.replay.nominal import left_out, mjcf_world
from tests.campaign import bases
from tests.campaign.mutate import (
    WORDS,
    Rng,
    pick,
    spoil_bytes,
    spoil_data,
    spoil_lines,
    spoil_network,
    spoil_table,
    spoil_xml,
)
from tests.campaign.table import Case
from tests.campaign.watch import here, watched


@dataclass(frozen=True, kw_only=True)
class Format:
    """A file that somebody may have spoilt."""

    base: Callable[[Path], None]
    """Writes a folder in which everything is in order."""
    file: str
    """The file in it that is spoilt."""
    spoil: Callable[[Rng, bytes], bytes]
    read: Callable[[], int]
    """Reads it, in that folder; an exit code."""


def bench(*words: str) -> Callable[[], int]:
    """A call of a command."""
    return lambda: app.call(list(words))


def as_text(spoil: Callable[[Rng, str], str]) -> Callable[[Rng, bytes], bytes]:
    """A change of text, or now and then of its bytes."""

    def changed(rng: Rng, data: bytes) -> bytes:
        return spoil_bytes(rng, data) if rng.random() < 0.2 else spoil(rng, data.decode()).encode()

    return changed


def json_text(rng: Rng, text: str) -> str:
    """A JSON text with something changed."""
    return json.dumps(spoil_data(rng, json.loads(text)))


def run_text(rng: Rng, text: str) -> str:
    """A run.json with something changed, half of them with a digest that fits."""
    from leaderboard.identity import run_digest

    data = spoil_data(rng, json.loads(text))
    if rng.random() < 0.5 and isinstance(data.get("spec"), dict):
        data["digest"] = run_digest(data["spec"], str(data.get("spec_digest", "")))
    return json.dumps(data)


def yaml_text(rng: Rng, text: str) -> str:
    """A YAML text with a line or a value changed."""
    if rng.random() < 0.5:
        return spoil_lines(rng, text)
    return yaml.safe_dump(spoil_data(rng, yaml.safe_load(text)))


def parquet(rng: Rng, data: bytes) -> bytes:
    """A parquet file with a column changed, or with spoilt bytes."""
    if rng.random() < 0.4:
        return spoil_bytes(rng, data)
    try:
        return spoil_table(rng, pd.read_parquet(pd.io.common.BytesIO(data))).to_parquet(index=False)
    except (ValueError, TypeError, OverflowError):  # nothing that parquet can hold
        return spoil_bytes(rng, data)


def network(rng: Rng, data: bytes) -> bytes:
    """A policy with spoilt parts or bytes."""
    return spoil_bytes(rng, data) if rng.random() < 0.3 else spoil_network(rng, data)


def read_mechanism() -> int:
    """Read the log in this folder and build its mechanism."""
    try:
        log = read_log(Path("log"))
        mjcf_world(log)
        left_out(log)
    except LogError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


ONE = ["-j", "1", "-q"]
EVAL = bench("eval", "run", "--episodes", "1", *ONE)


def sealed_eval() -> int:
    """Evaluate a policy that its run speaks of."""
    bases.seal(Path("run"))
    return EVAL()


def solve_again() -> int:
    """Solve a blind set whose logs may be others than the committed ones."""
    return app.call(["blind", "run", "set", "--anyway", *ONE])


SCORE = bench("blind", "score", "set", "--answers", "answers.json", "--out", "new", *ONE)
BOARD = bench("leaderboard", "run", "--include-smoke", "--out", "board")
FORMATS: Mapping[str, Format] = {
    name: Format(base=base, file=file, spoil=spoil, read=read)
    for name, base, file, spoil, read in (
        ("log.yaml", bases.log, "log/log.yaml", as_text(yaml_text), read_mechanism),
        ("samples.csv", bases.log, "log/samples.csv", as_text(spoil_lines), read_mechanism),
        ("samples.parquet", bases.log_parquet, "log/samples.parquet", parquet, read_mechanism),
        ("MJCF", bases.log, "log/arm.xml", as_text(spoil_xml), read_mechanism),
        ("run.json", bases.run, "run/run.json", as_text(run_text), EVAL),
        ("contract.json", bases.run, "run/contract.json", as_text(json_text), EVAL),
        ("policy.onnx", bases.run, "run/policy.onnx", network, sealed_eval),
        ("row", bases.run, "run/run.json", as_text(run_text), BOARD),
        ("episodes.parquet", bases.run, "run/episodes.parquet", parquet, BOARD),
        ("progress.csv", bases.run, "run/progress.csv", as_text(spoil_lines), BOARD),
        ("verified.json", bases.run, "board/verified.json", as_text(json_text), BOARD),
        ("matrix.csv", bases.run, "board/transfer/a/matrix.csv", as_text(spoil_lines), BOARD),
        ("calibration.yaml", bases.calibration, "calibration.yaml", as_text(yaml_text),
         bench("run", "--backend", "mujoco", "--task", "line", "--calibration", "calibration.yaml",
               "--algo", "hold-still", "--smoke", "--out", "new", "-j", "1", "-q")),
        ("run.json, settings", bases.run, "run/run.json", as_text(run_text),
         bench("run", "--config", "run/run.json", "--algo", "hold-still", "--smoke", "--out",
               "new", "-j", "1", "-q")),
        ("settings.yaml", bases.settings, "settings.yaml", as_text(yaml_text),
         bench("run", "--config", "settings.yaml", "--smoke", "--out", "new", *ONE)),
        ("sweep.yaml", bases.sweep, "sweep.yaml", as_text(yaml_text),
         bench("sweep", "sweep.yaml", "--dry-run", "--out", "new", "-j", "1", "-q")),
        ("BAM recording", bases.bam, "bam.json", as_text(json_text),
         bench("import", "bam", "bam.json", "--out", "new")),
        ("EMPS recording", bases.emps, "emps.mat", spoil_bytes,
         bench("import", "emps", "emps.mat", "--out", "new")),
        ("commitment.json", bases.solved_set, "set/commitment.json", as_text(json_text), SCORE),
        ("answers", bases.solved_set, "answers.json", as_text(json_text), SCORE),
        ("blind case", bases.blind_set, "set/cases/000/case.json", as_text(json_text), solve_again),
        ("blind result", bases.solved_set, "set/results/000.json", as_text(json_text), SCORE),
        ("tried.json", bases.solved_set, "set/tried.json", as_text(json_text), SCORE),
        ("play test", bases.play_test, "play.csv", as_text(spoil_lines),
         bench("import", "play-test", "play.csv", "--out", "new")),
    )
}  # fmt: skip
"""Files by name."""
SMALL = ["--algo", "hold-still", "--smoke", "--out", "new", "-j", "1", "-q"]
COMMANDS: Mapping[str, list[str]] = {
    "run": ["run", "--backend", "mujoco", "--task", "line", "--observation", "pose", "--stick",
            "reference", "--effects", "none", "--radius", "2cm", "--pace", "1", "--seed", "1",
            *SMALL],
    "run, learning": ["run", "--backend", "mujoco", "--task", "line", "--steps", "512", "--smoke",
                      "--set", "lr=1e-3", "--start-spread", "0.5", "--spread", "paper", "--out",
                      "new", "-j", "1", "-q"],
    "eval": ["eval", "run", "--backend", "mujoco", "--task", "circle", "--episodes", "1",
             "--effects", "none", "--stick", "reference", "-j", "1", "-q"],
    "record": ["record", "--backend", "mujoco", "--protocol", "steps", "--rate", "50Hz",
               "--variants", "1", "--repeats", "1", "--seed", "1", "--channels", "motor",
               "--known-effects", "none", "--format", "csv", "--out", "new", "-j", "1", "-q"],
    "excite": ["excite", "--joints", "a,b", "--range=-60:60deg", "--limit", "1Nm", "--rate",
               "100Hz", "--seed", "1", "--protocol", "all", "--out", "new.csv"],
    "transfer": ["transfer", "run", "--backend", "mujoco", "--effects", "none", "--setting",
                 "radius=3cm", "--episodes", "2", "--include-smoke", "--out", "new", "-j", "1",
                 "-q"],
    "leaderboard": ["leaderboard", "run", "--include-smoke", "--out", "new"],
    "view": ["view", "run", "--kind", "curve", "--out", "new.png"],
    "list": ["list", "backend"],
    "sweep": ["sweep", "sweep.yaml", "--dry-run", "--out", "new", *ONE],
    "import": ["import", "bam", "bam.json", "--out", "new"],
    "diagnose": ["diagnose", "log", "--out", "new", "-q"],
    "blind make": ["blind", "make", "--out", "new", "--answers", "new.json", "--cases", "1",
                   "--real", "presliding", "--rig", "joint", "--modes", "single", "--seed", "3",
                   "--healthy-logs", "0", *ONE],
    "blind score": ["blind", "score", "set", "--answers", "answers.json", "--out", "new", *ONE],
    "speed": ["speed", "--backend", "mujoco", "--worlds", "4", "-j", "1", "--duration", "100ms"],
}  # fmt: skip
"""Commands whose words are spoilt."""
BOUNDS = {
    "run": [["--smoke"]],
    "eval": [["--episodes", "1"]],
    "transfer": [["--episodes", "2"]],
    "record": [["--protocol", "steps"], ["--variants", "1"], ["--repeats", "1"]],
}
"""What keeps them short is given again where it was spoilt."""


def spoilt_file(name: str, rng: Rng | None, folder: Path, shelf: Path) -> Callable[[], int]:
    """Put a copy of a format's folder into `folder`, spoil its file, and give what reads it.

    Without a generator nothing is spoilt.
    """
    kind = FORMATS[name]
    bases.copy(kind.base, folder, shelf)
    file = folder / kind.file
    if rng is not None:
        file.write_bytes(kind.spoil(rng, file.read_bytes()))
    return kind.read


def spoilt_words(name: str, rng: Rng | None, folder: Path, shelf: Path) -> Callable[[], int]:
    """The command of this name with one or two words replaced, and all it may act on in `folder`.

    Without a generator nothing is spoilt.
    """
    for base in bases.EVERYTHING:
        bases.copy(base, folder, shelf)
    words = list(COMMANDS[name.removeprefix("bench ")])
    for _ in range(0 if rng is None else int(rng.integers(1, 3))):
        words[int(rng.integers(1, len(words)))] = str(pick(rng, WORDS))
    for bound in BOUNDS.get(words[0], []):
        words += [] if bound[0] in words else bound
    return bench(*words)


KINDS = {
    **dict.fromkeys(FORMATS, spoilt_file),
    **{f"bench {name}": spoilt_words for name in COMMANDS},
}
"""What is spoilt, and how, by name."""
QUICK = (
    *("log.yaml", "samples.csv", "samples.parquet", "MJCF", "contract.json", "policy.onnx", "row"),
    *("progress.csv", "sweep.yaml", "BAM recording", "EMPS recording", "play test"),
)
"""Those that take no time."""
TURNS = list(KINDS)
"""In which order they are spoilt."""


def case(name: str, seed: int, number: int, shelf: Path) -> Case:
    """Spoil one thing and see what its reader does; good folders are kept on the shelf."""
    _prove(name, shelf)
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), number])
    with tempfile.TemporaryDirectory(prefix="input-") as place:
        outcome = watched(KINDS[name](name, rng, Path(place), shelf), Path(place))
    lines = outcome.said.strip().splitlines()
    return Case(
        part="inputs",
        kind=name,
        seed=seed,
        number=number,
        refused=outcome.code in (1, 2),
        fault=outcome.fault,
        said=lines[-1] if lines else "",
    )


def _prove(name: str, shelf: Path) -> None:
    """Raise RuntimeError unless what is not spoilt is taken.

    That is asked in this process, so that nothing is loaded or compiled again by what follows.
    """
    proof = shelf / f"{name}.proven"
    if not proof.exists():
        with tempfile.TemporaryDirectory(prefix="input-") as place:
            outcome = here(KINDS[name](name, None, Path(place), shelf), Path(place))
        if outcome.code != 0:
            raise RuntimeError(f"{name} is refused though nothing is wrong: {outcome.said}")
        proof.touch()
