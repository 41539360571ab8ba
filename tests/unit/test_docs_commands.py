"""What the pages for users show works: the program takes every command, Python blocks run."""

import contextlib
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from benchmark.cli import app as cli
from benchmark.results import versions
from benchmark.settings import quantities
from benchmark.settings.effects import parse_effects
from benchmark.settings.run_spec import SETTINGS, RunSpec, ideal, read_settings

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
OWN_ROBOT = DOCS / "guide/own-robot.md"
FIRST_DIAGNOSIS = DOCS / "start/first-diagnosis.md"
FOLDERS = ("start", "guide", "concepts", "results")
PAGES = [
    ROOT / "README.md",
    *(page for folder in FOLDERS for page in sorted((DOCS / folder).glob("*.md"))),
    DOCS / "reference/log-format.md",
]
"""Pages written by hand; the recipes in `contribute` have a test of their own."""
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?:^ {4}\S.*\n)+", re.MULTILINE)
INLINE = re.compile(r"`bench ([a-z][^`]*)`")
UNITS = {"rate": "Hz", "time": "s", "duration": "s", "threshold": "mm"}
"""Units of options that take a quantity."""
CHEAP = ("--version", "list", "excite")
"""Commands that are run, not only parsed."""
MOST_TERMS = 40
STANDING = {
    '"demo/': "benchmark/demo/data",
    '"leaderboard/': "leaderboard",
    '"transfer/': "leaderboard/transfer/circle-engines",
}
"""What stands in the repository for what a Python block names."""


def blocks(text: str, *languages: str) -> list[str]:
    """Code blocks in these languages; '' takes those that name none or are indented."""
    fenced = [code for language, code in FENCED.findall(text) if language in languages]
    return fenced + (INDENTED.findall(FENCED.sub("", text)) if "" in languages else [])


def commands(text: str) -> Iterator[str]:
    """The calls of `bench` in the blocks of a page; continued lines are joined."""
    for block in blocks(text, "", "sh", "bash", "console"):
        for line in re.sub(r"\\\n\s*", "", block).splitlines():
            line = line.strip().removeprefix("$ ").partition(" > ")[0]
            if line.startswith("bench "):
                yield shlex.join(shlex.split(line, comments=True)[1:])


def shown() -> list[str]:
    """Every command in a block, once."""
    return list(dict.fromkeys(text for page in PAGES for text in commands(page.read_text())))


def parse(words: list[str]) -> dict[str, Any]:
    """The parameters that the program reads from a command's words; raises where it refuses."""
    place = typer.main.get_command(cli.app)
    context = place.make_context("bench", [], resilient_parsing=True)
    while words and hasattr(place, "commands") and not words[0].startswith("-"):
        name, *words = words
        assert name in place.commands, f"no command '{name}'; known: {', '.join(place.commands)}"
        place = place.commands[name]
        group = hasattr(place, "commands")
        context = place.make_context(name, [] if group else words, context, resilient_parsing=group)
    if words and hasattr(place, "commands"):
        context = place.make_context("bench", words)
    return context.params


def check_values(params: dict[str, Any]) -> None:
    """Read what commands read by themselves: settings of a run, effects, quantities."""
    for name, value in params.items():
        setting = SETTINGS.get(name.replace("_", "-"))
        if not value or str(value).isupper():  # a placeholder such as FOUND
            continue
        if name in ("effects", "known_effects"):
            for text in [value] if isinstance(value, str) else value:
                parse_effects(text, ideal(RunSpec.hand, RunSpec.stick).hand)
        elif name in ("backend", "nominal"):
            for one in value.split(","):
                assert one == "all" or versions.split(one)
        elif name == "setting":
            for text in value:
                read_settings(dict(pair.split("=") for pair in text.split(",")))
        elif setting is not None:
            setting.read(value)
        elif name in UNITS:
            quantities.quantity(value, name, UNITS[name])


@pytest.mark.parametrize("text", shown())
def test_the_program_takes_every_command(text: str) -> None:
    """Know the command and its options, and accept their values."""
    with contextlib.suppress(typer.Exit):  # what --version and --help end with
        check_values(parse(shlex.split(text)))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_in_sentences_exist(page: Path) -> None:
    """Know the commands and options that sentences name, however short."""
    for text in INLINE.findall(FENCED.sub("", page.read_text())):
        try:
            parse(shlex.split(text))
        except typer.Exit:
            continue
        except typer.TyperException as error:
            if "Missing" not in error.format_message():
                raise AssertionError(f"bench {text}: {error.format_message()}") from error


@pytest.mark.parametrize("text", [text for text in shown() if text.split()[0] in CHEAP])
def test_cheap_commands_run(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run what takes no time as it is written."""
    monkeypatch.chdir(tmp_path)
    assert cli.call(shlex.split(text)) == 0


def python_blocks() -> list[Any]:
    """Every Python block of the pages, and where it stands."""
    found = [(page, code) for page in PAGES for code in blocks(page.read_text(), "python")]
    return [pytest.param(code, id=f"{page.stem}-{k}") for k, (page, code) in enumerate(found)]


@pytest.mark.parametrize("code", python_blocks())
def test_python_blocks_run(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run every Python block as it is written, on what the demo ships and a matrix that is kept."""
    monkeypatch.chdir(tmp_path)
    for word, folder in STANDING.items():
        code = code.replace(word, f'"{ROOT / folder}/')
    exec(compile(code, "the page", "exec"), {"__name__": "page"})


def test_the_first_log_of_ones_own_is_one() -> None:
    """Show the same arm on both pages, and eight lines that go with it."""
    first, own = FIRST_DIAGNOSIS.read_text(), OWN_ROBOT.read_text()
    (arm,), (lines,), (rows,) = (blocks(first, kind) for kind in ("xml", "yaml", "text"))
    assert [arm] == blocks(own, "xml")
    assert len(lines.splitlines()) == 8
    joints = yaml.safe_load(lines)["mechanism"]["joints"]
    for joint in joints:
        assert f'<joint name="{joint}"' in arm
        assert f"command_rad.{joint},position_rad.{joint}" in rows


def test_the_glossary_stays_short() -> None:
    """Explain no more than forty terms."""
    terms = re.findall(r"\*\*.+?\*\*", (DOCS / "reference/glossary.md").read_text())
    assert len(terms) <= MOST_TERMS
