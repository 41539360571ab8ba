"""The report: one page by itself that says what was found, and what would settle a tie."""

import copy
import dataclasses
import re

import numpy as np
import pytest
from diagnosis_logs import arm_log, hand_log

from backends import trx
from backends.sticks import STICKS
from benchmark import registry
from benchmark._diagnosis_texts import summary
from diagnosis.attribution.experiments import TOGETHER, Trials
from diagnosis.attribution.gather import gather
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import NONE, UNKNOWN
from diagnosis.diagnose import Diagnosis, Judged, diagnose, judge_limb
from diagnosis.leading import Leading
from diagnosis.logs.log import Log, read_log
from diagnosis.replay.nominal import mjcf_world
from diagnosis.report.report import FAINT, page, wording
from diagnosis.shrinkage import Share

FLOOR = {"position": 3e-4, "motor": 3e-4, "torque": 5e-3}
FINGER = 1
"""J3 and J4."""
FRICTION = "viscous-friction=60mNms@J3"
"""What a triangle at the joint alone cannot tell from another damping gain."""


def catalogue() -> dict:
    return {name: registry.load("effect", name) for name in registry.names("effect")}


@pytest.fixture(scope="module")
def log() -> Log:
    """A log of the arm with friction at the elbow."""
    return arm_log("coulomb-friction=100mNm@elbow", ("steps",))


@pytest.fixture(scope="module")
def found(log) -> Diagnosis:
    """Its diagnosis, with few effects to choose from."""
    few = {n: k for n, k in catalogue().items() if n in ("coulomb-friction", "backlash")}
    return diagnose(log, mjcf_world(log), few)


@pytest.fixture(scope="module")
def html(found, log) -> str:
    """Its page, plotly.js left out."""
    whole = page(found, log, {"log": "an <arm>", "source": "a test"}, {"bench x --effects y": "z"})
    head, script, rest = re.split(r"<script>(.*?)</script>", whole, maxsplit=1, flags=re.DOTALL)
    assert "plotly.js v" in script
    return head + rest


def judged(path, effects: str, protocol: str, channels: str) -> Judged:
    """The verdict on one finger of a log made for it."""
    finger = gather(
        read_log(hand_log(path, effects, protocol, channels)),
        trx.spec(STICKS["reference"]),
        FLOOR,
    )[FINGER]
    return judge_limb(finger, catalogue(), 0.05)


@pytest.fixture(scope="module")
def tied(tmp_path_factory) -> Judged:
    """A log that leaves two effects open."""
    return judged(tmp_path_factory.mktemp("logs") / "tie", FRICTION, "triangle", "push")


def test_the_page_stands_alone(html):
    """Hold plotly.js once, fetch nothing, and close every table."""
    assert "plotly.js v" not in html
    assert not re.search(r"(src|href)\s*=|url\(|@import", html)
    assert html.count("<table") == html.count("</table>") > 3
    assert html.count("<details") == html.count("</details>")


def test_the_page_says_what_was_found(html, found):
    """Show the verdict, its joints' signals, and the command that adds it."""
    for text in (wording.sentence(found), wording.shrinkage(found), "bench x --effects y"):
        assert text in html
    assert "coulomb-friction of 100" in wording.sentence(found)
    assert html.count("plotly-graph-div") == len(found.joints) + 1
    assert "coulomb-friction@elbow" in html


def test_names_are_escaped(html):
    """Write a log's name as text."""
    assert "an &lt;arm&gt;" in html and "<arm>" not in html


def test_the_map_holds_every_share(html, found):
    """Write each share over a thousandth in one cell, with its interval."""
    shown = re.findall(r'<td style="background[^>]*>([\d.]+)<span class="interval">', html)
    wanted = [f"{100 * place.share:.1f}" for place in found.where if place.share >= FAINT]
    assert sorted(shown) == sorted(wanted)
    assert sum(place.share for place in found.where) == pytest.approx(1.0)


def test_a_candidate_is_ranked_once(found):
    """List an effect that was searched from several magnitudes once, where it fits best."""
    limb = found.limbs[0]
    several = copy.copy(limb.attribution)
    worse = [
        dataclasses.replace(one, fit=dataclasses.replace(one.fit, cost=one.fit.cost + 1.0))
        for one in several.singles
    ]
    several.singles = [*worse, *several.singles]
    again = dataclasses.replace(limb, attribution=several).ranking
    assert [id(one) for one in again] == [id(one) for one in limb.ranking]
    assert len({(one.names, one.joints) for one in again}) == len(again) > 3


