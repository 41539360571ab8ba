"""The README is short, and what it shows runs."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


def test_it_is_read_in_two_minutes():
    """Hold 6 KB at most."""
    assert len(TEXT.encode()) <= 6 * 1024


def test_examples_are_short():
    """Hold ten lines at most in a Python example; `test_docs_commands` runs it."""
    for code in EXAMPLES:
        assert len([line for line in code.splitlines() if line]) <= 10


@pytest.mark.parametrize("target", re.findall(r"\]\(([^)#:]+)\)", TEXT))
def test_links_lead_somewhere(target):
    """Name only files that are there."""
    assert (ROOT / target).exists()
