"""Compiled code on disk does not outlive the sources that it was made from."""

import os
import subprocess
import sys
from pathlib import Path

from backends import _compiled
from backends._compiled import forget_stale

CALLED = "import numba\n\n@numba.njit\ndef number():\n    return {}\n"
CALLER = """
import numba
from backends.called import number

@numba.njit(cache=True)
def twice():
    return 2 * number()
"""
PACKAGE = """
from pathlib import Path
from forget import forget_stale
forget_stale([Path(__file__).parent])
"""


def test_compiled_code_follows_what_it_calls(tmp_path):
    """Compile a caller anew when the function it calls, in another file, has changed."""
    folder = tmp_path / "backends"
    folder.mkdir()
    (tmp_path / "forget.py").write_text(Path(_compiled.__file__).read_text())
    (folder / "__init__.py").write_text(PACKAGE)
    (folder / "caller.py").write_text(CALLER)
    found = []
    for number in (1, 1, 2):
        (folder / "called.py").write_text(CALLED.format(number))
        os.utime(folder / "called.py", (number, number))
        ask = "from backends.caller import twice as t; print(t(), sum(t.stats.cache_hits.values()))"
        done = subprocess.run(
            [sys.executable, "-c", ask], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        found.append(done.stdout.split())
    assert found == [["2", "0"], ["2", "1"], ["4", "0"]]


def test_compiled_code_outlives_edits_elsewhere(tmp_path):
    """Keep what is compiled when a file changes that it does not come from."""
    for name in ("caller", "called", "other"):
        (tmp_path / f"{name}.py").write_text("import backends.called\n" if name == "caller" else "")
    root = tmp_path / "backends"
    root.mkdir()
    for file in tmp_path.glob("*.py"):
        file.rename(root / file.name)
    forget_stale([root])
    compiled = [root / f"__pycache__/{name}.f-1.py311.nbi" for name in ("caller", "other")]
    for file in compiled:
        file.write_text("")
    (root / "other.py").write_text("# a word\n")
    assert forget_stale([root])
    assert [file.exists() for file in compiled] == [True, False]
    (root / "called.py").write_text("# a word\n")
    assert forget_stale([root])
    assert not compiled[0].exists()


def test_code_is_compiled_where_nothing_can_be_kept(tmp_path):
    """Import and run in a checkout that cannot be written, for a user without a home."""
    folder = tmp_path / "backends"
    folder.mkdir()
    (tmp_path / "forget.py").write_text(Path(_compiled.__file__).read_text())
    (folder / "__init__.py").write_text(
        "from pathlib import Path\nfrom forget import use_writable_cache\n"
        "use_writable_cache(Path(__file__).parent)\n"
    )
    (folder / "called.py").write_text(CALLED.format(3))
    (folder / "caller.py").write_text(CALLER)
    (folder / "__pycache__").write_text("")
    done = subprocess.run(
        [sys.executable, "-B", "-c", "from backends.caller import twice; print(twice())"],
        cwd=tmp_path,
        env={**os.environ, "HOME": "/dev/null", "XDG_CACHE_HOME": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["6"], done.stderr


def test_nothing_is_forgotten_where_nothing_can_be_written(tmp_path):
    """Go on where the folder for compiled code is a file."""
    (tmp_path / "__pycache__").write_text("")
    assert not forget_stale([tmp_path])
