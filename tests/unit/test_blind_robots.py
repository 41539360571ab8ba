"""Sets of drawn robots: made, solved by any function, scored by side, and used for the curve."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from backends.catalogue import catalogue
from benchmark.errors import UsageError
from benchmark.gap import blind
from benchmark.parts import registry
from benchmark.parts.registry import ROOT
from diagnosis.blind import (
    calibrate,
    draw,
    faults,
    files,
    frozen,
    judged,
    near,
    rigs,
    sides,
    tables,
)
from diagnosis.blind.draw import Case
from diagnosis.blind.faults import Fault
from diagnosis.blind.files import BlindSet
from diagnosis.blind.plant import MAGNET_SLIP
from diagnosis.blind.solving import Task, solve_set, task
from diagnosis.logs.log import MjcfMechanism

WORDS = {"modes": "all", "effects": "all", "protocols": "steps,push"}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A small set of drawn robots with a healthy log each: its folder and its answers."""
    root = tmp_path_factory.mktemp("robots")
    wanted = blind.settings(6, "presliding,cascade", "arm1", **WORDS, healthy=1)
    wanted = replace(wanted, variants=1)
    blind.make(wanted, 3, root / "set", root / "answers.json", 1)
    return root / "set", root / "answers.json"


def says_unknown(one: Task) -> dict:
    """A solver that knows nothing, and says how sure it is."""
    assert isinstance(one.log.meta.mechanism, MjcfMechanism) and one.nominal is None
    assert one.robot and len(one.healthy) == 1 and one.excluded == ()
    features = {"constant": 1.0, "gap": float(np.log(2.0)), "share": 0.1}
    return {
        "verdict": ["unknown"],
        "joints": [],
        "magnitudes": [],
        "confidence": 0.4,
        "features": features,
    }


def test_a_set_of_robots_is_solved_by_any_function(made):
    """Make, solve and score a set of robots; feed the curve of confidence with it."""
    folder, answers = made
    found = solve_set(folder, says_unknown)
    assert [row["number"] for row in found] == list(range(6))
    assert not any(row["refused"] for row in found), found[0]["refused"]
    result, _ = blind.score([(folder, answers)], None, 1)
    opened = files.open_answers(answers, BlindSet(path=folder).commitment())
    unknowns = [case for case in opened.cases if case.mode == "unknown"]
    by_side = {row["of"]: row for row in result["tables"]["groups"] if row["by"] == "real"}
    assert set(by_side) == {"presliding", "cascade"}
    assert result["none_false_alarm"] == 1.0 and result["top1"] == 0.0
    assert sum(row["unknown_recall_n"] for row in by_side.values()) == len(unknowns)
    assert result["unknown_recall"] == 1.0
    bins = {row["of"]: row for row in result["tables"]["confidence"]}
    assert {*by_side} < {*bins}
    assert bins["all"]["cases"] == 6 and bins["all"]["confidence"] == pytest.approx(0.4)
    assert bins["all"]["right"] == pytest.approx(len(unknowns) / 6)
    rows = calibrate.rows([(BlindSet(path=folder), answers)])
    assert sum(row.right for row in rows) == len(unknowns)
    assert 0.0 < calibrate.calibrate(rows).left_out.max() < 1.0


def test_robots_are_sealed_with_what_there_is_to_be_seen(made):
    """Seal what robots leave and how large their faults are, and leave none of it in the set."""
    folder, answers = made
    for case in files.open_answers(answers, BlindSet(path=folder).commitment()).cases:
        assert 0.0 < case.residual_floors <= 5.0 and case.left_floors > 0.0
        assert len(case.times) == len(case.faults)
        assert all(2.7 < times < 33.0 for times in case.times)
        assert (MAGNET_SLIP in [f.effect for f in case.faults]) == (case.mode == "unknown")
        (healthy,) = task(BlindSet(path=folder), case.number).healthy
        assert healthy.mjcf_xml == task(BlindSet(path=folder), case.number).log.mjcf_xml
        text = json.dumps(files.read_json(BlindSet(path=folder).log(case.number) / "case.json"))
        assert case.real not in text and "floors" not in text


