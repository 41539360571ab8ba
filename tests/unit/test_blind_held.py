"""Blind cases with the stick in the hand: drawn, made on engines, solved and scored."""

import dataclasses
import json

import pytest

from benchmark.cli import app as cli
from benchmark.gap import blind
from benchmark.parts import registry
from diagnosis.blind import draw, faults
from diagnosis.blind.apart import Grasps
from diagnosis.blind.grasp import GRASP, PULL
from diagnosis.blind.oracle import DETECTABLE_NATS
from diagnosis.logs.log import read_log


def catalogue() -> dict:
    return {name: registry.load("effect", name) for name in registry.names("effect")}


def held(**changes) -> draw.Settings:
    """A set of grasps on one engine."""
    wanted = {
        "reals": ("bullet",),
        "rigs": ("held",),
        "effects": faults.in_hand(),
        "protocols": ("steps", GRASP),
        "channels": draw.HELD_CHANNELS,
    }
    return draw.Settings(**({"cases": 3 * len(faults.in_hand())} | wanted | changes))


def test_held_cases_draw_what_a_stick_shows():
    """Deal effects of touch, stick and contact at all levels within bounds, with their channels."""
    kinds = catalogue()
    cases = draw.draw(held(modes=("single",)), 0)
    assert len({(c.faults[0].effect, c.faults[0].level) for c in cases}) == len(cases)
    for fault in (f for case in cases for f in case.faults):
        low, high = kinds[fault.effect].bounds
        assert low <= fault.magnitude <= high and fault.magnitude != 0.0
        assert fault.joint is None and not kinds[fault.effect].per_joint
    assert all({"stick", "position"} < set(case.channels) for case in cases)
    assert {error.effect for case in cases for error in case.nominal} >= {"kp-scale", "link-mass"}


@pytest.mark.slow
def test_a_held_case_is_solved_and_scored(tmp_path):
    """Find dead taxels of another engine's grasps, with nominal errors and noise, and score it."""
    few = ("taxel-dropout", "taxel-drift", "stick-mass")
    folder, answers = tmp_path / "set", tmp_path / "answers.json"
    wanted = held(cases=1, modes=("single",), effects=few, protocols=("push", GRASP))
    seed = next(s for s in range(99) if _hides(wanted, s) == ("taxel-dropout", "large"))
    blind.make(wanted, seed, folder, answers, 1)
    log = read_log(folder / "cases" / "000")
    assert [e.protocol for e in log.episodes] == ["push", "push", GRASP, GRASP]
    assert log.stick(2) is not None and log.touch(2) is not None and log.stick(0) is None
    blind.run(folder, 1, False)
    result, _ = blind.score([(folder, answers)], None, 1)
    (row,) = result["tables"]["cases"]
    assert row["detectable"]
    assert row["verdict"] == "taxel-dropout" and result["top1"] == 1.0
    assert result["interval_coverage"] == 1.0


def _hides(wanted: draw.Settings, seed: int) -> tuple[str, str]:
    (fault,) = draw.draw(wanted, seed)[0].faults
    return fault.effect, fault.level


@pytest.mark.slow
def test_the_oracle_tells_what_shows():
    """Call a taxel that answers early detectable from answers alone, a heavy stick from neither."""
    wanted = held(cases=1, modes=("none",), channels=draw.HELD_CHANNELS[-1:])
    (case,) = draw.draw(wanted, 0)
    engines = registry.usual("backend")

    def nats(effect: str, magnitude: float, *channels: str) -> float:
        fault = faults.Fault(effect=effect, joint=None, magnitude=magnitude)
        hidden = dataclasses.replace(case, faults=(fault,), channels=("position", *channels))
        grasps = Grasps(case=hidden, simulate=blind._start, seed=0)
        return grasps.apart_nats(fault, engines)

    assert nats("taxel-threshold", -1e-4, "stick", "touch") == 0.0
    assert nats("taxel-threshold", -1e-4, "stick", "contact") > DETECTABLE_NATS
    assert nats("stick-radius", 0.1, "stick", "touch") > DETECTABLE_NATS
    assert nats("stick-mass", 0.2, "stick", "touch") < DETECTABLE_NATS
    assert nats("contact-friction", -0.3, "stick", "touch") < DETECTABLE_NATS
    case = dataclasses.replace(case, protocols=("steps", GRASP, PULL))
    assert nats("contact-friction", -0.3, "stick", "touch") > DETECTABLE_NATS


@pytest.mark.slow
def test_small_magnitudes_are_searched_in_grasps(tmp_path, capfd):
    """Find how small a threshold still shows in answers, at no level in depths; refuse a play."""
    words = ["blind", "detectable", "--rig", "held", "--real", "mujoco", "--draws", "1"]
    words += ["--hidden-effects", "taxel-threshold", "--out", str(tmp_path), "--json"]
    assert cli.call(words) == 0
    contact, touch = json.loads(capfd.readouterr().out)["rows"]
    assert contact["bound"] == "" and 0.001 < contact["smallest"] < 0.4 and contact["unit"] == "mm"
    assert touch["bound"] == ">" and touch["channels"].endswith("touch")
    table = (tmp_path / "detectable.md").read_text()
    assert "mujoco, grasp, contact" in table and "> 0.4" in table
    words[words.index("taxel-threshold")] = "contact-friction"
    assert cli.call(words) == 0
    grasp, pull = json.loads(capfd.readouterr().out)["rows"]
    assert (grasp["protocol"], pull["protocol"]) == (GRASP, PULL)
    assert pull["smallest"] < 10 < grasp["smallest"]
    words[words.index("contact-friction")] = "backlash"
    assert cli.call(words) == 2
    assert "no grasp is asked for these" in capfd.readouterr().err
