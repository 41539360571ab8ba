"""Pages in a browser: tables are sorted, filtered and downloaded, on a phone as on a desk."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Page, browser, until

import diagnosis
from benchmark.gap.overlay import read_overlay
from benchmark.pictures._live_browser import Browser
from benchmark.pictures._replay import replay
from benchmark.runs.run import run
from benchmark.settings.run_spec import RunSpec

ROOT = Path(__file__).resolve().parents[2]
BOARD = ROOT / "leaderboard/leaderboard.html"
LOG = ROOT / "benchmark/demo/data/elbow-log"
ROWS = "[...document.querySelectorAll('table tr:not(:first-child)')]"
TABLE = "document.querySelectorAll('table')[1]"
"""One with several policies."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A browser's window."""
    with browser(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture
def board(page: Page) -> Page:
    """The leaderboard."""
    page.open(BOARD.as_uri())
    return page


def column(page: Page, name: str) -> list[float]:
    """The numbers of a column of the table, from above."""
    cells = (
        f"[...{TABLE}.rows].slice(1).map(r => [...r.cells].find(c => c.dataset.label === '{name}'))"
    )
    shown = page.run(f"{cells}.map(c => parseFloat(c.textContent))")
    return [number for number in shown if number is not None]


def test_a_click_on_a_head_sorts(board: Page) -> None:
    """Sort by a column of numbers, and the other way round with the next click."""
    before = column(board, "q_err [deg]")
    head = f"[...{TABLE}.rows[0].cells].find(c => c.textContent.trim() === 'q_err [deg]')"
    board.click(head)
    first = column(board, "q_err [deg]")
    board.click(head)
    assert sorted(before) != before and len(before) > 3
    ways = (sorted(before), sorted(before, reverse=True))
    assert {tuple(first), tuple(column(board, "q_err [deg]"))} == set(map(tuple, ways))


def test_words_filter_the_rows(board: Page) -> None:
    """Show the rows that have every word, in their text or as their task, and all rows again."""
    every = board.run(f"{ROWS}.length")
    board.click("document.getElementById('filter')")
    board.ask("Input.insertText", text="circle rsl-ppo")
    shown = board.run(f"{ROWS}.filter(r => r.offsetParent).map(r => r.textContent)")
    assert 0 < len(shown) < every
    assert all("rsl-ppo" in text for text in shown)
    board.run("document.getElementById('filter').select()")
    board.ask("Input.insertText", text=" ")
    assert board.run(f"{ROWS}.filter(r => r.offsetParent).length") > len(shown)


def test_rows_are_downloaded(board: Page, tmp_path: Path) -> None:
    """Give all rows as the CSV that is kept, and a table as it is sorted."""
    board.ask("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    board.click("document.querySelector('a[download=\"leaderboard.csv\"]')")
    whole = tmp_path / "leaderboard.csv"
    until(whole.exists)
    assert whole.read_text() == (BOARD.parent / "leaderboard.csv").read_text()
    board.click("document.querySelectorAll('a[download=\"table.csv\"]')[1]")
    until((tmp_path / "table.csv").exists)
    head, *rows = csv.reader(io.StringIO((tmp_path / "table.csv").read_text()))
    assert "tracked" in head and len(rows) == board.run(f"{TABLE}.rows.length - 1")
    assert {len(row) for row in rows} == {len(head)}


@pytest.fixture(scope="module", params=["leaderboard", "report"])
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Each of the pages that are written, by its address."""
    if request.param == "leaderboard":
        return BOARD.as_uri()
    log = diagnosis.read_log(LOG)
    file = tmp_path_factory.mktemp("report") / "report.html"
    file.write_text(diagnosis.page(diagnosis.diagnose(log), log, {"log": "elbow"}))
    return file.as_uri()


@pytest.mark.parametrize("width", [390, 1400])
def test_nothing_is_off_the_screen(page: Page, written: str, width: int) -> None:
    """Fit every table into the window, but for the map, which moves in a frame of its own."""
    page.open(written, width)
    assert page.run("document.documentElement.scrollWidth") <= width
    beyond = f"[...r.cells].some(c => c.getBoundingClientRect().right > {width})"
    assert page.run(f"{ROWS}.filter(r => !r.closest('.heat') && {beyond}).length") == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_is_as_dark_as_asked(page: Page, written: str, scheme: str) -> None:
    """Take the scheme of the system."""
    asked = [{"name": "prefers-color-scheme", "value": scheme}]
    page.ask("Emulation.setEmulatedMedia", features=asked)
    page.open(written)
    light = float(np.median(page.picture()[..., :3]))
    page.ask("Emulation.setEmulatedMedia", features=[])
    assert light > 0.9 if scheme == "light" else light < 0.15


def live_run(folder: Path) -> Browser:
    """A run that trained nothing, in another engine than the reference."""
    from benchmark.pictures.live import Live

    spec = RunSpec(backend="bullet", task="circle", algo="hold-still", steps=0, smoke=True)
    run(spec, folder, workers=1)
    return Live(replay(spec, folder, episodes=1, workers=1), "a circle", port=0)


def live_log(folder: Path) -> Browser:
    """A log beside its nominal world."""
    from benchmark.pictures.live_log import LiveLog

    return LiveLog(read_overlay(LOG, None)[0], "an elbow", port=0)


@pytest.mark.slow
@pytest.mark.parametrize("make", [live_run, live_log])
def test_a_live_view_follows_its_slider(make, page: Page, tmp_path: Path) -> None:
    """Draw the scene, and another one where the slider is moved in the browser."""
    pytest.importorskip("viser")
    live = make(tmp_path / "run")
    page.open(live.url, 1000, 700)
    slider = "document.querySelector('[role=slider]')"
    until(lambda: page.run(f"!!{slider}") and live.server.get_clients())
    before = drawn(page)
    page.click(f"{slider}.parentElement")  # the middle of its track
    until(lambda: live.slider.value > 0)
    assert until(lambda: np.abs(drawn(page) - before).max() > 0.2)
    live.server.stop()


def drawn(page: Page) -> np.ndarray:
    """The scene, beside controls and notes, once it is drawn and stands still."""
    seen = [page.picture()[200:, :650]]

    def still() -> bool:
        seen.append(page.picture()[200:, :650])
        return bool(np.ptp(seen[-1]) > 0.5 and np.array_equal(*seen[-2:]))

    until(still)
    return seen[-1]
