"""Calibration: known gains, play and skin come back from logs that another engine wrote."""

import dataclasses
import json
import re

import numpy as np
import pandas as pd
import pytest
import yaml

from backends.shard import simulate
from backends.touch import THRESHOLD_M
from benchmark.cli import app as cli
from benchmark.errors import CommandError
from benchmark.gap import _calibration_texts as texts
from benchmark.gap.calibrate import FILE
from benchmark.parts import registry
from benchmark.settings.effects import PAPER_SPREAD, effect_name, parse_spread, read_effects
from benchmark.settings.request import requested
from benchmark.settings.run_spec import RunSpec
from diagnosis.calibration import backlash, gains, tactile
from diagnosis.calibration.backlash import least_absolute
from diagnosis.calibration.calibrate import Calibration
from diagnosis.calibration.result import (
    Backlash,
    CalibrationFile,
    Gain,
    Gains,
    Joint,
    read_calibration,
    write_calibration,
)
from diagnosis.logs.log import EpisodeMeta, Log, LogError, write_log
from diagnosis.motion.batch import replay
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import Recording, recordings
from diagnosis.recording.record import Plan, record
from diagnosis.replay.parts import limbs

PLAY_DEG = {"J0": 1.3, "J1": 0.0, "J3": 0.8, "J4": 0.3, "J6": 1.1, "J7": 0.0}
GAINS = {"J0": (1.12, 0.92), "J1": (0.9, 1.15), "J3": (1.05, 1.2)}
GAINS |= {"J4": (1.2, 0.85), "J6": (0.95, 1.05), "J7": (0.85, 0.9)}
HIDDEN = ",".join(
    [
        "self-lock=10Nm,encoder-noise=0.04deg",
        *(f"backlash={deg}deg@{joint}" for joint, deg in PLAY_DEG.items() if deg),
        *(f"kp-scale={100 * (kp - 1):.4g}%@{joint}" for joint, (kp, _) in GAINS.items()),
        *(f"kd-scale={100 * (kd - 1):.4g}%@{joint}" for joint, (_, kd) in GAINS.items()),
    ]
)
"""The real side: gains within 20 % of nominal, play, worms that lock, sensors with noise."""
CONSTANT = ((30, 33), (1640, 1642))
"""Samples of the push between which neither command nor push changes."""
PLAY_ERROR_DEG = 0.05
"""What a calibration promises."""


def world(effects: str = "none"):
    """The nominal hand with effects."""
    return RunSpec(backend="mujoco", task="line", effects=effects).world()


def engine(name: str):
    """Puts worlds on an engine, on one core; skips where it is not installed."""
    try:
        backend = registry.load("backend", name)
    except CommandError as error:
        pytest.skip(str(error))
    return lambda specs: simulate(backend, specs, 1)


mujoco = engine("mujoco")


def take(backend: str, effects: str, *protocols: str) -> Log:
    """A log of an engine."""
    return record(engine(backend), world(effects), Plan(protocols=protocols), source="test")


def without_motor(log: Log) -> Log:
    """The log of a robot that has no encoder on its motors."""
    named = [c for c in log.samples.columns if c.startswith("motor_rad")]
    meta = log.meta.model_copy(update={"channels": {}})
    return dataclasses.replace(log, meta=meta, samples=log.samples.drop(columns=named))


def first(motion: Recording, seconds: float) -> Recording:
    """The beginning of an episode."""
    return motion.part(0, int(np.searchsorted(motion.time_s, seconds + 1e-9)))


@pytest.fixture(scope="module")
def pushed() -> Log:
    """The push test of the hidden hand, in Bullet."""
    return take("bullet", HIDDEN, "push")


@pytest.fixture(scope="module")
def moved() -> Log:
    """Steps and multisine of the hidden hand, in Bullet."""
    return take("bullet", HIDDEN, "steps", "multisine")


def moving(log: Log, spec, seconds: float = 2.0) -> list[Limb]:
    """The limbs of a hand in the first two seconds of a log's episodes."""
    return [
        Limb(
            spec=part,
            recordings=tuple(first(m, seconds) for m in recordings(log, part)),
            rigid=False,
        )
        for part in limbs(spec)
    ]


