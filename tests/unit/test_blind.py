"""The blind check: sealed answers, a maker that shares nothing with the solver, honest figures."""

import dataclasses
import json
import math
import shutil
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from backends.shard import simulate
from backends.spec import Encoder, Spec
from benchmark.cli import app as cli
from benchmark.errors import UsageError
from benchmark.gap import blind
from benchmark.parts import registry
from diagnosis.blind import draw, faults, files, frozen, make, motion, rigs, sides
from diagnosis.blind.files import BlindSet
from diagnosis.blind.measures import median, share
from diagnosis.blind.mechanics import bristle, dart, plant
from diagnosis.blind.plant import CHANGES, IMPLEMENTED, NUMBERS, Plant
from leaderboard.blind.score import read_score

SEED = 5
WORDS = ("command-rate-limit", "sensor-delay", "backlash", "coulomb-friction")
"""Effects that a small set draws from."""
RESULT = {"log_sha256": "", "solver_sha256": "", "refused": None, "excluded": [], "cpu_s": 1.0}
NO_BASELINE = plant.Baseline(
    play_rad=0.0, friction_share=0.0, cogging_share=0.0, stiffening_rad2=0.0
)


def nothing(kind: type, **kept: float):
    """A baseline in which nothing is there but what is named."""
    return kind(**(dict.fromkeys((f.name for f in dataclasses.fields(kind)), 0.0) | kept))


IDEAL = {
    "plant": plant.Mechanics(NO_BASELINE),
    "dart": dart.Mechanics(nothing(dart.Baseline)),
    "bristle": bristle.Mechanics(nothing(bristle.Baseline, bristle_rad=1e-4)),
}
"""Plants without what every real drive has."""
SHORT = 300
"""Samples of a motion that tell enough."""
MECHANICS = frozen.ROOT / "diagnosis/blind/mechanics"
SOLVER_FOLDERS = ("diagnosis/search/", "diagnosis/replay/", "diagnosis/verdict/")


def small(**changes) -> draw.Settings:
    """A small set of one joint, two protocols and both kinds of real side."""
    wanted = {
        "cases": 8,
        "rigs": ("joint",),
        "reals": ("mujoco", "plant"),
        "effects": WORDS,
        "protocols": ("steps", "push"),
    }
    return draw.Settings(**(wanted | changes))


def catalogue() -> dict:
    return {name: registry.load("effect", name) for name in registry.names("effect")}


@pytest.fixture(scope="module")
def solved(tmp_path_factory) -> tuple[Path, Path]:
    """A small set, solved: its folder and its answers."""
    root = tmp_path_factory.mktemp("blind")
    folder, answers = root / "set", root / "sealed" / "answers.json"
    blind.make(small(), SEED, folder, answers, 1)
    blind.run(folder, 1, False)
    return folder, answers


@pytest.fixture(scope="module")
def scored(solved) -> tuple[dict, Path]:
    """Its score, and the folder of the tables."""
    folder, answers = solved
    tables = folder.parent / "scores"
    return blind.score([(folder, answers)], tables, 1, replay=1)[0], tables


def test_a_small_set_is_solved(scored):
    """Solve a small set from its logs alone as well as its strong effects allow."""
    result, _ = scored
    assert result["top1"] >= 0.75 and result["joint_right"] == 1.0
    assert result["none_false_alarm"] == 0.0 and result["pairs_one"] == 1.0
    assert result["magnitude_error_median"] < 0.05 and result["shrinkage_vs_oracle"] > 0.95
    assert result["unknown_recall"] > 0.0
    rows = {row["method"]: row for row in result["tables"]["baselines"]}
    assert result["top1"] > rows["chance: an effect of the catalogue at random"]["top1"]


