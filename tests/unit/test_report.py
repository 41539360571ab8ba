"""The report: one page by itself that says what was found, and what is left open."""

import dataclasses
import re

import pytest
from arms import Real, log_of

from benchmark.gap._diagnosis_texts import summary
from diagnosis import Diagnosis, diagnose, page
from diagnosis.logs.log import Log
from diagnosis.report import wording
from diagnosis.report.report import FAINT, parts
from diagnosis.signals import drawable
from diagnosis.verdict.result import NONE, UNKNOWN, Nominal, Ranked
from diagnosis.verdict.sentences import sentences


@pytest.fixture(scope="module")
def log() -> Log:
    """A log of an arm with friction at its second joint."""
    return log_of(Real(joints=2, coulomb_nm={1: 4.0}))


@pytest.fixture(scope="module")
def found(log) -> Diagnosis:
    return diagnose(log)


@pytest.fixture(scope="module")
def html(found, log) -> str:
    """Its page, plotly.js left out."""
    whole = page(found, log, {"log": "an <arm>", "source": "a test"}, {"bench x --effects y": "z"})
    head, script, rest = re.split(r"<script>(.*?)</script>", whole, maxsplit=1, flags=re.DOTALL)
    assert "plotly.js v" in script
    return head + rest


def test_the_page_stands_alone(html):
    """Hold plotly.js once, fetch nothing, and close every table."""
    assert "plotly.js v" not in html
    assert not re.search(r"(src|href)\s*=|url\(|@import", html)
    assert html.count("<table") == html.count("</table>") > 2
    assert html.count("<details") == html.count("</details>")


def test_the_page_says_what_was_found(html, found):
    """Show the verdict, its joints' signals, and the command that adds it."""
    for text in (*found.sentences, wording.gaps(found), "bench x --effects y"):
        assert text in html
    assert "coulomb-friction" in found.sentences[0]
    assert html.count('class="plotly-graph-div"') == len(found.joints)
    assert "coulomb-friction on J1" in html


def test_names_are_escaped(html):
    """Write a log's name as text."""
    assert "an &lt;arm&gt;" in html and "<arm>" not in html


def test_the_map_holds_every_share(html, found):
    """Write each share over a thousandth in one cell, with its interval."""
    shown = re.findall(r'<td style="background[^>]*>([\d.]+)<span class="interval">', html)
    wanted = [f"{100 * place.share:.1f}" for place in found.where if place.share >= FAINT]
    assert sorted(shown) == sorted(wanted)


def test_the_bar_adds_up(found):
    """Divide the whole gap among nominal numbers, causes and what is left, whatever was found."""
    for verdict in (found.verdict, (NONE,), (UNKNOWN,)):
        bar = parts(dataclasses.replace(found, verdict=verdict))
        assert sum(part.share for part in bar) == pytest.approx(1.0, abs=3 * FAINT)
    assert "coulomb-friction on J1" in [part.name for part in parts(found)]


def test_a_page_without_commands(found, log):
    """Say nothing of commands to a caller who gave none."""
    assert "out of the range" not in page(found, log) and "Go on" not in page(found, log)


@pytest.mark.parametrize("verdict", [(NONE,), (UNKNOWN,)])
def test_a_page_without_a_finding(found, log, verdict):
    """Draw the page and the summary where no effect is named; say what to do about `unknown`."""
    lost = dataclasses.replace(found, verdict=verdict, joints=(), magnitudes=())
    text = page(lost, log, {"log": "arm"}, {})
    assert "No effect was found" in text
    assert ("give healthy logs" in text) == (verdict == (UNKNOWN,))
    assert summary(lost, {"warnings": [], "next": {}, "written": []})


def test_a_tie_is_said_in_words(found):
    """Name the joints of what explains as well, without the form of the command line."""
    limb = dataclasses.replace(
        found.limbs[0], tied=(("kp-scale@J1", "backlash@J0"),), experiment="load J1"
    )
    assert "kp-scale on J1 with backlash on J0" in [*sentences(limb)][-1]
    (effect,) = limb.verdict
    shared = dataclasses.replace(limb, tied=((effect,),))
    assert f"distinguish it from {effect} on all joints" in [*sentences(shared)][-1]
    two = dataclasses.replace(limb, causes=2 * limb.causes)
    assert "distinguish them from kp-scale on J1" in [*sentences(two)][-1]


def test_a_size_has_its_interval(found):
    """Say the ends of the interval beside the size that is named."""
    cause = found.magnitudes[0]
    assert f"({cause.low:.3g} to {cause.high:.3g}) on J1" in found.sentences[0]


def test_a_sensor_at_fault_is_no_contradiction(found):
    """Find no fault in the motion, rather than in the log, where a sensor has one."""
    limb = found.limbs[0]
    none = {"verdict": (NONE,), "causes": (), "left": 0.5}
    noisy = dataclasses.replace(limb, sensors=limb.causes, **none)
    assert next(sentences(noisy)).startswith("The motion shows no fault")


@pytest.mark.parametrize(("gap", "said"), [(30.0, True), (1.0, False)])
def test_a_gap_that_nominal_numbers_close_is_said(found, gap, said):
    """Say that no fault is needed only because the nominal numbers may be off."""
    none = {"verdict": (NONE,), "causes": (), "left": 0.5, "gap_before": gap}
    limb = dataclasses.replace(found.limbs[0], ordinary=3.5, **none)
    assert ("nominal_uncertainty" in " ".join(sentences(limb))) == said


def test_a_world_that_diverges_is_not_drawn():
    """Leave out a line with numbers that no JSON can hold."""
    lines = {"nominal": (1.0, 2.0), "with the causes": (1.0, float("nan"))}
    assert drawable(lines) == {"nominal": (1.0, 2.0)}


def test_a_term_of_drives_has_a_meaning(found, log):
    """Say in the ranking what a term is that a search tried, beside the effects."""
    (limb,) = found.limbs
    ranked = (*limb.ranking, Ranked(causes=(("ki", None),), share=0.5, left=9.0))
    other = dataclasses.replace(found, limbs=(dataclasses.replace(limb, ranking=ranked),))
    assert "An integral in all drives" in page(other, log, {}, {})


def test_friction_that_yields_is_said_in_words():
    """Say no size of what a model has or has not."""
    said = wording.moved(Nominal(effect="soft-friction", joint="", value=100.0, sd=0.0, unit="%"))
    assert "friction that yields" in said and "%" not in said


def test_the_summary_has_a_few_nominal_numbers_and_counts_the_others(found):
    """Name the surest of many numbers that moved, and say where all are."""
    one = Nominal(effect="kd-scale", joint="J0", value=5.0, sd=1.0, unit="%")
    many = tuple(dataclasses.replace(one, joint=f"J{j}", value=float(j)) for j in range(20))
    limbs = (dataclasses.replace(found.limbs[0], nominal=many), *found.limbs[1:])
    shown = summary(
        dataclasses.replace(found, limbs=limbs), {"warnings": [], "next": {}, "written": []}
    )
    said = next(str(line) for line in shown.renderables if "Nominal numbers" in str(line))
    more = sum(len(limb.nominal) for limb in limbs) - 6
    assert "kd-scale on J19" in said and f"diagnosis.json has {more} more" in said
