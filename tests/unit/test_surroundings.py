"""What surrounds a command may be odd: closed streams, no git, no optional package."""

import os
import subprocess
import sys

import pytest

BENCH = [sys.executable, "-P", "-m", "benchmark"]


@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)])
def test_closed_streams_are_no_trouble(tmp_path, closed):
    """Run with standard streams closed, and write no word into a file that is opened later."""
    close = "; ".join(f"os.close({number})" for number in closed)
    code = f"import os, sys; {close}; os.execv(sys.executable, sys.argv[1:])"
    words = ["excite", "--out", str(tmp_path / "commands.csv"), "--protocol", "steps"]
    done = subprocess.run(
        [sys.executable, "-c", code, *BENCH, *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "commands.csv").read_text().startswith("episode,")
    assert "Traceback" not in done.stderr


def test_a_reader_that_has_gone_is_no_trouble():
    """End when the pipe is closed, without a trace."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [*BENCH, "list", "--json"], stdout=write, stderr=subprocess.PIPE, text=True, check=False
    )
    os.close(write)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr


def test_provenance_does_without_git(monkeypatch):
    """Say that the commit is unknown."""
    from benchmark.provenance import provenance

    monkeypatch.setenv("PATH", "")
    assert provenance()["commit"] == "unknown"


def test_a_video_names_the_package_that_it_lacks(tmp_path, monkeypatch):
    """Say what to install."""
    from benchmark.errors import CommandError
    from benchmark.pictures._pictures import write_mp4

    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(
        CommandError, match=r"'imageio-ffmpeg', which is not installed.*pip install"
    ):
        write_mp4([], (2, 2), 10, tmp_path / "a.mp4")
