"""The paper's results as data, for comparison. They were measured by its authors."""

from dataclasses import dataclass

ENGINE, FIGURE, EPISODES = "MuJoCo", "training settings", 10
"""Its engine, settings and number of episodes; it reports neither `held` nor `tracked`."""


@dataclass(frozen=True, kw_only=True)
class PaperRow:
    """The mean errors that the paper reports for one task."""

    p_err_cm: float
    """Error of the stick's lower end [cm]."""
    q_err_deg: float
    """Error of the stick's axis [deg]."""


PAPER = {
    "line": PaperRow(p_err_cm=0.83, q_err_deg=1.80),
    "circle": PaperRow(p_err_cm=0.97, q_err_deg=1.92),
    "spiral": PaperRow(p_err_cm=2.32, q_err_deg=5.90),
    "eight": PaperRow(p_err_cm=1.16, q_err_deg=2.36),
}
"""By task, in the paper's order, which is the order of the tables."""


@dataclass(frozen=True, kw_only=True)
class PaperSetting:
    """A setting that the paper's circle was tested in without being trained for it."""

    words: str
    change: str
    """The same as `--setting` of `bench transfer`."""
    row: PaperRow


SETTINGS = {
    "v-": PaperSetting(
        words="half the pace", change="pace=0.5", row=PaperRow(p_err_cm=1.19, q_err_deg=2.23)
    ),
    "v+": PaperSetting(
        words="1.5 times the pace", change="pace=1.5", row=PaperRow(p_err_cm=1.41, q_err_deg=3.16)
    ),
    "r-": PaperSetting(
        words="radius of 1 cm", change="radius=1cm", row=PaperRow(p_err_cm=0.85, q_err_deg=1.70)
    ),
    "r+": PaperSetting(
        words="radius of 3 cm", change="radius=3cm", row=PaperRow(p_err_cm=1.61, q_err_deg=2.50)
    ),
}
"""By the paper's name."""