def test_score_counts_every_case(scored):
    """Make, run and score a small set, and write all tables."""
    result, tables = scored
    rows = result["tables"]["cases"]
    assert result["cases"] == 8 and [row["number"] for row in rows] == list(range(8))
    assert result["frozen"] and result["solvers_tried"] == 1 and result["replayed"] == 1
    modes = [row["mode"] for row in rows]
    assert {mode: modes.count(mode) for mode in draw.SHARES} == {
        "single": 4, "pair": 1, "none": 1, "unknown": 2,
    }  # fmt: skip
    detectable = [r for r in rows if r["mode"] == "single" and r["detectable"]]
    assert result["intervals"]["top1"]["count"] == len(detectable) > 0
    assert result["top1"] == np.mean([r["verdict"] == r["truth"] for r in detectable])
    assert result["cpu_s_median"] == np.median([r["cpu_s"] for r in rows])
    assert json.loads((tables / "score.json").read_text())["top1"] == result["top1"]
    kept = read_score(tables / "score.json")
    assert kept.figure("top1").count == result["intervals"]["top1"]["count"]
    assert set(kept.kind.sides) == {row["real"] for row in rows}
    for name in ("headline", "cases", "groups", "confusion", "effects", "baselines"):
        assert len(pd.read_csv(tables / f"{name}.csv")) > 0
    assert "# Blind score" in (tables / "score.md").read_text()


def test_score_prints_one_object(solved, capfd):
    """Print one JSON object with plain figures."""
    folder, answers = solved
    assert cli.call(["blind", "score", str(folder), "--answers", str(answers), "--json"]) == 0
    printed = json.loads(capfd.readouterr().out)
    named = "top1 top3 joint_right none_false_alarm unknown_recall pairs_exact spurious_second "
    named += "magnitude_error_median interval_coverage shrinkage_vs_oracle cpu_s_median"
    assert all(printed[name] is None or 0 <= printed[name] < 60 for name in named.split())
    assert printed["status"] == "done" and printed["cases"] == 8


def test_a_case_that_breaks_the_solver_is_wrong(tmp_path):
    """Count a case on which the solver breaks as a wrong answer, and say why."""
    folder, answers = tmp_path / "set", tmp_path / "answers.json"
    wanted = small(cases=1, reals=("plant",), modes=("none",), protocols=("push",))
    blind.make(wanted, 1, folder, answers, 1)
    (folder / "cases" / "000" / "samples.parquet").unlink()
    found = BlindSet(path=folder)
    found.commit(frozen.commitment(found, found.commitment().answers_sha256, 1))
    assert "samples.parquet" in blind.run(folder, 1, False)["refused"]["000"]
    result, _ = blind.score([(folder, answers)], None, 1)
    assert result["none_false_alarm"] == 1.0 and result["none_accused"] == 0.0


def test_refitting_nominal_parameters_names_nothing(scored):
    """Hold the baseline that only refits to its definition: no effect, no false alarm."""
    result, _ = scored
    rows = {row["method"]: row for row in result["tables"]["baselines"]}
    nominal = rows["nominal parameters refitted alone"]
    assert nominal["top1"] == 0.0 and nominal["none_false_alarm"] == 0.0
    largest = rows["the effect that takes most of the gap"]
    assert largest["unknown_recall"] in (0.0, None) and largest["pairs_exact"] == 0.0
    assert rows["this solver"]["top1"] == result["top1"]


def test_the_true_effect_closes_the_gap(scored):
    """Let the true effects of an engine leave no more than is ordinary, however large the gap."""
    result, _ = scored
    rows = [row for row in result["tables"]["cases"] if row["real"] == "mujoco"]
    assert all(row["left_oracle"] < 1.3 for row in rows)
    wide = [row for row in rows if row["mode"] in ("single", "pair") and row["gap_oracle"] > 3.0]
    assert wide and all(row["share_oracle"] > 0.95 and row["detectable"] for row in wide)


@pytest.mark.slow
def test_small_magnitudes_are_searched(tmp_path, capfd):
    """Find how small a scale, a lock and noise still show, the last by what is named.

    A scale shows down to the smallest that is tried.
    """
    effects = "encoder-scale,self-lock,encoder-noise"
    words = ["blind", "detectable", "--hidden-effects", effects, "--draws", "2"]
    words += ["--real", "mujoco", "--protocol", "multisine", "--out", str(tmp_path), "--json"]
    assert cli.call(words) == 0
    found = {row["effect"]: row for row in json.loads(capfd.readouterr().out)["rows"]}
    scale = found["encoder-scale"]
    assert 0.01 < scale["smallest"] < 1.0 and scale["bound"] in ("", "<") and scale["unit"] == "%"
    noise = found["encoder-noise"]
    assert 0.05 < noise["smallest"] < 2.0 and noise["bound"] == "" and noise["unit"] == "mrad"
    assert len(pd.read_csv(tmp_path / "detectable.csv")) == 3
    assert "encoder-scale" in (tmp_path / "detectable.md").read_text()