def fitted(log: Log, spec, start: float = 1.0) -> dict[str, tuple[gains.GainFit, int]]:
    """The fit of every joint's gains, and its number there."""
    found = {}
    for limb, plain in zip(moving(log, spec), limbs(spec), strict=True):
        fit = gains.GainFit(limb, plain)
        fit.scale[:] = start
        fit.run(range(len(limb.joints)), np.random.default_rng(0))
        found |= {name: (fit, j) for j, name in enumerate(limb.joints)}
    return found


def plays(log: Log, effects: str = "none") -> dict:
    spec = world(effects)
    return backlash.push_test(mujoco, spec, recordings(log, spec))


@pytest.mark.parametrize("motor", [True, False])
def test_the_push_test_finds_play_and_locks(pushed, motor):
    """Find play and self-lock of another engine's hand, its gains unknown."""
    found = plays(pushed if motor else without_motor(pushed))
    for joint, deg in PLAY_DEG.items():
        play = found[joint]
        assert np.degrees(play.mean_rad) == pytest.approx(deg, abs=PLAY_ERROR_DEG)
        assert play.has_play == (deg > 0)
        assert play.locks == (joint in ("J0", "J3", "J6"))
        assert play.reference == ("logged" if motor else "replayed")
        low, high = (play.ends_rad - play.rest_rad[:, None]).mean(axis=0)
        assert np.degrees(high - low) / 2 == pytest.approx(deg, abs=PLAY_ERROR_DEG)


def test_elastic_give_is_no_play(pushed):
    """Tell give from play: stiffness as it is, and the same play under a harder push."""
    found = plays(pushed)
    for name, drive in zip(pushed.joints, world().drives, strict=True):
        assert 1 / found[name].give_rad_nm == pytest.approx(drive.gear_stiffness_nm_rad, rel=0.03)
        assert np.ptp(found[name].half_rad) < np.radians(PLAY_ERROR_DEG)


def test_a_push_of_one_size_takes_the_nominal_give(pushed):
    """Take the nominal stiffness where the push does not vary, and still find the play."""
    spec = world()
    (push,) = recordings(pushed, world())
    flat = np.abs(push.push[:, 0]) > 0.99 * np.abs(push.push[:, 0]).max()
    one_size = dataclasses.replace(push, push=np.where(flat[:, None], push.push, 0.0))
    play = backlash.push_test(mujoco, spec, [one_size])["J0"]
    assert 1 / play.give_rad_nm == spec.drives[0].gear_stiffness_nm_rad
    assert np.degrees(play.mean_rad) == pytest.approx(PLAY_DEG["J0"], abs=PLAY_ERROR_DEG)


def test_play_is_not_made_up(pushed, moved):
    """Give a reason and no number: no push, a push one way alone, a sensor on the motor's side."""
    spec = world()
    assert set(backlash.push_test(mujoco, spec, []).values()) == {backlash.NO_PUSH}
    assert set(plays(moved).values()) == {backlash.NO_PUSH}
    (push,) = recordings(pushed, world())
    one_way = dataclasses.replace(push, push=np.maximum(push.push, 0))
    assert set(backlash.push_test(mujoco, spec, [one_way]).values()) == {backlash.NO_PUSH}
    blind = spec.with_driven(
        dataclasses.replace(b, joint=dataclasses.replace(b.joint, sensor="motor"))
        for b in spec.hand.driven
    )
    assert set(backlash.push_test(mujoco, blind, [push]).values()) == {backlash.MOTOR_SIDE}
    broken = dataclasses.replace(push, measured=push.measured * (np.arange(6) > 0))
    found = backlash.push_test(mujoco, spec, [broken])
    assert found["J0"] == backlash.STUCK and isinstance(found["J1"], backlash.Play)


def test_pushes_that_break_the_nominal_world_give_a_reason(pushed, tmp_path, monkeypatch):
    """Give a reason and no number where the replay leaves the numbers."""
    monkeypatch.chdir(tmp_path)  # the engine logs its warnings where it runs
    (push,) = recordings(pushed, world())
    begun_s = push.time_s[np.abs(push.push).max(axis=1) > 0.1].min()
    huge = first(dataclasses.replace(push, push=1e4 * push.push), begun_s + 0.02)
    assert set(backlash.push_test(mujoco, world(), [huge]).values()) == {backlash.UNSTABLE}