def test_a_robot_is_the_same_in_its_healthy_logs():
    """Give healthy logs the case's own robot, before anything was wrong with it."""
    wanted = replace(blind.settings(5, "dart,drake", "arm2", **WORDS, healthy=2))
    cases = draw.draw(wanted, 1)
    sound = draw.sound(wanted, cases, 1)
    for case in cases:
        for one in sound[case.make]:
            assert one.rig == case.rig and not one.faults
            kept = {(e.effect, e.joint): e.magnitude for e in one.nominal}
            assert all(kept[e.effect, e.joint] == e.magnitude for e in case.nominal)


@pytest.mark.parametrize("rig", ["arm1", "arm2", "arm3", "arm6"])
def test_nominal_errors_stay_within_three_deviations(rig):
    """Be off by up to 15 %, some robots by more than 10 %, where a log states 5 %."""
    largest = []
    for seed in range(12):
        name = f"{rig}-{seed}"
        shares = [abs(e.magnitude) for e in faults.of_robot(name, ()) if e.effect == "kp-scale"]
        assert len(shares) == rigs.ARMS[rig] and max(shares) <= 0.15
        largest.append(max(shares))
    assert max(largest) > 0.08


def test_arms_are_drawn_evenly():
    """Deal arms of two, three and six joints for `arm`, no two alike."""
    wanted = blind.settings(9, "plain", "arm", **WORDS)
    cases = draw.draw(wanted, 4)
    families = [rigs.family(case.rig) for case in cases]
    assert {f: families.count(f) for f in families} == {"arm2": 3, "arm3": 3, "arm6": 3}
    assert len({case.rig for case in cases}) == 9


def test_real_sides_are_those_that_carry_the_arms():
    """Leave plants out that have no equations for an arm, and refuse them where they are named."""
    assert "plant" in blind.settings(9, "all", "arm1", **WORDS).reals
    assert blind.settings(9, "all", "arm", **WORDS).reals == tuple(registry.usual("backend"))
    with pytest.raises(UsageError, match="--real plant cannot move --rig arm.*known: .*plain"):
        blind.settings(9, "plant", "arm", **WORDS)


def test_arms_and_hands_are_not_mixed():
    """Refuse a set of drawn arms and rigs that are always the same."""
    with pytest.raises(UsageError, match="mixes arms, which are drawn"):
        blind.settings(9, "plain", "arm2,finger", **WORDS)


def robot(effect: str, left: float) -> Case:
    """A case of a fault that no catalogue has."""
    return Case(
        number=0,
        mode="unknown",
        real="pwm",
        rig="arm1-7",
        channels=("position",),
        protocols=("steps",),
        variants=1,
        faults=(Fault(effect=effect, joint="j0", magnitude=0.1),),
        nominal=(),
        excluded=(),
        residual_floors=1.0,
        left_floors=left,
    )


@pytest.mark.parametrize(
    ("verdict", "left", "healthy", "right", "near"),
    [
        (["unknown"], 9.0, 0, True, False),
        (["none"], 9.0, 0, False, False),
        (["none"], 3.5, 0, True, False),
        (["none"], 3.5, 2, False, False),
        (["encoder-bias"], 9.0, 0, False, True),
        (["kd-scale"], 9.0, 0, False, False),
        (["encoder-bias", "kd-scale"], 9.0, 0, False, False),
    ],
)
def test_unknown_is_right_seen_or_near(verdict, left, healthy, right, near):
    """Take `none` below what is ordinary, and a mechanic's name apart from `unknown`."""
    said = {"verdict": verdict, "joints": ["j0"] if near else []}
    case = robot("magnet-slip", left)
    beyond = not judged.is_ordinary(case, healthy)
    assert judged.rightness(case, said, beyond) == (right, near)


