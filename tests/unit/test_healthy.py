"""Logs of a sound mechanism: what they excuse, and what is told beside them."""

import dataclasses
import json

import numpy as np
import pytest
from diagnosis_logs import arm_log, hand_log

from backends.spec import Spec
from benchmark import blind, registry
from benchmark.cli import app as cli
from diagnosis.attribution.rules import rules
from diagnosis.attribution.sound import Sound, worst
from diagnosis.blind import draw, make, rigs
from diagnosis.blind.files import BlindSet
from diagnosis.blind.mechanics import plant
from diagnosis.diagnose import diagnose, healthy
from diagnosis.logs.log import Log, LogError, write_log
from diagnosis.report.wording import sentence

ROUGH = plant.Baseline(play_rad=1e-3, cogging_share=8e-3, friction_share=4e-3)
"""A mechanism with more on top of any effect than the rules allow for."""
FRICTION = draw.Fault(effect="coulomb-friction", joint="A0", magnitude=0.1)


def catalogue() -> dict:
    return {name: registry.load("effect", name) for name in registry.names("effect")}


def rough_log(seed: int, *faults: draw.Fault) -> tuple[Log, Spec]:
    """A log of the rough mechanism with hidden nominal errors of its own."""
    wanted = draw.Settings(
        cases=1,
        reals=("plant",),
        rigs=("joint",),
        modes=("none",),
        protocols=("steps", "push"),
        channels=(("position",),),
        healthy=1,
    )
    case = draw.draw(wanted, catalogue(), seed)[0]
    sound = draw.sound(wanted, [case], seed)[case.make][0]
    case = dataclasses.replace(sound, faults=faults)
    log = make.real_log(case, catalogue(), no_engine, np.random.default_rng(seed))
    return log, rigs.nominal("joint")


def no_engine(*_):
    raise AssertionError("a plant needs no engine")


@pytest.fixture
def rough(monkeypatch):
    monkeypatch.setattr(make, "mechanics", lambda name: plant.Mechanics(ROUGH))


def test_nothing_is_excused_without_cause():
    """Leave the rules as they are where nothing is left, and never make one stricter."""
    assert Sound().excused(rules()) == rules()
    left = Sound(surprise=20.0, unevenness=1.0, lack_of_fit=100.0, bent=6.2)
    wider = left.excused(rules())
    more = rules().sound_more
    assert wider.white_sd == 20.0 * more and wider.law_nats == 100.0 * more
    assert wider.uneven_sd == rules().uneven_sd and wider.accuse_nats == rules().accuse_nats
    assert wider.alone_stds == pytest.approx(6.2)
    assert wider.bent_stds / rules().bent_stds == pytest.approx(2.0)


def test_the_worst_log_counts():
    """Take the most of each, whichever log shows it; of none nothing."""
    one = Sound(surprise=3.0, bent=1.0, sizes={"backlash": 1e-3})
    other = Sound(surprise=2.0, bent=4.0, sizes={"backlash": 2e-3, "stiction": 0.1})
    both = worst([one, other])
    assert both == Sound(surprise=3.0, bent=4.0, sizes={"backlash": 2e-3, "stiction": 0.1})
    assert both.most("backlash", rules()) == pytest.approx(2e-3 * rules().sound_more)
    assert worst([]) == Sound() and Sound().most("backlash", rules()) == 0.0


@pytest.mark.slow
def test_what_a_sound_mechanism_leaves_is_excused(rough):
    """Name an effect on a rough mechanism once it is known how it is while sound, and not before.

    Nothing is wrong with another one of the make then, either.
    """
    left = healthy([rough_log(1), rough_log(2)], catalogue())
    assert len(left) == 1 and left[0].surprise > rules().white_sd
    hurt = rough_log(7, FRICTION)
    assert diagnose(*hurt, catalogue()).verdict == ("unknown",)
    found = diagnose(*hurt, catalogue(), sound=left)
    assert found.verdict == ("coulomb-friction",) and found.joints == ("A0",)
    assert found.magnitudes[0].value == pytest.approx(100.0, rel=0.1)
    fine = diagnose(*rough_log(8), catalogue(), sound=left)
    assert fine.verdict == ("none",) and "beyond what healthy logs show" in sentence(fine)