@pytest.mark.parametrize(
    "start", [1.0, *(pytest.param(far, marks=pytest.mark.slow) for far in (0.4, 2.0))]
)
def test_a_fit_ends_at_the_least_error(moved, start):
    """Go from far off to the gains of another engine's hand."""
    spec = world("self-lock=10Nm," + ",".join(f"backlash={d}deg@{j}" for j, d in PLAY_DEG.items()))
    for joint, (fit, j) in fitted(moved, spec, start).items():
        assert fit.scale[j] == pytest.approx(GAINS[joint], rel=0.01)


def test_floating_joints_do_not_count(moved):
    """Leave out samples of joints between their teeth, and none of joints without play."""
    spec, blind = world("backlash=1deg@J0"), without_motor(moved)
    judged, logged = fitted(blind, spec), fitted(moved, spec)
    share = {joint: fit.used[:, j].mean() for joint, (fit, j) in judged.items()}
    assert 0.05 < share["J0"] < 0.9
    assert min(share[joint] for joint in ("J3", "J4", "J6", "J7")) == 1.0
    assert logged["J0"][0].used[:, 0].mean() > share["J0"]
    assert all(fit.by_motor[j] for fit, j in logged.values())
    assert not any(fit.by_motor[j] for fit, j in judged.values())


def test_gains_are_not_made_up(moved):
    """Say that a joint which never moves, or a log that is short, tells no gains."""
    limb = moving(moved, world())[0]
    still = [dataclasses.replace(m, measured=m.measured * [0, 1]) for m in limb.recordings]
    limb = dataclasses.replace(limb, recordings=tuple(still))
    assert "it moves by 0 deg" in gains.reason_against(limb, 0)
    assert gains.reason_against(limb, 1) == ""
    short = moving(moved, world(), seconds=0.35)[0]
    assert "readings; needed" in gains.reason_against(short, 1)


def test_least_absolute_errors_ignore_outliers():
    """Find a line through the larger part of the samples, exactly."""
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(300, 2))
    miss = columns @ [0.02, -0.05]
    miss[:90] += rng.normal(size=90)
    found = least_absolute(miss, columns)
    assert found == pytest.approx([0.02, -0.05], abs=1e-4)


def test_the_bootstrap_gives_the_standard_error():
    """Find the least error and its standard error, of normal noise sigma sqrt(pi / 2 n)."""
    samples, sigma, miss = 1000, 0.1, []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        columns, noise = rng.normal(size=(samples, 2)), sigma * rng.normal(size=samples)
        points = 0.03 * rng.normal(size=(48, 2))
        terms, block = np.column_stack([np.ones(48), points]), np.arange(samples) // 20
        known = terms, points @ columns.T, noise, block
        draws = [gains.least_error(*known, rng) for _ in range(gains.DRAWS)]
        miss.append([gains.least_error(*known), np.std(draws, axis=0)])
    best, std = np.swapaxes(miss, 0, 1)
    wanted = sigma * np.sqrt(np.pi / 2 / samples)
    assert np.mean(std) == pytest.approx(wanted, rel=0.15)
    assert np.abs(best).max() < 3 * wanted


def test_viscous_friction_reads_as_damping(moved):
    """Say that a log without torque takes viscous friction for derivative gain."""
    fit, j = fitted(moved, world())["J1"]
    confused = dict(text.split(": ") for text in gains.confusions(fit, j))
    assert "command-delay" not in confused
    moved = [[float(x) for x in re.findall(r"k[pd] (\S+) %", text)] for text in confused.values()]
    assert all(np.abs(gains_percent).max() >= 1.0 for gains_percent in moved)
    kp, kd = (float(x) / 100 for x in re.findall(r"k[pd] (\S+) %", confused["viscous-friction"]))
    added = 1e-3 * float(confused["viscous-friction"].split()[0])
    # both slow the motor; under the torque limit alone, viscous friction comes on top of it
    whole = fit.scale[j, 1] * fit.limb.spec.drives[j].kd_nms_rad
    assert kd - kp == pytest.approx(added / whole, rel=0.1)


