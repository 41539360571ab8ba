"""The pages on result files, from the classes that write or check them."""

import dataclasses
import inspect
import sys
import typing
from collections.abc import Iterator

from _pages._source import doc, read_text, rows, table, to_table


def pages() -> dict[str, str]:
    """The pages on runs and on diagnoses."""
    return {
        "reference/results.md": read_text("results.md", **_run(), **_matrix()),
        "reference/diagnosis-files.md": read_text(
            "diagnosis-files.md", diagnosis=_diagnosis(), figures=_score()
        ),
    }


def _run() -> dict[str, str]:
    from baselines.baseline import Progress
    from benchmark.runs.evaluate import Episodes
    from leaderboard.row import Provenance, Row, Scores

    row = table(
        Row,
        schema="version of the layout",
        reason="why it is not done",
        spec="settings of the run",
        wall_s="time of training and evaluation [s]",
        env_steps_per_s="pace of training",
        policy_sha256="of `policy.onnx`; null without one",
        provenance="where it came from",
    )
    made = table(
        Provenance,
        command="what was typed",
        versions="of engines and learners",
        cores="that could be used",
        commit="of the repository",
    )
    clock = ("wall_s", "number", "Time since the training began [s].")
    return {
        "row": row.replace("None ", "null "),
        "scores": f"{doc(Scores)}\n\n{table(Scores, episodes='their count')}",
        "provenance": made,
        "progress": to_table([*rows(Progress), clock]),
        "episodes": table(Episodes),
    }


def _matrix() -> dict[str, str]:
    from leaderboard.transfer import IDENTITY

    return {"identity": ", ".join(f"`{name}`" for name in IDENTITY)}


def _diagnosis() -> str:
    """The diagnosis, and the parts that it is made of."""
    from diagnosis import Diagnosis

    parts = [f"{doc(Diagnosis)}\n", table(Diagnosis)]
    for part in dict.fromkeys(_parts(Diagnosis)):
        parts += [f"### {part.__name__}\n", f"{doc(part)}\n", table(part)]
    return "\n".join(parts)


def _parts(kind: type) -> Iterator[type]:
    """Dataclasses of the project that a dataclass's shown fields hold."""
    hints = typing.get_type_hints(kind, vars(sys.modules[kind.__module__]))
    for field in dataclasses.fields(kind):
        if field.repr:
            for one in _inside(hints[field.name]):
                yield one
                yield from _parts(one)


def _inside(hint: object) -> Iterator[type]:
    if inspect.isclass(hint) and dataclasses.is_dataclass(hint):
        yield hint
    for inner in typing.get_args(hint):
        yield from _inside(inner)


def _score() -> str:
    from diagnosis.blind.measures import MEASURES

    lines = [f"| `{m.name}` | {m.meaning} |" for m in MEASURES]
    return "\n".join(["| figure | meaning |", "|---|---|", *lines])