def test_answers_stay_out_of_the_set(solved):
    """Leave no effect, joint, level, side or seed of the answers in the set's folder."""
    folder, answers = solved
    kept = json.loads(answers.read_text())
    for file in folder.rglob("*"):
        if file.is_file() and file.parts[-2] not in ("results",) and file.suffix != ".parquet":
            text = file.read_text()
            assert kept["nonce"] not in text and '"faults"' not in text, file
            if file.name in ("log.yaml", "case.json"):
                case = kept["cases"][int(file.parent.name)]
                hidden = {case["real"], case["mode"], *(f["level"] for f in case["faults"])}
                assert not [word for word in hidden if word in text], file
    with pytest.raises(UsageError, match="put it where no solver sees it"):
        blind.make(small(), SEED, folder.parent / "b", folder.parent / "b" / "a.json", 1)


def test_every_case_excludes_one_effect(solved):
    """Take the true effect out of the catalogue of unknowns, and another one out of all others."""
    folder, answers = solved
    for case in files.open_answers(answers, BlindSet(path=folder).commitment()).cases:
        hidden = [fault.effect for fault in case.faults]
        assert len(case.excluded) == 1
        assert (list(case.excluded) == hidden) == (case.mode == "unknown")
        assert case.mode == "unknown" or case.excluded[0] not in hidden
        said = BlindSet(path=folder).read_result(case.number)
        assert said["excluded"] == list(case.excluded)


def copied(solved, tmp_path) -> tuple[BlindSet, Path]:
    """A copy of the solved set to tamper with, and its answers."""
    folder, answers = solved
    shutil.copytree(folder, tmp_path / "copy")
    return BlindSet(path=tmp_path / "copy"), answers


def test_a_result_edited_to_the_truth_is_found(solved, tmp_path):
    """Solve cases again and refuse a score of results that say something else."""
    found, answers = copied(solved, tmp_path)
    for case in files.open_answers(answers, found.commitment()).cases:
        truth = sorted(f.effect for f in case.faults) or ["none"]
        forged = {"verdict": ["unknown"] if case.mode == "unknown" else truth, "confidence": 0.99}
        files.write_json(found.result(case.number), {**found.read_result(case.number), **forged})
    assert blind.score([(found.path, answers)], None, 1)[0]["top1"] == 1.0
    with pytest.raises(UsageError, match="solved again, says something else"):
        blind.score([(found.path, answers)], None, 1, replay=1)


def test_a_result_of_a_foreign_log_is_refused(solved, tmp_path):
    """Refuse a result with the hash of another log, and a log that was changed since."""
    found, answers = copied(solved, tmp_path)
    other = found.read_result(1)
    files.write_json(found.result(0), {**found.read_result(0), "log_sha256": other["log_sha256"]})
    with pytest.raises(UsageError, match="result of case 000 is not of the log"):
        blind.score([(found.path, answers)], None, 1)
    facts = found.log(0) / "case.json"
    facts.write_text(facts.read_text().replace("false", "true"))
    with pytest.raises(UsageError, match="log of case 000 is not of the log"):
        blind.score([(found.path, answers)], None, 1)