def test_replay_keeps_gaps_and_pushes(pushed):
    """Replay the log of an engine in that engine: what was recorded, gaps or not."""
    hidden = world(HIDDEN.replace("encoder-noise=0.04deg,", ""))
    log = record(mujoco, hidden, Plan(protocols=("push",)), source="test")
    (push,) = recordings(log, world())
    held = np.ones(len(push.time_s), dtype=bool)
    for before, after in CONSTANT:
        held[before + 1 : after] = False
    left_out = (push.command, push.push)
    assert not any(np.ptp(x[a : b + 1], axis=0).any() for x in left_out for a, b in CONSTANT)
    gappy = dataclasses.replace(
        push,
        time_s=push.time_s[held],
        command=push.command[held],
        push=push.push[held],
        measured=push.measured[held],
    )
    (whole,), (cut,) = replay(mujoco, [hidden], [push]), replay(mujoco, [hidden], [gappy])
    assert np.array_equal(whole[0], push.measured[:, :2])
    assert np.array_equal(cut[0], whole[0][held])


def touched(unit: str = "m") -> tuple[Log, dict]:
    """A log of one joint and one finger of 4 x 4 taxels: a rest without contact, and a press."""
    rng = np.random.default_rng(0)
    truth = {
        "offset": rng.uniform(0, 1e-4, 16),
        "drift": np.where(np.arange(16) == 3, 2e-5, 0.0),
        "noise": 1e-6,
        "dead": 5,
    }
    t = np.arange(800) * 5e-3
    rest = truth["offset"] + np.outer(t, truth["drift"])
    press = np.tile(truth["offset"], (100, 1))
    press[50:, :12] += 5e-4
    press[:, truth["dead"]] = truth["offset"][5]
    readings = np.concatenate([rest, press])
    readings += truth["noise"] * rng.normal(size=readings.shape)
    rows = {
        "episode": np.repeat([0, 1], [800, 100]),
        "t_s": np.concatenate([t, t[:100]]),
        "command_rad.J0": 0.0,
        "position_rad.J0": 0.0,
        "touch.finger1": list(readings),
    }
    log = take("mujoco", "none", "push")
    episodes = (EpisodeMeta(episode=0, protocol="free"), EpisodeMeta(episode=1, protocol="grasp"))
    meta = log.meta.model_copy(update={"episodes": episodes, "channels": {}})
    return Log(meta=meta, samples=pd.DataFrame(rows)), truth


def test_the_skin_is_calibrated():
    """Find offset, noise, drift and dead taxels; none of the rest counts as contact."""
    log, truth = touched()
    skin = tactile.calibrate_touch(log, (4, 4))["finger1"]
    centred = truth["offset"] + truth["drift"] * 2.0  # the mean time of a rest of 4 s
    assert skin.offset == pytest.approx(centred, abs=5 * truth["noise"] / np.sqrt(800) + 5e-8)
    assert skin.noise == pytest.approx([truth["noise"]] * 16, rel=0.15)
    assert (np.abs(skin.drift_s - truth["drift"]) < 5 * np.array(skin.drift_std_s)).all()
    assert skin.fastest_drift_s == pytest.approx(2e-5, rel=0.02)
    assert skin.threshold == pytest.approx(5 * truth["noise"], rel=0.15)
    assert skin.dead == (truth["dead"],)
    assert skin.touched == 12
    given = tactile.calibrate_touch(log, (4, 4), THRESHOLD_M)["finger1"]
    assert given.threshold == THRESHOLD_M
    assert given.false_share == 0.0


def test_binarisation_is_the_papers():
    """Count as contact what is above offset and threshold, and nothing below the offset."""
    reading = np.array([0.0, 1.0, 2.0, 3.1])
    assert tactile.binarise(reading, np.ones(4), 2.0).tolist() == [False, False, False, True]


def test_skin_without_a_rest_is_not_calibrated(pushed):
    """Ask for touch without contact where there is none."""
    assert tactile.calibrate_touch(pushed, (16, 8)) == tactile.NO_READINGS


KNOWN = read_effects("built,link-mass=10%", world().hand)