def test_a_near_name_on_another_joint_is_wrong():
    """Ask a near name to stand on the joint that is at fault."""
    said = {"verdict": ["encoder-bias"], "joints": ["j5"]}
    case = robot("magnet-slip", 9.0)
    assert judged.rightness(case, said, True) == (False, False)


@pytest.mark.parametrize(
    ("rig", "channels", "right"),
    [
        ("arm1-7", ("position",), True),
        ("arm1-7", ("position", "torque"), False),
        ("joint", ("position",), False),
    ],
)
def test_damping_is_one_number_without_torque(rig, channels, right):
    """Take kd for viscous friction of a robot whose torque was not logged, and nowhere else."""
    case = replace(robot("viscous-friction", 9.0), mode="single", rig=rig, channels=channels)
    said = {"verdict": ["kd-scale"], "joints": ["j0"]}
    assert judged.rightness(case, said, True) == (right, False)


def test_findings_beside_a_verdict_do_not_make_its_kind():
    """Count a verdict as named by what a fit names, not by noise, steps or lost packets."""
    assert calibrate._kind(["encoder-noise", "command-dropout"]) == calibrate.NONE
    assert calibrate._kind(["encoder-noise", "backlash"]) == calibrate.NAMED
    assert calibrate._kind(["none"]) == calibrate.NONE
    assert calibrate._kind(["unknown"]) == calibrate.UNKNOWN


def test_near_names_are_of_the_catalogue():
    """List near names of the catalogue for a fault, and never its own."""
    known = catalogue()
    for fault in (MAGNET_SLIP, *known):
        assert set(near.near(fault)) <= set(known) - {fault}
    assert not near.is_near("end-stop", []) and near.is_near("magnet-slip", ["encoder-bias"])


def test_bins_of_confidence_have_equal_counts():
    """Hold mean confidence against shares right in four bins of equal counts."""
    said = np.linspace(0.01, 1.0, 100)
    cases = pd.DataFrame({"confidence": said, "right_or_near": said > 0.5, "mode": "single"})
    found = tables.confidence(cases.assign(detectable=True, real="dart")).set_index("of")
    assert list(found["cases"]) == [100, 100, 25, 25, 25, 25]
    assert found.loc["bin 1", "excess"] == pytest.approx(0.13)
    assert found.loc["bin 4", "right"] == 1.0


def test_every_real_side_is_a_file():
    """Know plants and engines by the names of their files."""
    foreign = {"presliding", "cascade", "flexgear", "pwm", "filtered", "plain"}
    assert foreign | {"dart", "bristle", "plant"} <= set(sides.PLANTS)
    assert {"drake", "exudyn"} <= set(sides.ENGINES) and "drake" in blind.KEPT_APART


def test_the_solver_of_the_docs_is_scored(made, tmp_path):
    """Let the program on the page solve a copy of the set, under its own name."""
    folder, answers = made
    copy = tmp_path / "set"
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("results", "tried.json"))
    page = (ROOT / "docs/contribute/board.md").read_text()
    (tmp_path / "stops.py").write_text(page.split("```python\n")[1].split("```")[0])
    words = [sys.executable, str(tmp_path / "stops.py"), str(copy)]
    ran = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    found = [json.loads(file.read_text()) for file in sorted((copy / "results").glob("*.json"))]
    assert not any(row["refused"] for row in found), found[0]["refused"]
    assert found[0]["solver_sha256"] != frozen.solver_sha256()
    result, _ = blind.score([(copy, answers)], None, 1)
    assert result["cases"] == 6 and not result["frozen"]


def test_a_fault_of_another_catalogue_has_no_near_name():
    """Score sets whose faults have other names by now."""
    assert near.near("a fault of old") == ()
    assert not near.is_near("a fault of old", ["backlash"])
    assert "stiction" in near.near("coulomb-friction")
