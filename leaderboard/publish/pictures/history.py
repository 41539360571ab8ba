"""The history of the blind sets: four shares over time, by what the sets are of."""

from datetime import datetime, timedelta

from scipy import stats

from leaderboard._chart import Panel, Series, Ticks, chart, colors
from leaderboard.blind.history import Line
from leaderboard.blind.score import Counted
from leaderboard.publish.kept import Kept
from leaderboard.publish.pictures.copies import IMAGES
from leaderboard.publish.registry import picture

SHARES = {
    "top1": ("single effects named, and nothing else", (0.88, 0.95)),
    "pairs_exact": ("pairs named, and nothing else", (0.80,)),
    "unknown_recall": ("effects outside of the catalogue called unknown", (0.90,)),
    "interval_coverage": ("90 % intervals that hold the truth", (0.85, 0.95)),
}
"""What is drawn of a figure: its title, and what is wanted."""
LEVEL = 0.95
MOST_TICKS = 8
DAY = timedelta(days=1)


@picture(f"{IMAGES}/blind.svg")
def blind(kept: Kept) -> bytes:
    """Every blind set as a dot with its Wilson interval."""
    groups: dict[str, list[Line]] = {}
    for line in kept.blind_sets:
        if line.blind:
            groups.setdefault(_group(line), []).append(line)
    first = kept.blind_sets[0].date.replace(hour=0, minute=0)
    days = _days(first, kept.blind_sets[-1].date)
    hues = colors(sorted(groups))
    panels = []
    for name, (title, wanted) in SHARES.items():
        series = [
            _series(name, group, hues[group], first, groups[group]) for group in sorted(groups)
        ]
        panels.append(Panel(title=title, x=days, y=_SHARE, series=series, wanted=wanted))
    return chart(panels, 2, "Blind sets over time: shares with 95 % intervals")


_SHARE = Ticks(label="share", ends=(0.0, 1.0), at=[(n / 5, f"{n / 5:g}") for n in range(6)])


def _group(line: Line) -> str:
    """What a set is of, by what the solver had to do with it."""
    if line.kind.rig == "held":
        return "stick in the hand"
    if line.kind.rig != "finger":
        return f"{line.kind.rig} in free air"
    if "mujoco" in line.kind.sides:
        return "fingers: engines and plain plant"
    return "fingers: other engines and plants" + (", healthy logs" if line.healthy else "")


def _series(name: str, label: str, color: str, first: datetime, lines: list[Line]) -> Series:
    known = [line for line in lines if line.figures[name].count]
    shares = [_with_interval(line.figures[name]) for line in known]
    return Series(
        label=label,
        color=color,
        x=[(line.date - first) / DAY for line in known],
        y=[value for value, _, _ in shares],
        low=[low for _, low, _ in shares],
        high=[high for _, _, high in shares],
        dots=True,
    )


def _with_interval(share: Counted) -> tuple[float, float, float]:
    test = stats.binomtest(share.hits, share.count)
    ends = test.proportion_ci(LEVEL, method="wilson")
    return share.hits / share.count, float(ends.low), float(ends.high)


def _days(first: datetime, last: datetime) -> Ticks:
    """An axis over whole days, each labelled unless they are many."""
    count = (last - first).days + 1
    days = range(0, count + 1, -(-count // MOST_TICKS))
    at = [(n, f"{first + n * DAY:%b} {(first + n * DAY).day}") for n in days]
    return Ticks(label="", ends=(0, count), at=at)
