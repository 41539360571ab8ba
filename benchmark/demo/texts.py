"""The final output of `bench demo`: the table of engines, what was seen, and what to try next."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from benchmark.demo.log import HIDDEN
from benchmark.demo.plays import Play
from benchmark.settings.run_spec import RunSpec

SCORES = {
    "tracked": ("tracked", ".3f"),
    "held": ("held", ".3f"),
    "p_err_cm": ("p_err [cm]", ".2f"),
    "q_err_deg": ("q_err [deg]", ".2f"),
}
"""Columns of the table and their formats, by the names of the scores."""
POLICY, LOG, PATHS, FILM = "policy", "elbow-log", "paths.png", "hand.mp4"
ABOUT = {
    PATHS: "the paths of the stick's lower end",
    FILM: "a video of the hand in every engine, 10 s",
    "report.html": "the report of the diagnosis",
    "diagnosis.json": "the diagnosis as data",
    POLICY: "the policy, as the folder of a run",
    LOG: "the log that was diagnosed",
}
"""Everything that a demo writes, and what it is."""


def table(plays: Sequence[Play]) -> Table:
    """A row per engine; for a missing engine, how to install it."""
    made = Table(header_style="bold")
    for column in ("engine", *(title for title, _ in SCORES.values())):
        made.add_column(Text(column), no_wrap=True)
    made.add_column("")
    for one in plays:
        scores = one.recording.scores if one.recording else {}
        numbers = (f"{scores[n]:{form}}" if scores else "-" for n, (_, form) in SCORES.items())
        note = "trained in this engine" if one.trained else ""
        made.add_row(one.engine, *numbers, Text(one.reason or note))
    return made


def seen(plays: Sequence[Play], run: RunSpec, found: Mapping) -> list[str]:
    """What was seen: a policy in other engines, and a cause in a log."""
    tracked = {one.engine: one.recording.scores["tracked"] for one in plays if one.recording}
    shares = {engine: f"{100 * share:.0f} % in {engine}" for engine, share in tracked.items()}
    home = shares.pop(run.backend, None)
    policy = [
        f"A policy that was trained in {run.backend} draws an {run.task} with the lower end of a "
        "stick. `tracked` is the share of time in which the end is within 1 cm and the axis "
        "within 5 degrees of the figure"
    ]
    policy += [f"{home}, where it was trained"] if home else []
    policy += [f"{' and '.join(shares.values())}, with the same hand and stick"] if shares else []
    hidden = HIDDEN.replace("=", " of ").replace("@", " on ").replace("deg", " deg")
    return [
        f"{': '.join(policy[:2])}{''.join(f'; {more}' for more in policy[2:])}. "
        "Stickbench measures and explains such gaps.",
        f"A {hidden} was hidden in the log of one joint. The diagnosis: {found['sentence']}",
    ]


def next_commands(run: RunSpec, policy: Path, found: Mapping) -> dict[str, str]:
    """Three commands to try, and what each does."""
    again = {text: what for text, what in found["next"].items() if "diagnose" in text}
    again = again or {"bench list effect": "see what a diagnosis looks for"}
    return {
        f"bench run --backend {run.backend} --task {run.task}": "train such a policy (8 to 16 min)",
        f"bench eval {policy} --backend mujoco --effects none": "evaluate it in the ideal hand",
        **again,
    }


def ending(plays: Sequence[Play], result: Mapping) -> RenderableType:
    """Everything that is printed."""
    left_out = [f"- {name} was not written: {why}" for name, why in result["skipped"].items()]
    written = {path: ABOUT[Path(path).name] for path in result["written"]}
    lines = ["", "What was seen", *(f"- {line}" for line in result["seen"]), *left_out]
    lines += ["", f"Files, written in {result['wall_s']:.0f} s", *_aligned(written, "")]
    lines += ["", "What to try next", *_aligned(result["next"], "# ")]
    head = Text(f"One policy, {result['episodes']} episodes in each engine:")
    return Group(head, table(plays), Text("\n".join(lines)))


def _aligned(texts: Mapping[str, str], mark: str) -> list[str]:
    """A line per text, with its explanation in a second column."""
    width = max(map(len, texts))
    return [f"  {text:{width}}  {mark}{what}" for text, what in texts.items()]