def made_up() -> Calibration:
    """A calibration of the hand as built, with numbers for J0 alone."""
    nominal = world(KNOWN.text)
    first = dataclasses.replace(
        nominal.drives[0], kp_nm_rad=6.6, kd_nms_rad=0.135, play_rad=np.radians(1.25)
    )
    joint = Gains(
        kp_nm_rad=Gain(mean=6.6, std=0.132, relative=0.1),
        kd_nms_rad=Gain(mean=0.135, std=0.00405, relative=-0.1),
        correlation=0.9,
        compared="position",
        samples=300,
        error_nominal_mrad=2.0,
        error_calibrated_mrad=1.0,
        confounded=(),
    )
    names = nominal.hand.joint_names
    play = backlash.Play(
        held_rad=np.zeros(2),
        rest_rad=np.zeros(2),
        ends_rad=np.radians([[-1.24, 1.24], [-1.26, 1.26]]),
        give_rad_nm=0.05,
        residual_rad=1e-4,
        reference="logged",
        locks=True,
    )
    return Calibration(
        calibrated=nominal.with_drives((first, *nominal.drives[1:])),
        joints=dict.fromkeys(names, Joint(gains="not identifiable", backlash=backlash.NO_PUSH))
        | {"J0": Joint(gains=joint, backlash=Backlash.of(play))},
        touch=tactile.NO_READINGS,
        touch_unit="m",
        fits=(),
    )


def written(path) -> CalibrationFile:
    """The made-up calibration as a file."""
    found = made_up()
    content = CalibrationFile(
        schema=1,
        log="log",
        source="test",
        backend="mujoco",
        hand="trx",
        stick="reference",
        nominal_effects=KNOWN.text,
        seed=0,
        effects=texts.effects_text(found, world(), KNOWN.effects),
        spread=texts.spread_text(found),
        joints=found.joints,
        tactile=found.touch,
    )
    write_calibration(path, content)
    return content


def test_the_effects_are_the_calibrated_world(tmp_path):
    """Write effects that give the calibrated world, and keep those that were not calibrated."""
    found = made_up()
    text = texts.effects_text(found, world(), KNOWN.effects)
    assert text.startswith("link-mass=10%,backlash=1.250deg@J0,self-lock=10Nm@J0,kp-scale=+10")
    given = world(text)
    for a, b in zip(given.drives, found.calibrated.drives, strict=True):
        assert dataclasses.astuple(a) == pytest.approx(dataclasses.astuple(b), rel=1e-9)
    assert texts.effects_text(found, found.calibrated, ()) == (
        "backlash=1.250deg@J0,self-lock=10Nm@J0,backlash=1.000deg@J3,self-lock=10Nm@J3,"
        "backlash=1.000deg@J6,self-lock=10Nm@J6"
    )


def test_the_spread_is_as_sure_as_the_gains():
    """Draw calibrated gains by their own spread, all else by the paper's."""
    hand = world().hand
    drawn = {
        (effect_name(e), e.joint): e.magnitude
        for e in parse_spread(texts.spread_text(made_up()), hand)
    }
    paper = {effect_name(e): e.magnitude for e in parse_spread(PAPER_SPREAD, hand)}
    assert drawn[("kp-scale", "J0")] == pytest.approx(0.02)
    assert drawn[("kd-scale", "J0")] == pytest.approx(0.03)
    for joint in hand.joint_names[1:]:
        assert drawn[("kp-scale", joint)] == paper["kp-scale"]
    for name in set(paper) - {"kp-scale", "kd-scale"}:
        assert drawn[(name, None)] == paper[name]


def test_a_run_takes_a_calibration(tmp_path):
    """Run in the calibrated world and draw domains around it."""
    content = written(tmp_path / "calibration.yaml")
    assert read_calibration(tmp_path / "calibration.yaml") == content
    spec = requested({"backend": "bullet", "task": "eight"}, calibration=tmp_path / FILE)
    assert (spec.effects, spec.spread) == (content.effects, content.spread)


RUN = ["run", "--backend", "mujoco", "--task", "line"]