def test_what_would_excuse_anything_is_refused():
    """Refuse a healthy log that leaves a large gap, and say what to do with it."""
    with pytest.raises(LogError, match="healthy log 1 of 1 leaves .* on A0 .* diagnose that log"):
        healthy([rough_log(1, draw.Fault(effect="dead-zone", joint="A0", magnitude=0.02))], {})


def test_soundness_of_other_limbs_is_refused():
    """Refuse what was seen of another mechanism, rather than to judge one limb by another."""
    with pytest.raises(LogError, match="other joints"):
        diagnose(*rough_log(1), catalogue(), sound=[Sound(), Sound()])


def test_a_blind_set_with_sound_mechanisms(tmp_path, capfd):
    """Give the solver the healthy logs of every case's own plant."""
    folder, answers = tmp_path / "set", tmp_path / "answers.json"
    wanted = draw.Settings(
        cases=2,
        reals=("plant",),
        rigs=("joint",),
        modes=("none",),
        effects=("backlash", "self-lock", "coulomb-friction"),
        protocols=("push",),
        channels=(("position",), ("position", "motor")),
        healthy=1,
    )
    blind.make(wanted, 5, folder, answers, 1)
    opened = BlindSet(path=folder)
    assert sorted(opened.given(n)["make"] for n in opened.numbers) == [0, 1]
    assert all(len(opened.healthy_logs(n)) == 1 for n in opened.numbers)
    assert blind.run(folder, 1, False)["solved"] == 2
    assert not any(opened.read_result(n)["refused"] for n in opened.numbers)
    assert blind.run(folder, 1, False)["solved"] == 0


def test_healthy_logs_on_the_command_line(tmp_path, capfd):
    """Say what healthy logs excuse, in JSON and in the summary."""
    fine, today = tmp_path / "fine", tmp_path / "today"
    write_log(arm_log("none"), fine, "csv")
    write_log(arm_log("coulomb-friction=100mNm@elbow"), today, "csv")
    words = ["diagnose", str(today), "--healthy", str(fine), "--out", str(tmp_path / "out")]
    assert cli.call([*words, "--workers", "1", "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    told = found["healthy"]
    assert found["verdict"] == ["coulomb-friction"] and f"--healthy {fine}" in found["log"]
    assert told["logs"] == [str(fine)]
    assert told["limbs"][0]["rules"]["law_nats"] >= rules().law_nats
    assert set(told["limbs"][0]["left"]) == set(dataclasses.asdict(Sound()))
    assert "healthy logs" in (tmp_path / "out" / "report.html").read_text()


def test_healthy_logs_that_cannot_be_held_against_are_refused(tmp_path, capfd):
    """Say in one line why a log is no measure: itself, of other joints, or moved otherwise."""
    log, short, hand = tmp_path / "log", tmp_path / "short", tmp_path / "hand"
    write_log(arm_log("none"), log, "csv")
    write_log(arm_log("none", ("steps",)), short, "csv")
    hand_log(hand, "none", "steps")
    capfd.readouterr()
    for other, said in (
        (log, "is the log that is diagnosed"),
        (short, "lacks the protocols multisine of the log that is diagnosed"),
        (hand, "has the joints J0, J1, J3, J4, J6, J7, and the log that is diagnosed has shoulder"),
        (tmp_path / "none", "no log"),
    ):
        assert cli.call(["diagnose", str(log), "--healthy", str(other), "--workers", "1"]) == 2
        err = " ".join(capfd.readouterr().err.split())
        assert said in err and "Traceback" not in err
