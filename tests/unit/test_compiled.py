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


def test_nothing_is_forgotten_where_nothing_can_be_written(tmp_path):
    """Go on where the folder for compiled code is a file."""
    (tmp_path / "__pycache__").write_text("")
    assert not forget_stale([tmp_path])