def test_calibration_and_effects_exclude_each_other(tmp_path, capfd):
    """Refuse two worlds at once, and a file that is none."""
    written(tmp_path / FILE)
    both = [*RUN, "--calibration", str(tmp_path / FILE), "--effects", "none"]
    assert cli.call(both) == 2
    assert "both define the worlds; leave one out" in capfd.readouterr().err
    assert cli.call([*RUN, "--calibration", str(tmp_path / "absent.yaml")]) == 2
    assert "no calibration at" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 2}, "schema: input should be 1 (given: 2)"),
        ({"effects": None}, "effects: input should be a valid string"),
        ({"effects": "backlsh=1deg"}, "Did you mean 'backlash'?"),
        ({"spread": "kp-scale=-5%"}, "is negative; allowed: from 0"),
        ({"seeds": 1}, "seeds: unknown field"),
        ({"hand": "left"}, "it is a calibration of 'left'"),
    ],
)
def test_a_bad_calibration_names_field_value_and_rule(tmp_path, change, words, capfd):
    """Name the field, its value and what is allowed."""
    path = tmp_path / FILE
    written(path)
    data = {**yaml.safe_load(path.read_text()), **change}
    path.write_text(yaml.safe_dump(data))
    assert cli.call([*RUN, "--calibration", str(path)]) == 2
    err = capfd.readouterr().err
    assert words in err
    assert "Traceback" not in err


def test_gains_are_above_zero_in_a_file(tmp_path):
    """Refuse a gain that is no gain, with its place in the file."""
    path = tmp_path / FILE
    written(path)
    data = yaml.safe_load(path.read_text())
    data["joints"]["J0"]["gains"]["kp_nm_rad"]["mean"] = -1.0
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(LogError, match="joints.J0.gains.Gains.kp_nm_rad.mean"):
        read_calibration(path)


def csv_log(folder, mechanism: dict, rows: list[str]):
    """A user's log: eight lines of YAML and a CSV."""
    folder.mkdir()
    (folder / "log.yaml").write_text(
        yaml.safe_dump({"schema": 1, "source": "robot", "mechanism": mechanism})
    )
    (folder / "samples.csv").write_text("\n".join(rows) + "\n")
    return folder