def test_results_carry_solver_and_time(solved, scored):
    """Write the hashes of log and solver and the time into every result, and the seal's limits."""
    found = BlindSet(path=solved[0])
    for number in found.numbers:
        said = found.read_result(number)
        assert said["log_sha256"] == found.commitment().logs_sha256[f"{number:03d}"]
        assert said["solver_sha256"] == frozen.solver_sha256() and said["time"].endswith("Z")
    proves, leaves_open = scored[0]["seal"]
    assert "proves" in proves and "--replay" in leaves_open


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("commitment.json", "[]", "holds no JSON object"),
        ("commitment.json", '{"files": 3}', "files is 3"),
        ("commitment.json", '{"logs_sha256": {"007": "a"}}', "does not name cases 000, 001"),
        ("cases/000/case.json", "{}", "excluded is {}; Field required"),
        ("cases/000/case.json", '{"excluded": 1}', "excluded is 1"),
        ("cases/000/case.json", b"\x87", "cannot be read as UTF-8"),
        ("results/000.json", '{"verdict": "none"}', "verdict is 'none'"),
        ("results/000.json", '{"confidence": "x"}', "confidence is 'x'"),
        ("results/000.json", '{"magnitudes": [{}]}', "magnitudes.0.effect is {}"),
        ("tried.json", '{"solvers": [1]}', "solvers.0 is 1"),
        ("tried.json", "[" * 100_000, "nested too deeply"),
    ],
)
def test_a_damaged_set_is_refused(tmp_path, name, text, said):
    """Name the file and the field of a set that is not as it was made."""
    found = BlindSet(path=tmp_path)
    read = {
        "commitment.json": found.commitment,
        "cases/000/case.json": lambda: found.given(0),
        "results/000.json": lambda: found.read_result(0),
        "tried.json": found.tried,
    }
    whole = files.Commitment(answers_sha256="", logs_sha256={}, solver_sha256="", files={})
    fine = {
        "commitment.json": {"schema": files.SCHEMA, **dataclasses.asdict(whole)},
        "results/000.json": RESULT,
    }
    if isinstance(text, str) and text.startswith("{"):
        text = json.dumps(fine.get(name, {}) | json.loads(text))
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(files.BlindError) as refused:
        read[name]()
    assert str(tmp_path / name) in str(refused.value) and said in str(refused.value)


def test_a_set_is_committed_to_a_later_solver_until_one_ran(solved, tmp_path):
    """Renew the commitment of a set that nothing was solved on, and of no other."""
    found, _ = copied(solved, tmp_path)
    with pytest.raises(UsageError, match="1 solvers were run"):
        blind.commit(found.path)
    (found.path / "tried.json").unlink()
    old = found.commitment()
    found.commit(dataclasses.replace(old, solver_sha256="0" * 64))
    assert blind.commit(found.path)["solver_sha256"] == old.solver_sha256
    assert found.commitment() == old
    (found.log(0) / "case.json").write_text('{"excluded": [], "robot": true}')
    with pytest.raises(UsageError, match="log of case 000"):
        blind.commit(found.path)


def test_changed_answers_are_refused(solved, tmp_path):
    """Refuse answers whose hash is not the one committed to."""
    folder, answers = solved
    forged = tmp_path / "forged.json"
    forged.write_text(answers.read_text().replace("0.", "0.0", 1))
    with pytest.raises(UsageError, match="was committed"):
        blind.score([(folder, forged)], None, 1)


def test_solved_cases_are_skipped(solved):
    """Solve only what has no result of this solver."""
    folder, _ = solved
    kept = BlindSet(path=folder).result(1).stat().st_mtime_ns
    BlindSet(path=folder).result(3).unlink()
    with pytest.raises(UsageError, match="case 003"):
        blind.score([solved], None, 1)
    again = blind.run(folder, 1, False)
    assert (again["solved"], again["was_done"]) == (1, 7)
    assert BlindSet(path=folder).result(1).stat().st_mtime_ns == kept


def test_a_changed_solver_is_refused(solved, monkeypatch, tmp_path):
    """Refuse to solve with other code or rules than were committed to, and say which."""
    folder, _ = solved
    files_now = frozen.solver_files()
    changed = {**files_now, "diagnosis/verdict/decide.py": "0" * 64}
    monkeypatch.setattr(frozen, "solver_files", lambda: changed)
    with pytest.raises(UsageError, match="diagnosis/verdict/decide.py changed"):
        blind.run(folder, 1, False)
    assert frozen.changed(BlindSet(path=folder).commitment()) == ["diagnosis/verdict/decide.py"]
    assert {"diagnosis/solver.py", "diagnosis/search/fit.py", "backends/drive.py"} <= set(files_now)
    assert {"backends/effects/backlash.py", "diagnosis/verdict/curve.json"} <= set(files_now)


