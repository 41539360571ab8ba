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


@pytest.mark.parametrize("code", EXAMPLES, ids=["training", "diagnosis"])
def test_examples_run(code, tmp_path, monkeypatch):
    """Run every Python example, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    assert len([line for line in code.splitlines() if line]) <= 10
    exec(compile(code, "README.md", "exec"), {})


@pytest.mark.parametrize("target", re.findall(r"\]\(([^)#:]+)\)", TEXT))
def test_links_lead_somewhere(target):
    """Name only files that are there."""
    assert (ROOT / target).exists()
