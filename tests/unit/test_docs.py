"""The pages of the docs are short, and each has a place in the menu; the build holds the rest."""

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
LIMIT_BYTES = 12_000
MADE = ("reference/commands/", "reference/effects/", "reference/results")
MADE += ("reference/diagnosis-files", "reference/parts", "reference/python", "reference/faults")
"""Pages that are made when the site is built; that holds their size."""


def name(page: Path) -> str:
    """A page as the menu names it."""
    return page.relative_to(DOCS).with_suffix("").as_posix()


def pages() -> list[Path]:
    """Every page of the site that was written by hand."""
    found = [*DOCS.glob("*.md"), *(p for f in DOCS.glob("[!_]*/") for p in f.rglob("*.md"))]
    return [page for page in found if not name(page).startswith(MADE)]


def test_no_page_is_long() -> None:
    """Hold every page under 12 KB."""
    sizes = {name(page): page.stat().st_size for page in pages()}
    assert {page: size for page, size in sizes.items() if size > LIMIT_BYTES} == {}


def test_menu_names_every_page_once() -> None:
    """Name every page in the menu of the first one, and nothing that does not exist."""
    blocks = re.findall(r"```\{toctree\}\n(.*?)```", (DOCS / "index.md").read_text(), re.DOTALL)
    named = [line for block in blocks for line in block.split() if "/" in line]
    by_hand = [page for page in named if not page.startswith(MADE)]
    assert len(named) == len(set(named))
    assert set(by_hand) == {name(page) for page in pages()} - {"index"}
