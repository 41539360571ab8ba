"""Tables and pictures are those of the kept results, and every edit by hand is found."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from files.plugins import KINDS, parts
from leaderboard._chart import Panel, Series, Ticks, chart
from leaderboard.publish import figures
from leaderboard.publish.blocks.learning import STEPS, compared, observed
from leaderboard.publish.files import pages, stale
from leaderboard.publish.kept import Kept
from leaderboard.publish.markers import MarkerError, bare, fill
from leaderboard.publish.registry import BLOCKS

ROOT = Path(__file__).resolve().parents[2]
RESULTS = sorted((ROOT / "docs/results").glob("*.md"))
MAX_BYTES = 12_000
SHOWING = (
    *("docs/results/speed.md", "docs/results/images/speed.svg", "docs/results/images/eight.png"),
    "leaderboard/leaderboard.html",
)
"""Files that show what the test of edits changes in `leaderboard`."""
ROW = '"rows": [{"backend": "bullet", "envs":'


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    """The parts of the repository that hold results."""
    root = tmp_path_factory.mktemp("copy")
    for part in ("leaderboard", "docs"):
        shutil.copytree(ROOT / part, root / part, ignore=shutil.ignore_patterns("*.py", "__*"))
    shutil.copy(ROOT / "README.md", root)
    return root


def test_engines_and_learners_are_those_of_the_rows():
    """Compare whatever learners and engines rows of the circle are kept of."""
    kept = Kept(ROOT)
    line = kept.line("circle", steps=STEPS)
    new = replace(line, cells={**line.cells, "backend": "newton", "algo": "my-a2c"})
    before, more = compared(kept), Kept(ROOT)
    vars(more)["board"] = replace(kept.board, lines=(*kept.board.lines, new))
    engines, algos = compared(more)
    assert engines == sorted([*before[0], "newton"])
    assert algos[0] == line.cells["algo"] and set(algos) == {*before[1], "my-a2c"}


def test_observations_are_those_of_the_kept_transfers():
    """Show whatever observation policies are kept of, what it is, and where it was deployed."""
    kept, more = Kept(ROOT), Kept(ROOT)
    one = observed(kept)
    one = one[one["observation"] == "pose"].assign(observation="my-own", tracked=0.99)
    own = {"matrix.parquet": one.to_parquet(index=False)}
    vars(more)["transfers"] = {**kept.transfers, "own": own}
    before, after = (BLOCKS["observations"](each).splitlines() for each in (kept, more))
    assert [line for line in after if line not in before] == [after[2]]
    assert after[2].startswith("| `my-own` |  | 0.99 ") and after[2].count("|") == after[0].count(
        "|"
    )
    said = [part.summary for part in parts(KINDS["observation"]).values()]
    assert all(line.split("|")[2].strip() in said for line in before[2:])


def test_every_edit_is_found_and_nothing_else(copy):
    """Make every table and picture again; name the files that one changed, and no other."""
    edits = {
        "README.md": ("| wanted | 0.95", "| wanted | 0.90"),
        "docs/results/paper.md": ("| circle | 3 x 100 ✓ | 0.8", "| circle | 3 x 100 ✓ | 0.9"),
        "docs/results/images/blind.svg": ('cy="', 'cy="1'),
        "leaderboard/leaderboard.md": ("| MuJoCo |", "| Mujoco |"),
        "leaderboard/transfer/circle-lead/matrix.csv": (",0.5", ",0.6"),
        "leaderboard/speed.json": (f"{ROW} 1", f"{ROW} 3"),
    }
    for name, (before, after) in edits.items():
        text = (copy / name).read_text()
        assert before in text, name
        (copy / name).write_text(text.replace(before, after, 1))
    with (copy / "leaderboard/figures/eight.png").open("ab") as picture:
        picture.write(b" ")
    (copy / "docs/results/images/old.svg").touch()
    (copy / "leaderboard/figures/old.png").touch()
    changed = {*edits, *SHOWING} - {"leaderboard/speed.json"}
    assert {line.partition("; ")[0] for line in stale(copy)} == {
        *(f"{name}: edited by hand or stale" for name in changed),
        "leaderboard/figures/eight.png: not the picture that was drawn",
        "docs/results/images/old.svg: nothing makes it",
        "leaderboard/figures/old.png: not in leaderboard/figures.yaml",
    }


def test_a_picture_is_stale_when_its_policy_or_command_changes(copy):
    """Hold a picture against the files of its policy and the command that drew it."""
    plan = copy / figures.PLAN
    policy = yaml.safe_load(plan.read_text())["leaderboard/figures/spiral.png"]["policy"]
    (copy / figures.POLICIES / policy / "policy.onnx").write_bytes(b"another")
    plan.write_text(plan.read_text().replace("--kind touch", "--kind touch --stick steel"))
    found = "\n".join(figures.wrong(copy))
    assert "figures/spiral.png: policy_sha256 changed since it was drawn" in found
    assert "figures/circle-touch.png: command changed since it was drawn" in found
    assert "figures/line.png" not in found


def test_blocks_stand_between_markers():
    """Replace what is between the markers alone, and be done after one pass."""
    example = "    <!-- results: x -->\n    <!-- /results -->\n"
    page = f"{example}a\n<!-- results: x -->\nold\n<!-- /results -->\nb <!-- a comment -->\n"
    filled = fill(page, lambda name: f"new {name}")
    assert filled == page.replace("old", "\nnew x\n")
    assert fill(filled, lambda name: f"new {name}") == filled
    assert bare(filled) == f"{example}a\n\nb <!-- a comment -->\n"


@pytest.mark.parametrize(
    "page",
    [
        "<!-- results: x -->\nno end\n",
        "no start\n<!-- /results -->\n",
        "<!-- results: X! -->\n<!-- /results -->\n",
        "<!-- results: x -->\n<!-- results: y -->\n<!-- /results -->\n",
    ],
)
def test_wrong_markers_are_refused(page):
    """Refuse a block without an end, a start or a name."""
    with pytest.raises(MarkerError, match="allowed"):
        fill(page, str)


def test_every_block_is_shown():
    """Leave no block that no page asks for."""
    text = "".join(page.read_text() for page in pages(ROOT))
    assert [name for name in BLOCKS if f"<!-- results: {name} -->" not in text] == []


@pytest.mark.parametrize("page", RESULTS, ids=lambda page: page.name)
def test_results_pages_are_short_and_type_no_results(page):
    """Keep a page under 12 KB, and hold all its measured numbers in generated blocks."""
    assert page.stat().st_size < MAX_BYTES
    prose = re.sub(r"^    .*$|`[^`]*`", "", bare(page.read_text()), flags=re.MULTILINE)
    assert re.findall(r"\d+\.\d+", prose) == []


def test_charts_are_made_alike():
    """Draw the same bytes from the same values, and a value outside of its panel at its edge."""
    axis = Ticks(label="x", ends=(0, 1), at=[(0, "0"), (1, "1")])
    line = Series(label="a & b", color="#000", x=[0, 1], y=[0.2, 7.0], low=[0, 1], high=[1, 2])
    panel = Panel(title="t", x=axis, y=axis, series=[line])
    drawn = chart([panel], 1, "title")
    assert drawn == chart([panel], 1, "title")
    assert b"a &amp; b" in drawn and b"L352.0 30.0" in drawn
