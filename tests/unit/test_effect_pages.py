"""The pages on effects say of every effect what they promise, with its number, unit and bounds."""

import re
from pathlib import Path

import pytest

from backends.effect import UNITS, Effect
from benchmark import registry

PAGES = Path(__file__).resolve().parents[2] / "docs" / "effects"
KINDS: dict[str, type[Effect]] = {
    name: registry.load("effect", name) for name in registry.names("effect")
}
SAYS = ("Law", "Source", "Hardware", "Log", "Confused with")


def sections() -> dict[str, str]:
    """Text of every effect's section by its name."""
    found: dict[str, str] = {}
    for page in sorted(PAGES.glob("*.md")):
        if page.name != "README.md":
            for part in re.split(r"^## ", page.read_text(), flags=re.MULTILINE)[1:]:
                name, _, text = part.partition("\n")
                assert name not in found, f"{name} has two sections"
                found[name] = text
    return found


def test_every_effect_has_its_section() -> None:
    """Describe every effect once, and none that does not exist."""
    assert set(sections()) == set(KINDS)


@pytest.mark.parametrize("name", KINDS)
def test_section_says_what_it_promises(name: str) -> None:
    """Name the number, the bounds in the usual unit, and every point of the list."""
    kind, text = KINDS[name], sections()[name]
    size = UNITS[kind.unit][1]
    low, high = (f"{bound / size:g}" for bound in kind.bounds)
    assert f"`{kind.spec_fields()[0]}`" in text
    assert f"{low} to {high} {kind.unit}" in text
    said = re.findall(r"^- \*\*(.+?)\.\*\* \S", text, flags=re.MULTILINE)
    assert said == list(SAYS)


def test_index_lists_every_effect_on_its_page() -> None:
    """Name in the index every effect in the row of the page that describes it."""
    index = (PAGES / "README.md").read_text()
    for page in PAGES.glob("*.md"):
        if page.name != "README.md":
            row = re.search(rf"\]\({page.name}\) \| (.+) \|", index)
            assert row is not None, page.name
            described = re.findall(r"^## (\S+)$", page.read_text(), flags=re.MULTILINE)
            assert row[1].split(", ") == described
