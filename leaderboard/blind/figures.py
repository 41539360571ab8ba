"""The figures of a blind score that are kept of every set, and what is wanted of them."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One figure of a score, by its name in score.json."""

    name: str
    head: str
    """Short, as the head of a column."""
    meaning: str
    """What is counted, of what."""
    wanted: str = ""
    median: bool = False
    """A median; else a share, which is shown as hits of a count."""
    percent: bool = False
    """A median that is shown in percent."""


FIGURES = (
    Figure(
        name="top1",
        head="effect right",
        meaning="one hidden effect: named, and nothing else",
        wanted="0.95 in MuJoCo, 0.88 elsewhere",
    ),
    Figure(
        name="top3",
        head="in the first three",
        meaning="one hidden effect: among the first three of the ranking",
        wanted="0.95",
    ),
    Figure(
        name="joint_right",
        head="right joint",
        meaning="one hidden effect that is named: on just its joints",
        wanted="0.97",
    ),
    Figure(
        name="pairs_exact",
        head="pair right",
        meaning="two hidden effects: both named, and nothing else",
        wanted="0.80",
    ),
    Figure(
        name="pairs_one",
        head="one of a pair",
        meaning="two hidden effects: at least one named",
    ),
    Figure(
        name="spurious_second",
        head="another besides",
        meaning="one hidden effect: named beside another that is not there",
        wanted="at most 0.10",
    ),
    Figure(
        name="none_accused",
        head="nothing hidden, accused",
        meaning="nothing hidden: an effect named",
        wanted="at most 0.05 in MuJoCo, 0.15 elsewhere",
    ),
    Figure(
        name="none_false_alarm",
        head="nothing hidden, not `none`",
        meaning="nothing hidden: an effect named, or `unknown`",
    ),
    Figure(
        name="unknown_recall",
        head="unknown seen",
        meaning="a hidden effect that the solver's catalogue lacks: called `unknown`",
        wanted="0.90",
    ),
    Figure(
        name="interval_coverage",
        head="intervals that hold",
        meaning="effects found: 90 % interval holds the true magnitude",
        wanted="0.85 to 0.95",
    ),
    Figure(
        name="magnitude_error_median",
        head="error, median",
        meaning="effects found: relative error of the magnitude, median",
        wanted="at most 5 % in MuJoCo, 12 % elsewhere",
        median=True,
        percent=True,
    ),
    Figure(
        name="shrinkage_vs_oracle",
        head="gap closed, median",
        meaning="gap that the verdict closes, over what the true effects close, median",
        wanted="0.95",
        median=True,
    ),
    Figure(
        name="cpu_s_median",
        head="CPU s, median",
        meaning="CPU seconds a case, median",
        median=True,
    ),
)
BY_NAME = {figure.name: figure for figure in FIGURES}