HEADER = "t_s,command_rad.J0,position_rad.J0"
STILL = [f"{0.005 * k:.3f},0.0,0.0" for k in range(300)]
TRX = {"hand": "trx"}
SLIDE = """<mujoco><worldbody><body><inertial mass="1" pos="0 0 0" diaginertia="1e-3 1e-3 1e-3"/>
<joint name="J0" type="slide" axis="1 0 0" armature="0.5"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("mechanism", "rows", "words"),
    [
        (
            TRX,
            [HEADER, *STILL],
            "no commands for J1, J3, J4, J6, J7; it has: J0",
        ),
        (TRX, [HEADER, *STILL[:5]], "needed: at least 20"),
        (TRX, [HEADER, *STILL[:100], "0.500,0.0,oops", *STILL[101:]], "is 'oops' in sample 100"),
        (TRX, [HEADER, *STILL[:100], *STILL[200:]], "hole of"),
        ({"hand": "trix"}, [HEADER, *STILL], "Did you mean 'trx'?"),
        ({"hand": "trx", "stick": "wood"}, [HEADER, *STILL], "no stick named 'wood'"),
        ({"hand": "trx", "effects": "backlsh=1deg"}, [HEADER, *STILL], "Did you mean 'backlash'?"),
        (
            {"mjcf": "arm.xml", "joints": {"J0": {"kp": 1.0, "kd": 0.1}}},
            [HEADER.replace("_rad", "_m"), *STILL],
            "not a hinge: J0; mujoco simulates hinges only",
        ),
    ],
)
def test_bad_logs_give_one_message_and_exit_code_2(tmp_path, mechanism, rows, words, capfd):
    """Refuse a log that cannot be used and say what is wrong with it."""
    folder = csv_log(tmp_path / "log", mechanism, rows)
    (folder / "arm.xml").write_text(SLIDE)
    assert cli.call(["calibrate", str(folder), "--out", str(tmp_path / "out")]) == 2
    out, err = capfd.readouterr()
    assert words in err
    assert "Traceback" not in err and out == ""
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("kinds", "factor", "words"),
    [
        (("command_rad", "position_rad"), 180 / np.pi, "both are in degrees"),
        (("push_nm",), 1e3, "its drive gives 1.2 Nm at most: they are in Nmm"),
    ],
)
def test_other_units_are_refused(pushed, tmp_path, kinds, factor, words, capfd):
    """Refuse angles and pushes that are beyond what the mechanism can be."""
    samples = pushed.samples.copy()
    for column in [c for c in samples.columns if c.split(".")[0] in kinds]:
        samples[column] *= factor
    write_log(dataclasses.replace(pushed, samples=samples), tmp_path / "log")
    assert cli.call(["calibrate", str(tmp_path / "log"), "--out", str(tmp_path / "out")]) == 2
    out, err = capfd.readouterr()
    assert words in err and "Traceback" not in err and out == ""


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["absent"], "no log folder at absent"),
        (["LOG", "--nominal", "bulet"], "Did you mean 'bullet'?"),
        (["LOG", "--known-effects", "backlash=1"], "has no unit"),
        (["LOG", "--threshold", "3"], "a number with its unit"),
        (["LOG", "--threshold", "nanmm"], "--threshold is nan mm"),
        (["LOG", "--seed", "-1"], "--seed is '-1'"),
        (["LOG", "--out", "TAKEN"], "choose another --out, or --force"),
    ],
)
def test_bad_options_give_one_message_and_exit_code_2(tmp_path, options, words, capfd):
    """Refuse what cannot be before anything is simulated."""
    header = ",".join(["t_s", *(f"command_rad.{j},position_rad.{j}" for j in GAINS)])
    rows = [f"{0.005 * k:.3f}" + ",0.0" * 12 for k in range(30)]
    places = {"LOG": str(csv_log(tmp_path / "log", TRX, [header, *rows])), "TAKEN": str(tmp_path)}
    written(tmp_path / FILE)
    assert cli.call(["calibrate", *(places.get(o, o) for o in options)]) == 2
    out, err = capfd.readouterr()
    assert words in err
    assert "Traceback" not in err and out == ""


def test_a_log_at_rest_gives_reasons_and_no_numbers(tmp_path, capfd):
    """Calibrate nothing from a log in which nothing moves, say why, and keep the nominal world."""
    header = ",".join(["t_s", *(f"command_rad.{j},position_rad.{j}" for j in GAINS)])
    rows = [f"{0.005 * k:.3f}" + ",0.0" * 12 for k in range(500)]
    folder = csv_log(tmp_path / "log", {**TRX, "effects": "built"}, [header, *rows])
    out = tmp_path / "out"
    assert cli.call(["calibrate", str(folder), "--out", str(out), "--json"]) == 0
    result = json.loads(capfd.readouterr().out)
    for joint in result["joints"].values():
        assert joint["gains"].startswith("not identifiable from this log: it moves by 0 deg")
        assert joint["backlash"] == backlash.NO_PUSH
    assert world(result["effects"]).digest == world("built").digest
    assert read_calibration(out / FILE).tactile == tactile.NO_READINGS
    assert sorted(p.name for p in out.glob("*.png")) == [f"{j}.png" for j in sorted(GAINS)]


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["bullet", "sapien"])
def test_a_robot_without_motor_encoders_is_calibrated(tmp_path, backend, capfd):
    """Recover another engine's gains and play from its links' angles alone."""
    log = without_motor(take(backend, HIDDEN, "steps", "triangle", "multisine", "push"))
    write_log(log, tmp_path / "log")
    arguments = ["calibrate", str(tmp_path / "log"), "--out", str(tmp_path / "out"), "--json"]
    assert cli.call(arguments) == 0
    result = json.loads(capfd.readouterr().out)
    for joint, found in result["joints"].items():
        assert found["backlash"]["half_deg"] == pytest.approx(PLAY_DEG[joint], abs=PLAY_ERROR_DEG)
        drive = world().drives[list(GAINS).index(joint)]
        nominal = (drive.kp_nm_rad, drive.kd_nms_rad)
        names = ("kp_nm_rad", "kd_nms_rad")
        for name, plain, scale in zip(names, nominal, GAINS[joint], strict=True):
            gain = found["gains"][name]
            assert gain["mean"] == pytest.approx(plain * scale, rel=0.05)
            assert abs(gain["mean"] - plain * scale) < 3 * gain["std"]