def test_verdicts_in_words(found):
    """Say none, unknown and a finding beside an unknown gap."""
    none = dataclasses.replace(found, verdict=(NONE,), joints=(), magnitudes=())
    assert wording.sentence(none).startswith("No effect is needed")
    assert "with the verdict" not in wording.shrinkage(none)
    lost = dataclasses.replace(found, verdict=(UNKNOWN,), joints=("elbow",), magnitudes=())
    assert wording.sentence(lost) == (
        "On elbow there is a gap that no effect of the catalogue explains."
    )
    nearest = Leading(
        effect="load-friction",
        joint=None,
        limb=("shoulder", "elbow"),
        value=40.0,
        unit="%",
        share=Share(value=0.7, interval=(0.6, 0.8)),
    )
    for tied, others in ((), "every other effect"), (("self-lock",), "every effect but self-lock"):
        led = dataclasses.replace(lost, leading=(dataclasses.replace(nearest, tied=tied),))
        assert (
            "explains. The closest effect is load-friction of 40 % on shoulder and elbow, ahead of "
            f"{others}: it explains 70.0 % (60.0 to 80.0) of the squared gap"
        ) in wording.sentence(led)
    most = dataclasses.replace(nearest, share=Share(value=0.999, interval=(0.99, 1.0)))
    said = wording.sentence(dataclasses.replace(lost, leading=(most,)))
    assert "by the nominal parameters, but its residual, or the shift of" in said
    within = dataclasses.replace(nearest, share=Share(value=0.0, interval=(0.0, 0.0)))
    said = wording.sentence(dataclasses.replace(lost, leading=(within,)))
    assert "it changes nothing by more than the noise floor, which is too little" in said
    both = dataclasses.replace(
        found, verdict=("coulomb-friction", UNKNOWN), joints=("shoulder", "elbow")
    )
    assert "on elbow. On shoulder there is a gap" in wording.sentence(both)
    loose = dataclasses.replace(found.magnitudes[0], interval=(0.1, 1e9))
    assert "not bounded by this log" in wording.phrase(loose)


@pytest.mark.parametrize("verdict", [(NONE,), (UNKNOWN,)])
def test_a_page_without_a_finding(found, log, verdict):
    """Draw the page and the summary where no effect is accused."""
    limbs = tuple(dataclasses.replace(limb, names=verdict) for limb in found.limbs)
    lost = dataclasses.replace(found, verdict=verdict, joints=(), magnitudes=(), limbs=limbs)
    text = page(lost, log, {"log": "arm"}, {})
    assert wording.sentence(lost) in text
    assert "No effect was found" in text
    assert '"with the verdict"' not in text.split("</script>", 1)[1]
    assert summary(lost, {"healthy": {"logs": []}, "warnings": [], "next": {}, "written": []})


def test_what_arrived_is_drawn_beside_what_was_told(found, log):
    """Draw the verdict's world by what arrived of the commands, though it says none."""
    limbs = tuple(dataclasses.replace(limb, names=(NONE,), told=limb) for limb in found.limbs)
    lost = dataclasses.replace(found, limbs=limbs)
    assert '"with the verdict"' in page(lost, log, {"log": "arm"}, {}).split("</script>", 1)[1]


def test_a_tie_names_an_experiment_that_settles_it(tied, tmp_path):
    """Record what the tie asks for, and find the friction that it left open."""
    names = {effect for row in tied.ties for effect in row["effects"]}
    assert {"viscous-friction", "kd-scale"} <= names
    row = next(r for r in tied.ties if set(r["effects"]) == {"viscous-friction", "kd-scale"})
    asked = row["experiment"]
    if asked.startswith("record --protocol "):
        protocol, channels = f"triangle,{asked.split()[-1]}", "push"
    else:
        protocol, channels = "triangle", f"push,{asked.split()[-1].replace('angle', 'motor')}"
    settled = judged(tmp_path / "settled", FRICTION, protocol, channels)
    assert settled.verdict.names == ("viscous-friction",)
    assert settled.verdict.chosen.joints == ("J3",)
    assert not settled.ties


def test_an_experiment_separates_nothing_from_itself(tied):
    """Give zero for a rival that is the verdict, and most for all experiments together."""
    trials = Trials(tied.verdict)
    assert max(trials.separations(tied.verdict.chosen).values()) == 0.0
    apart = trials.separations(tied.verdict.tied[0])
    assert {"log the drive torque", "log the motor angle", "record --protocol push"} <= set(apart)
    assert "record --protocol triangle" not in apart
    assert apart[TOGETHER] == max(apart.values()) > np.sqrt(2 * rules().tie_nats)


def test_a_complete_log_lacks_no_experiment(tmp_path):
    """Offer nothing for a tie in a log that has every channel and protocol."""
    path = hand_log(tmp_path / "all", "none", "steps,triangle,multisine,push", "motor,torque,push")
    finger = gather(read_log(path), trx.spec(STICKS["reference"]), FLOOR)[FINGER]
    few = {n: k for n, k in catalogue().items() if n in ("kd-scale", "link-mass")}
    limb = judge_limb(finger, few, 0.05).verdict
    assert Trials(limb).separations(limb.attribution.singles[0]) == {}
