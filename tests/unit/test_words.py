"""Docs, messages and docstrings use the field's words, and none of the project's private ones.

The list bans private *senses*. A word that is also an ordinary one ("sound", "second", "rest") is
listed only in the phrase that gives it the private sense.
"""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
ROOMS = sorted({name.split(".")[0] for name in _PROJECT["tool"]["setuptools"]["packages"]})
BANNED = {
    r"diagnosis/beside\b|\bbeside\.py": "packets, sensors, skin or grasp",
    r"\b(?:feel|grip|yields|slips|_slip|hearing|_regrasp|_alike|apart|frozen)\.py": "the new file",
    r"\bfeel\(|(?i:\bfe(?:el|els|lt)\b)": "read, measure, touch; identify_skin_faults",
    r"(?i:\bhears?\b|\bheard\b)": "detect; receive (a packet)",
    r"\bListener\b": "LossFit",
    r"(?i:\bregrasp)": "simulate grasps",
    r"(?i:\btold\b)": "given, reported, distinguished",
    r"`Attribution`|\bAttribution\(": "EffectSearch",
    r"`Conditions`|\bConditions\(": "MultiLogEvidence",
    r"`Sound`|\bSound\(": "HealthyBaseline",
    r"(?i:\boutdo(?:es|ne)?\b)": "supersede, exceed",
    r"(?i:\berrands?\b)|\bOrders\b": "DriveCallArgs, motor_step",
    r"(?i:\b(?:un)?bent\b)": "far from its prior, prior z-score",
    r"(?i:\bbelie(?:f|fs|ve|ved|ves)\b)": "prior, prior limit",
    r"(?i:\bunrest\b|\brestless)|\bCALM\b": "chaos, chaotic",
    r"(?i:\bastray\b|\bforgiving\b|\bstray(?:s|ed)?\b)": "prediction spread",
    r"(?i:\bsurprises?\b)": "whiteness z-score",
    r"(?i:\bnews\b|\bwhat is new in (?:a|an|it|each|them|held|residual|sample))": "innovations",
    r"\bexplains\(": "is_adequate()",
    r"(?i:\bleft-?overs?\b|\btaught\b)": "residual structure, cross-validated gain",
    r"(?i:\bfore(?:tell|tells|told|telling)\b)": "predict, predicted",
    r"(?i:\banew\b|\bleapt\b|\bshaken\b)": "again, from the start; multi-start moves",
    r"(?i:\binnocents?\b)": "cases without an effect",
    r"(?i:\bstrangers?\b)": "effects outside the catalogue",
    r"(?i:\bnats (?:behind|ahead)\b|\bbehind,? \[?nats\b)": "log evidence ratio [nats]",
    r"(?i:\blittles\b)": "tolerances",
    r"(?i:\bforeign makes?\b|\b(?:every|same|other|of (?:a|some|which)) make\b)": "plant",
    r"(?i:\bcombs?\b)": "quantisation step",
    r"(?i:\brules? version\b|\brules (?:of )?v?\d\d\b|\bversion [45]\d\b)": "the commit",
    r"(?i:\bso-manieth\b)": "every n-th",
}
"""Private words as regular expressions, and what to say instead."""
PATTERN = re.compile("|".join(f"({pattern})" for pattern in BANNED))
ORDINARY = (
    "a sound robot stands still for a second and for the rest of the log",
    "once again the true value; the second of two new halves instead of the first",
    "we make a table, and every maker of robots makes one; the noise floor",
    "the orders of magnitude, the attribution of a licence, conditions of use",
    "read the CHANGELOG: version 3.11, version 5.4.2",
)
"""Sentences whose words are not private ones."""


def strings(path: Path) -> Iterator[tuple[int, str]]:
    """Line and text of what a user may read: strings with a space, docstrings of what is public."""
    tree = ast.parse(path.read_text())
    public: dict[int, bool] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                public[id(first.value)] = not getattr(node, "name", "").startswith("_")
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and public.get(id(node), " " in text):
            yield node.lineno, text


def texts(part: str) -> Iterator[tuple[Path, int, str]]:
    """File, first line and text of everything in a package, in the docs, or in one page."""
    for path in sorted((ROOT / part).rglob("*.py")) if part in ROOMS else ():
        yield from ((path, line, text) for line, text in strings(path))
    pages = [*(ROOT / part).rglob("*.jinja"), *(ROOT / part).rglob("*.md")]
    for path in [ROOT / part] if part.endswith(".md") else sorted(pages):
        if "policies" not in path.parts:
            yield path, 1, path.read_text()


@pytest.mark.parametrize("part", [*ROOMS, "README.md", "docs"])
def test_no_private_words(part):
    """Say it in the field's words; a breach is named with file, line, word and what to say."""
    breaches = []
    for path, line, text in texts(part):
        for found in PATTERN.finditer(text):
            at = line + text.count("\n", 0, found.start())
            instead = list(BANNED.values())[found.lastindex - 1]
            breaches.append(f"{path.relative_to(ROOT)}:{at}: '{found[0]}'; say: {instead}")
    assert not breaches, "\n".join(breaches)


@pytest.mark.parametrize("sentence", ORDINARY)
def test_ordinary_words_are_allowed(sentence):
    """Let ordinary uses of the same words pass."""
    assert not PATTERN.search(sentence)


def test_private_words_are_seen(tmp_path):
    """Read messages, parts of f-strings and public docstrings, and no private ones."""
    file = tmp_path / "a.py"
    file.write_text(
        'def seen():\n    """It foretells."""\n    raise ValueError(f"{1} nats behind the best")\n'
        'def _hidden():\n    """It foretells."""\n'
    )
    found = [match[0] for _, text in strings(file) for match in PATTERN.finditer(text)]
    assert found == ["foretells", "nats behind"]


NAMES = re.compile(
    r"(?i)(?:^|_)(?:fore)?(told|heard|bent|beliefs?|innocents?|littles|strangers?)(?:_|$)"
)


def names(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of everything that code names."""
    for node in ast.walk(ast.parse(path.read_text())):
        for field in ("name", "id", "attr", "arg"):
            name = getattr(node, field, None)
            if isinstance(name, str):
                yield getattr(node, "lineno", 0), name


@pytest.mark.parametrize("part", [*ROOMS, "tests"])
def test_no_private_words_in_names(part):
    """Name code in the field's words too."""
    files = sorted((ROOT / part).rglob("*.py"))
    found = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in files
        for line, name in names(path)
        if NAMES.search(name)
    ]
    assert not found, "\n".join(found)