def test_equal_seeds_give_equal_bytes(tmp_path):
    """Draw the same cases, byte by byte, from one seed, and others from another."""
    wanted = small(cases=3, reals=("plant", "mujoco"))
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        folder, answers = tmp_path / name, tmp_path / f"{name}.json"
        blind.make(wanted, seed, folder, answers, 1)
        found = sorted(f for f in folder.rglob("*") if f.is_file())
        texts.append([answers.read_bytes(), *(f.read_bytes() for f in found)])
    assert texts[0] == texts[1]
    assert texts[0][0] != texts[2][0]


def test_secret_seeds_differ(tmp_path):
    """Seal different answers when no seed is given."""
    hashes = set()
    for name in ("a", "b"):
        wanted = small(cases=1, reals=("plant",), modes=("none",), protocols=("push",))
        made = blind.make(wanted, None, tmp_path / name, tmp_path / f"{name}.json", 1)
        hashes.add(made["answers_sha256"])
    assert len(hashes) == 2


def test_maker_and_solver_share_no_code():
    """Reach no solver from the maker, no maker from the solver, no drive law from a plant."""
    maker = frozen.imported("diagnosis.blind.make")
    assert not [name for name in maker if name.startswith(SOLVER_FOLDERS)]
    assert not {"diagnosis/solver.py", "diagnosis/walk.py"} & maker
    solver = frozen.imported("diagnosis.solver")
    assert all(any(name.startswith(folder) for name in solver) for folder in SOLVER_FOLDERS)
    assert not [name for name in frozen.imported(frozen.ENTRY) if "blind" in name]
    for name in sides.ENGINES:
        theirs = frozen.imported(f"diagnosis.blind.engines.{name}")
        assert not [file for file in theirs if file.startswith(SOLVER_FOLDERS)]
    for name in sides.PLANTS:
        shared = {str(p.relative_to(frozen.ROOT)) for p in MECHANICS.glob("_*.py")}
        assert frozen.imported(f"diagnosis.blind.mechanics.{name}") <= shared | {
            "diagnosis/blind/plant.py",
            f"diagnosis/blind/mechanics/{name}.py",
            "backends/spec.py",
            "backends/state.py",
        }


