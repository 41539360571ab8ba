"""The figures of a blind score that are kept of every set, and what is wanted of them."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One figure of a score, by its name in score.json."""

    name: str
    meaning: str
    """Complete as a row's head: what is counted, of what."""
    wanted: str = ""
    median: bool = False
    """A median; else a share, which is shown as hits of a count."""
    percent: bool = False
    """A median that is shown in percent."""


FIGURES = (
    Figure(
        name="top1",
        meaning="single effects named, and nothing else",
        wanted="0.95 in MuJoCo, 0.88 elsewhere",
    ),
    Figure(name="top3", meaning="single effects among the first three", wanted="0.95"),
    Figure(name="joint_right", meaning="of those named: on the right joints", wanted="0.97"),
    Figure(
        name="none_accused",
        meaning="nothing hidden, an effect named",
        wanted="at most 0.05 in MuJoCo, 0.15 elsewhere",
    ),
    Figure(name="none_false_alarm", meaning="nothing hidden, not called `none`"),
    Figure(
        name="unknown_recall",
        meaning="effects outside of the catalogue called `unknown`",
        wanted="0.90",
    ),
    Figure(name="pairs_exact", meaning="pairs named, and nothing else", wanted="0.80"),
    Figure(name="pairs_one", meaning="pairs of which one is named"),
    Figure(
        name="spurious_second",
        meaning="single effects named beside one that is not there",
        wanted="at most 0.10",
    ),
    Figure(
        name="interval_coverage",
        meaning="90 % intervals that hold the true magnitude",
        wanted="0.85 to 0.95",
    ),
    Figure(
        name="magnitude_error_median",
        meaning="error of magnitudes, median",
        wanted="at most 5 % in MuJoCo, 12 % elsewhere",
        median=True,
        percent=True,
    ),
    Figure(
        name="shrinkage_vs_oracle",
        meaning="gap closed, over what the true effects close, median",
        wanted="0.95",
        median=True,
    ),
    Figure(name="cpu_s_median", meaning="CPU seconds a case, median", median=True),
)
BY_NAME = {figure.name: figure for figure in FIGURES}
