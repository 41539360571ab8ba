"""`import stickbench as sb`: a few typed names, which a user's files do not hide."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import stickbench as sb

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/guide/*.md"))]
PAGES += [p for p in sorted(ROOT.glob("docs/contribute/*.md")) if p.stem != "backend"]
"""With examples that have types; an engine in ten lines has none."""
_EXAMPLE = re.compile(r"```python\n(.*?)```", re.DOTALL)
EXAMPLES = [code for page in PAGES for code in _EXAMPLE.findall(page.read_text())]


def test_every_name_is_there() -> None:
    """Give what it promises, each with a docstring."""
    assert all(getattr(sb, name).__doc__ for name in sb.__all__)


def test_a_file_of_the_same_name_is_named(tmp_path: Path) -> None:
    """Say which file hides a package, beside a script that imports."""
    (tmp_path / "tasks.py").write_text("")
    (tmp_path / "mine.py").write_text("import stickbench\n")
    command = [sys.executable, "mine.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith("ImportError: ")
    assert f"{tmp_path / 'tasks.py'} hides the package 'tasks' of Stickbench; rename" in last


@pytest.mark.slow
def test_examples_are_typed(tmp_path: Path) -> None:
    """Pass mypy --strict with every example, each as a program."""
    for number, code in enumerate(EXAMPLES):
        (tmp_path / f"example_{number}.py").write_text(code)
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache")]
    for lacking in ("import-untyped", "no-untyped-call"):  # types of other packages
        command += ["--disable-error-code", lacking]
    files = [path.name for path in tmp_path.glob("*.py")]
    env = os.environ | {"PYTHONPATH": str(ROOT)}  # mypy does not follow an editable install
    done = subprocess.run([*command, *files], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