def test_effects_are_dealt_evenly():
    """Draw every effect once before any again, at all levels in turn, on every side alike."""
    count = 3 * len(IMPLEMENTED)
    reals, known = ("mujoco", "bullet", "plant"), {"modes": ("single",), "effects": IMPLEMENTED}
    settings = draw.Settings(cases=count, reals=reals, rigs=("hand",), **known)
    cases = draw.draw(settings, 0)
    cards = [(case.faults[0].effect, case.faults[0].level) for case in cases]
    assert len(set(cards)) == count
    assert {r: [c.real for c in cases].count(r) for r in reals} == dict.fromkeys(reals, count // 3)


@pytest.mark.parametrize("rig", rigs.RIGS)
def test_drawn_magnitudes_are_allowed(rig):
    """Draw magnitudes that an effect may have, on joints of the rig, none of them zero."""
    kinds = catalogue()
    settings = draw.Settings(cases=200, reals=("plant",), rigs=(rig,))
    names = rigs.nominal(rig).hand.joint_names
    for fault in (f for case in draw.draw(settings, 1) for f in case.faults):
        low, high = kinds[fault.effect].bounds
        assert low <= fault.magnitude <= high and fault.magnitude != 0.0
        assert fault.joint is None or fault.joint in names


def test_nominal_errors_spare_what_is_hidden():
    """Draw no nominal error where an effect changes the same number: the truth is one number."""
    settings = draw.Settings(
        cases=60,
        reals=("plant",),
        effects=("kp-scale", "coulomb-friction", "link-mass", "backlash"),
    )
    for case in draw.draw(settings, 2):
        hidden = [(f.effect, f.joint) for f in case.faults]
        for error in case.nominal:
            assert (error.effect, error.joint) not in hidden
            assert (error.effect, None) not in hidden


def bare(rig: str, drive_s: float) -> Spec:
    """A rig without friction and sensor noise, at another drive period."""
    spec = rigs.nominal(rig)
    spec = spec.with_drives(dataclasses.replace(d, coulomb_nm=0.0) for d in spec.drives)
    spec = spec.with_driven(
        dataclasses.replace(b, joint=dataclasses.replace(b.joint, encoder=Encoder()))
        for b in spec.hand.driven
    )
    return dataclasses.replace(spec, timing=dataclasses.replace(spec.timing, drive_s=drive_s))


@pytest.mark.parametrize(("rig", "tilt_rad"), [("finger", 0.0), ("finger", 1.2), ("joint", 0.0)])
def test_plant_agrees_with_engines_in_the_limit(rig, tilt_rad):
    """Meet the engines' drive law without friction and play, to first order in its period.

    Both integrate semi-implicitly, at `dt` and at 0.1 ms: their distance goes as dt - 0.1 ms.
    """
    rng = np.random.default_rng(3)
    protocols = ("triangle", "multisine", "push")  # none reaches the torque limit
    motions = [motion.motion(p, rigs.nominal(rig), rng) for p in protocols]
    real = Plant(bare(rig, 1e-3), IDEAL["plant"])
    real.add("gravity-tilt", tilt_rad, None)
    tilt = registry.load("effect", "gravity-tilt")(magnitude=tilt_rad)
    ours = [real.run(m.target_rad, m.push_nm, 1 / motion.RATE_HZ, rng) for m in motions]
    engine = registry.load("backend", "mujoco")
    apart = []
    for drive_s in (1e-3, 5e-4):
        world = tilt.on_spec(bare(rig, drive_s))
        theirs = make.engine_readings(lambda specs: simulate(engine, specs, 1), world, motions, rng)
        pairs = zip(ours, theirs, strict=True)
        apart.append([np.abs(a["position"] - b["position"]).max() for a, b in pairs])
    expected = (1e-3 - 1e-4) / (5e-4 - 1e-4)
    assert np.divide(apart[0], apart[1]) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(("rig", "tilt_rad"), [("finger", 0.0), ("finger", 1.2), ("joint", 0.4)])
def test_plants_agree_in_the_limit(rig, tilt_rad, monkeypatch):
    """Meet the plant's closed form without friction and play, at the plant's own period.

    Within 0.1 mrad and 1 % of the torque where limits are not reached: DART's articulated bodies
    and the closed form are two derivations of a chain with rotors and springs between.
    """
    rng = np.random.default_rng(3)
    spec = bare(rig, 1e-3)
    played = [motion.motion(p, spec, rng) for p in ("triangle", "multisine", "push")]
    motions = [(m.target_rad[:SHORT], m.push_nm[:SHORT]) for m in played]
    monkeypatch.setattr(dart, "TICK_S", plant.TICK_S)
    monkeypatch.setattr(dart.Mechanics, "tick_s", plant.TICK_S)
    read: dict[str, list] = {}
    for name, mechanics in IDEAL.items():
        real = Plant(spec, mechanics)
        real.add("gravity-tilt", tilt_rad, None)
        read[name] = [real.run(*one, 1 / motion.RATE_HZ, rng) for one in motions]
    limit = spec.drives[0].torque_limit_nm
    for theirs in (read["dart"], read["bristle"]):
        for one, other in zip(read["plant"], theirs, strict=True):
            assert other["position"] == pytest.approx(one["position"], abs=1e-4)
            assert other["torque"] == pytest.approx(one["torque"], abs=0.01 * limit)


@pytest.mark.parametrize("name", ["dart", "bristle"])
@pytest.mark.parametrize(("share", "moves"), [(0.95, False), (1.05, True)])
def test_plants_stick_until_friction_is_overcome(share, moves, name):
    """Hold a joint whose target calls for less than its breakaway torque, and let go above.

    The arm rests a second first: DART must not put it to sleep.
    """
    spec = rigs.nominal("joint")
    drive = spec.drives[0]
    real = Plant(bare("joint", 1e-3), IDEAL[name])
    real.add("gravity-tilt", math.pi / 2, None)  # gravity along the arm, which stays straight
    real.add("coulomb-friction", 0.1, None)
    real.add("stiction", 0.1, None)
    samples = 401
    target = np.zeros((samples, 1))
    target[200:, 0] = np.linspace(0.0, share * 0.2 / drive.kp_nm_rad, samples - 200)
    read = real.run(target, np.zeros((samples, 1)), 1 / motion.RATE_HZ, np.random.default_rng(0))
    assert np.ptp(read["motor"][:200]) < 1e-5
    assert (np.ptp(read["motor"]) > 1e-3) == moves


def test_kept_real_sides_are_named_alone():
    """Deal `all` without the sides that no rule may be tuned on; they have no contacts either."""
    words = {"rig": "finger", "modes": "all", "effects": "all", "protocols": "all"}
    reals = set(blind.settings(8, "all", **words).reals)
    assert {*registry.usual("backend"), "plant"} <= reals and reals.isdisjoint(blind.KEPT_APART)
    assert blind.settings(8, "dart", **words).reals == ("dart",)
    assert set(blind.KEPT_APART) < set(sides.STICKLESS)
    for name in ("dart", "drake"):
        with pytest.raises(UsageError, match="drake.* have joints alone"):
            blind.settings(8, name, **(words | {"rig": "held"}))


@pytest.mark.parametrize(
    ("name", "module", "package"),
    [
        ("dart", "mechanics.dart", "dartpy"),
        ("drake", "engines.drake", "pydrake.math"),
        ("exudyn", "engines.exudyn", "exudyn"),
    ],
)
def test_a_real_side_without_its_package_is_refused(
    name, module, package, tmp_path, capfd, monkeypatch
):
    """Say in one line that the package is not there, and make nothing."""
    monkeypatch.delitem(sys.modules, f"diagnosis.blind.{module}", raising=False)
    monkeypatch.setitem(sys.modules, package, None)
    words = ["blind", "make", "--out", str(tmp_path / "set"), "--answers", str(tmp_path / "a")]
    assert cli.call([*words, "--real", name, "--cases", "1"]) == 1
    err = capfd.readouterr().err
    assert f"real side '{name}' cannot be loaded" in err and "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_a_plant_knows_no_branches():
    """Refuse a tree of hinges, of which neither closed form nor drive order would be right."""
    spec = rigs.nominal("finger")
    first, second = spec.hand.driven
    third = dataclasses.replace(second, name="third")
    bodies = (*spec.hand.bodies, third)
    tree = dataclasses.replace(spec, hand=dataclasses.replace(spec.hand, bodies=bodies))
    with pytest.raises(ValueError, match="do not branch"):
        Plant(tree, IDEAL["plant"])


@cache
def shown(name: str, protocol: str, *effects: tuple[str, float], rig: str = "finger") -> np.ndarray:
    """What a rig of a plant shows with effects, its first joint's where they act on joints."""
    spec = rigs.nominal(rig)
    real, joint = Plant(spec, sides.mechanics(name)()), spec.hand.joint_names[0]
    for effect, magnitude in effects:
        real.add(effect, magnitude, None if effect == "gravity-tilt" else joint)
    one, first = motion.motion(protocol, spec, np.random.default_rng(5)), slice(SHORT)
    played = one.target_rad[first], one.push_nm[first]
    return real.run(*played, 1 / motion.RATE_HZ, np.random.default_rng(0))["position"]


@pytest.mark.parametrize("name", ["plant", "dart", "bristle"])
@pytest.mark.parametrize("effect", IMPLEMENTED)
def test_plant_effects_act(effect, name):
    """Change what a plant shows in steps or under a push by every effect, to one of its sides."""
    kind = catalogue()[effect]
    rig = "joint" if kind.by_weight else "finger"
    natural = kind.natural(rigs.nominal(rig).drives[0])
    assert any(
        np.abs(
            shown(name, protocol, (effect, levels[-1] * natural), rig=rig)
            - shown(name, protocol, rig=rig)
        ).max()
        > rigs.NOISE_RAD
        for protocol in ("steps", "push")
        for levels in (kind.levels, kind.opposite or kind.levels)
    )


@pytest.mark.parametrize("name", ["plant", "dart", "bristle"])
def test_no_plant_is_changed_by_zero(name):
    """Show the same with every effect at zero as without any."""
    zeros = [(effect, 0.0) for effect in IMPLEMENTED]
    assert np.array_equal(shown(name, "steps", *zeros), shown(name, "steps"))


def test_plants_know_what_engines_know():
    """Have a number of the plants for every effect that they implement, all of the catalogue."""
    assert set(IMPLEMENTED) <= {*faults.in_free_air(), *faults.of_arms()}
    assert {number for number, _ in CHANGES.values()} <= set(NUMBERS)


def test_motions_stay_in_range():
    """Command targets within the range, from the centre, and push within the drive's torque."""
    for rig in rigs.RIGS:
        spec = rigs.nominal(rig)
        ranges = np.array([b.joint.range_rad for b in spec.hand.driven])
        limit = np.array([d.torque_limit_nm for d in spec.drives])
        for number, protocol in enumerate(motion.PROTOCOLS):
            one = motion.motion(protocol, spec, np.random.default_rng(number))
            assert (one.target_rad >= ranges[:, 0]).all() and (one.target_rad <= ranges[:, 1]).all()
            assert np.array_equal(one.target_rad[0], ranges.mean(axis=1))
            assert (np.abs(one.push_nm) < 0.5 * limit).all()
            assert (protocol == "push") == bool(one.push_nm.any())


def test_shares_have_wilson_intervals():
    """Give Wilson's interval: 8 of 10 is 0.490 to 0.943 at 95 % (Wilson, 1927)."""
    found = share(pd.Series([True] * 8 + [False] * 2 + [None]))
    z, n, p = 1.959964, 10, 0.8
    center = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert (found.low, found.high) == pytest.approx((center - half, center + half), abs=1e-6)
    assert (found.value, found.count) == (0.8, 10)
    assert share(pd.Series([None])).value is None


def test_medians_lie_between_order_statistics():
    """Cover the true median of skewed samples in at least 95 % of draws, less three deviations."""
    rng, hits = np.random.default_rng(0), 0
    for _ in range(400):
        found = median(pd.Series(rng.exponential(size=15)))
        hits += found.low <= math.log(2) <= found.high
    assert hits / 400 > 0.95 - 3 * math.sqrt(0.95 * 0.05 / 400)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--cases", "0"], "--cases is 0"),
        (["--real", "havok"], "no real side named 'havok'"),
        (["--rig", "fingr"], "Did you mean 'finger'?"),
        (["--modes", "double"], "no mode named 'double'"),
        (["--hidden-effects", "backlash"], "3 or more"),
        (["--hidden-effects", "taxel-drift,backlash,stiction"], "no effect named 'taxel-drift'"),
        (["--seed", "-1"], "--seed is '-1'"),
        (["--rig", "held", "--real", "mujoco,plant"], "have joints alone and no contacts"),
        (["--rig", "held,finger"], "make one set of finger, hand, joint, and another of held"),
        (["--rig", "held", "--protocol", "steps"], "has no 'grasp'"),
        (["--protocol", "grasp"], "no protocol named 'grasp'"),
    ],
)
def test_wrong_options_are_refused(options, text, tmp_path, capfd):
    """Refuse options that cannot be drawn, saying what may be."""
    places = ["--out", str(tmp_path / "o"), "--answers", str(tmp_path / "a.json")]
    assert cli.call(["blind", "make", *places, *options]) == 2
    assert text in " ".join(capfd.readouterr().err.split())
    assert not (tmp_path / "a.json").exists()


def test_folders_that_are_no_set_are_refused(tmp_path, capfd):
    """Refuse to run or score what `bench blind make` did not finish."""
    assert cli.call(["blind", "run", str(tmp_path)]) == 2
    assert cli.call(["blind", "score", str(tmp_path), "--answers", str(tmp_path / "a")]) == 2
    assert "no commitment.json" in capfd.readouterr().err
