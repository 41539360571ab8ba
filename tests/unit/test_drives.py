"""Drives as robots have them: each law of a drive is replayed as it is, said, or refused."""

import json
from collections.abc import Callable

import mujoco
import numpy as np
import pandas as pd
import pytest

from backends.mjcf import file_drives
from benchmark.cli import app as cli
from diagnosis.evidence.evidence import evidence
from diagnosis.logs.log import DriveSettings, Log, LogError, LogMeta, make_log
from diagnosis.logs.servos import servo, table
from diagnosis.logs.two_files import Asked, pair
from diagnosis.motion.columns import DELAY
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.plain_gap import plain_gap
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.replay.plain import model_text, plain_apart
from diagnosis.replay.robot import uncertainties
from diagnosis.triage.triage import FaultError, triage
from diagnosis.walk import diagnose

ARM = """<mujoco><option integrator="implicitfast"/><worldbody><body>
<inertial mass="0.8" pos="0.15 0 0" diaginertia="8e-4 4e-3 4e-3"/>
<joint name="a" axis="0 1 0" range="-90 90" armature="0.02" damping="0.05"/></body></worldbody>
</mujoco>"""
KP, KD, LIMIT, DT = 40.0, 1.2, 8.0, 1e-4
TIME_S = np.arange(0, 4, 0.005)
STEPS = np.array([0.0, 0.4, 0.4, -0.3, 0.1])[(TIME_S / 0.8).astype(int)]
SINE, RATE = 0.4 * np.sin(3 * TIME_S), 1.2 * np.cos(3 * TIME_S)
Law = Callable[[dict, float, float, int], float]
"""A torque from what it keeps, position, speed and the number of the sample."""


def pid(state: dict, q: float, v: float, k: int) -> float:
    """A law with an integral that holds 2 Nm at most."""
    state["sum"] = np.clip(state.get("sum", 0.0) + 60 * (STEPS[k] - q) * DT, -2, 2)
    return np.clip(KP * (STEPS[k] - q) - KD * v + state["sum"], -LIMIT, LIMIT)


def cascaded(state: dict, q: float, v: float, k: int) -> float:
    """P on the position, PI on the speed with a reset time of 1/8 s; the integral holds 2 Nm."""
    asked = KD * (KP / KD * (STEPS[k] - q) - v)
    state["sum"] = np.clip(state.get("sum", 0.0) + 8.0 * asked * DT, -2, 2)
    return np.clip(asked + state["sum"], -LIMIT, LIMIT)


def filtered(state: dict, q: float, v: float, k: int) -> float:
    """A law that sees the speed through a filter of 10 ms."""
    state["v"] = state.get("v", 0.0) + DT / 0.01 * (v - state.get("v", 0.0))
    return np.clip(KP * (STEPS[k] - q) - KD * state["v"], -LIMIT, LIMIT)


def on_error(_: dict, q: float, v: float, k: int) -> float:
    """A law on the errors of position and speed."""
    return np.clip(KP * (SINE[k] - q) + KD * (RATE[k] - v), -LIMIT, LIMIT)


def fed(_: dict, q: float, v: float, k: int) -> float:
    """A law with a torque beside it."""
    return np.clip(KP * (SINE[k] - q) - KD * v - 1.0 * np.cos(SINE[k]), -LIMIT, LIMIT)


def braked(_: dict, q: float, v: float, k: int) -> float:
    """A voltage that ends at 3 Nm, and the back-EMF beyond it."""
    return np.clip(KP * (STEPS[k] - q) - 0.2 * v, -3, 3) - 0.7 * v


def lagging(state: dict, q: float, v: float, k: int) -> float:
    """A current that follows within 5 ms."""
    wanted = np.clip(KP * (STEPS[k] - q) - KD * v, -LIMIT, LIMIT)
    state["i"] = state.get("i", wanted) + DT / 0.005 * (wanted - state.get("i", wanted))
    return state["i"]


def slow(state: dict, q: float, v: float, k: int) -> float:
    """A loop of 100 Hz, whose torque holds for 10 ms, and the back-EMF beside it."""
    state["tick"] = state.get("tick", -1) + 1
    if state["tick"] % 100 == 0:
        state["asked"] = np.clip(KP * (STEPS[k] - q) - 0.5 * v, -LIMIT, LIMIT)
    return state["asked"] - 0.7 * v


def profiled(state: dict, q: float, v: float, k: int) -> float:
    """A target that moves to each command by a trapezoid of 10 rad/s^2 and 1 rad/s."""
    at, rate = state.get("p", (STEPS[0], 0.0))
    away = STEPS[k] - at
    wanted = np.sign(away) * min(1.0, np.sqrt(2 * 10 * abs(away)))
    rate += np.clip(wanted - rate, -10 * DT, 10 * DT)
    state["p"] = (at + rate * DT, rate) if abs(away) > 1e-5 else (STEPS[k], 0.0)
    return np.clip(KP * (state["p"][0] - q) - KD * v, -LIMIT, LIMIT)


def moved(law: Law, xml: str = ARM) -> np.ndarray:
    """Positions (T,) of the arm under a law, from rest, in plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = DT
    data, state, shown = mujoco.MjData(model), dict[str, float](), []
    for tick in range(-10_000, round(TIME_S[-1] / DT) + 1):
        now = max(tick, 0)
        if tick >= 0 and tick % 50 == 0:
            shown.append(data.qpos[0])
        data.qfrc_applied[0] = law(state, data.qpos[0], data.qvel[0], now // 50)
        mujoco.mj_step(model, data)
    return np.array(shown)


def log_of(position: np.ndarray, command: np.ndarray, drive: dict, **more: np.ndarray) -> Log:
    """A log of one episode."""
    samples = pd.DataFrame({"t_s": TIME_S, "command_rad.a": command, "position_rad.a": position})
    mechanism = {"mjcf": "arm.xml", "joints": {"a": {"kp": KP, "kd": KD, "limit": LIMIT} | drive}}
    meta = LogMeta.model_validate({"schema": 1, "source": "test", "mechanism": mechanism})
    return make_log(meta, samples.assign(**{f"{name}.a": x for name, x in more.items()}), ARM)


def gap(log: Log) -> float:
    """How far the log is from its own model in plain MuJoCo [rad]."""
    world = mjcf_world(log)
    every = (Limb(spec=p, recordings=recordings(log, p), rigid=True) for p in limbs(world))
    return plain_gap(log, world, world, [evidence(e) for e in every]).after_rad


def off(log: Log) -> float:
    """Root mean square distance of the nominal replay from a log [rad]."""
    spec = mjcf_world(log)
    limb = Limb(spec=spec, recordings=recordings(log, spec), rigid=True)
    gap = limb.simulate(limb.nominal)[:, 0] - limb.measured[:, 0]
    return float(np.sqrt(np.mean(gap**2)))


@pytest.mark.parametrize(
    ("law", "command", "drive", "more"),
    [
        (pid, STEPS, {"ki": 60, "integral_limit": 2}, {}),
        (
            cascaded,
            STEPS,
            {"position_gain": KP / KD, "kd": KD, "speed_integral": 8, "integral_limit": 2},
            {},
        ),
        (filtered, STEPS, {"filter": 0.01}, {}),
        (on_error, SINE, {}, {"reference_rad_s": RATE}),
        (on_error, SINE, {"lead": 1}, {}),
        (fed, SINE, {}, {"feedforward_nm": -1.0 * np.cos(SINE)}),
        (braked, STEPS, {"kd": 0.2, "back_emf": 0.7, "limit": 3}, {}),
        (lagging, STEPS, {"lag": 0.005}, {}),
        (profiled, STEPS, {"acceleration": 10, "speed": 1}, {}),
        (slow, STEPS, {"kd": 0.5, "back_emf": 0.7, "rate": 100}, {}),
    ],
    ids=[
        "pid",
        "cascade",
        "filter",
        "reference",
        "lead",
        "feedforward",
        "back-emf",
        "lag",
        "profile",
        "rate",
    ],
)
def test_a_law_is_replayed_as_it_is(law, command, drive, more):
    """Replay each law as closely as ticks of 1 ms allow, and five times worse as a PD law."""
    position = moved(law)
    close = off(log_of(position, command, drive, **more))
    plain = {k: v for k, v in drive.items() if k in ("kp", "limit")}
    far = off(log_of(position, command, plain | ({"kd": 0.9} if law is braked else {})))
    assert close < 1e-3
    assert far > 5 * close


@pytest.mark.parametrize("text", ["60 +- 20%", "60 +- 12", "60±20 %", "60+-20%"])
def test_a_number_says_how_sure_it_is(text):
    """Read a gain with its standard deviation, and let it move by that much."""
    log = log_of(0.9 * STEPS, STEPS, {"kp": text})
    assert mjcf_world(log).drives[0].kp_nm_rad == 60
    assert uncertainties(log)["a", "drive.kp_nm_rad"] == pytest.approx(0.2)
    again = LogMeta.model_validate(log.meta.model_dump(by_alias=True, exclude_defaults=True))
    assert again.mechanism == log.meta.mechanism


@pytest.mark.parametrize("text", ["60 +- x", "0 +- 20", "60 +- -1%", "about 60"])
def test_a_number_that_is_none_is_refused(text):
    """Name the number that cannot be read."""
    with pytest.raises(ValueError, match="kp"):
        DriveSettings(kp=text)


@pytest.mark.parametrize("name", table())
def test_a_servo_is_known(name):
    """Give each servo a gain, a limit and a brake that stop it at a plausible speed."""
    one = servo(name)
    half = servo(f"{name},gain:{0.5 * table()[name]['gain']}")
    assert half.kp == pytest.approx(0.5 * one.kp) and half.limit == one.limit
    assert 2 < one.limit / one.back_emf < 25
    assert 0.01 < one.limit / one.kp < 1
    assert one.uncertainty["kp"] >= 0.1 and table()[name]["source"]


def test_servos_stand_in_for_drives(tmp_path, capfd):
    """Take a servo for all joints, and a number that is said beside it; refuse what is unknown."""
    pd.DataFrame({"t_s": TIME_S, "a_cmd": STEPS, "a_pos": 0.9 * STEPS}).to_csv(tmp_path / "r.csv")
    (tmp_path / "arm.xml").write_text(ARM)
    words = ["check", "--robot", str(tmp_path / "arm.xml"), "--log", str(tmp_path / "r.csv")]
    words += ["--servo", "sts3215,gain:16@*"]
    said = ["--drive", "a=limit:2", "--out", str(tmp_path / "out"), "--json"]
    assert cli.call([*words, *said]) in (0, 1)
    lines = [x for x in json.loads(capfd.readouterr().out)["understood"] if "PD law" in x]
    assert "kp 9.257" in lines[0] and "limit 2 Nm" in lines[0] and "back_emf 0.551" in lines[0]
    for servo_, answer in (("sts@*", "no servo 'sts'"), ("sts3215", "NAME@JOINT")):
        assert cli.call([*words[:-1], servo_, "--out", str(tmp_path / "two")]) == 2
        assert answer in capfd.readouterr().err


def driven(gain: float = 1.0, late: int = 0) -> pd.DataFrame:
    """The arm under a torque that a loop outside of its log makes, held for a sample."""
    sent = list[float]()

    def law(_: dict, q: float, v: float, k: int) -> float:
        if k in (0, len(sent)):
            sent[k:] = [30 * (SINE[k] - q) + 1.5 * (RATE[k] - v)]
        return gain * sent[max(k - late, 0)]

    return pd.DataFrame({"time": TIME_S, "a_pos": moved(law), "torque": sent})


@pytest.mark.parametrize(
    ("name", "size", "drives"),
    [
        ("a torque cmd [Nm]", 1.0, {}),
        ("tau_des.a [mNm]", 1e3, {}),
        ("a_current_cmd [mA]", 1e3 / 0.12, {"a": DriveSettings(kp=0.12)}),
    ],
)
def test_torque_alone_is_replayed(tmp_path, name, size, drives):
    """Replay a torque that is all that is commanded, in each unit, as plain MuJoCo moves."""
    frame = driven()
    frame[name] = size * frame.pop("torque")
    frame.to_csv(tmp_path / "r.csv", index=False)
    (tmp_path / "arm.xml").write_text(ARM)
    log = pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked(drives=drives))
    assert mjcf_world(log).hand.driven[0].joint.loop.open and off(log) < 1e-3
    assert plain_apart(log, mjcf_world(log)) < 1e-3
    assert gap(log) < 1e-3


def test_a_current_needs_its_constant(tmp_path):
    """Ask for the torque of an A where a current is all that is commanded."""
    frame = driven().rename(columns={"torque": "current_ref.a"})
    frame.to_csv(tmp_path / "r.csv", index=False)
    (tmp_path / "arm.xml").write_text(ARM)
    with pytest.raises(LogError, match="no torque yet: .*--drive 'a=kp:0.12'"):
        pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked())


@pytest.mark.parametrize(
    ("gain", "late", "named", "size"), [(0.7, 0, "kp-scale", -30), (1, 4, "command-delay", 20)]
)
def test_a_fault_under_torque_is_found(tmp_path, gain, late, named, size):
    """Find weak torque and late torque where torque is all that is commanded, and mend both."""
    frame = driven(gain, late).rename(columns={"torque": "a_torque_cmd"})
    frame["a_pos"] += 3e-4 * np.random.default_rng(0).normal(size=len(frame))
    frame.to_csv(tmp_path / "r.csv", index=False)
    (tmp_path / "arm.xml").write_text(ARM)
    found = diagnose(pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked()))
    assert found.verdict == (named,)
    assert found.magnitudes[0].value == pytest.approx(size, rel=0.25)
    assert found.engine_gaps_rad[1] < 0.5 * found.engine_gaps_rad[0]


def test_torques_of_the_wrong_sign_are_named(tmp_path):
    """Say that torques, or their unit, are wrong before any cause."""
    frame = driven().rename(columns={"torque": "a_torque_cmd"})
    (tmp_path / "arm.xml").write_text(ARM)
    for size, said in ((-1.0, "sign of a: "), (1e-3, "unit of a: ")):
        frame.assign(a_torque_cmd=size * frame["a_torque_cmd"]).to_csv(tmp_path / "r.csv")
        log = pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked())
        with pytest.raises(FaultError, match=f"{said}the joint moves as if its torques were"):
            triage(log, mjcf_world(log))


def test_speed_alone_is_replayed(tmp_path):
    """Replay a drive whose only command is a speed."""
    asked = 3.0 * SINE
    position = moved(lambda _, q, v, k: np.clip(4.0 * (asked[k] - v), -LIMIT, LIMIT))
    frame = pd.DataFrame({"time": TIME_S, "a_pos": position, "a.velocity_command": asked})
    frame.to_csv(tmp_path / "r.csv", index=False)
    (tmp_path / "arm.xml").write_text(ARM)
    drives = {"a": DriveSettings(kd=4.0, limit=LIMIT)}
    log = pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked(drives=drives))
    assert off(log) < 1e-3 and gap(log) < 1e-3


def test_a_joint_without_ends_stands_at_none(tmp_path):
    """Judge all of a log of a joint that turns on and on, as its file lets it."""
    endless, asked = ARM.replace('range="-90 90"', ""), np.full(len(TIME_S), 0.9)
    position = moved(lambda _, q, v, k: np.clip(4.0 * (asked[k] - v), -LIMIT, LIMIT), endless)
    frame = pd.DataFrame({"time": TIME_S, "a_pos": position, "a.velocity_command": asked})
    frame.to_csv(tmp_path / "r.csv", index=False)
    (tmp_path / "arm.xml").write_text(endless)
    drives = {"a": DriveSettings(kd=4.0, limit=LIMIT)}
    log = pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked(drives=drives, unit="rad"))
    assert position.max() > np.pi and not triage(log, mjcf_world(log))
    assert not any("end of its range" in note for note in diagnose(log).notes)


def test_a_torque_beside_a_spring_is_no_noise():
    """Keep a torque that follows its drive's law, though the model's has nothing to do with it."""
    held = 10.0

    def law(_, q, v, k):
        return np.clip(KP * (SINE[k] - q) - KD * v, -LIMIT, LIMIT) - held * (q - 0.3)

    position = moved(law)
    speed = np.gradient(position, TIME_S)
    log = log_of(position, SINE, {}, torque_nm=KP * (SINE - position) - KD * speed)
    assert not any("left out" in note for note in diagnose(log).notes)


def test_a_load_on_a_drive_that_follows_a_speed_is_no_wrong_zero(tmp_path):
    """Take no drift from the model, which nothing asks back, for an offset of the positions."""
    asked = RATE - 0.8 * 9.81 * 0.15 / 2.0
    position = moved(lambda _, q, v, k: np.clip(2.0 * (asked[k] - v), -LIMIT, LIMIT))
    frame = pd.DataFrame({"time": TIME_S, "a_pos": position, "a.velocity_command": asked})
    frame.to_csv(tmp_path / "r.csv", index=False)
    light = ARM.replace('mass="0.8"', 'mass="0.1"').replace('armature="0.02"', 'armature="0.002"')
    light = light.replace("8e-4 4e-3 4e-3", "1e-4 1e-4 1e-4")
    (tmp_path / "arm.xml").write_text(light)
    drives = {"a": DriveSettings(kd=2.0, limit=LIMIT)}
    log = pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked(drives=drives))
    assert not [one for one in triage(log, mjcf_world(log)) if one.kind == "zero"]


def test_columns_beside_the_target_are_read(tmp_path):
    """Read the speed of a target and a feed-forward torque; take no commanded torque for one."""
    frame = pd.DataFrame({"time": TIME_S, "a_cmd": SINE, "a_pos": SINE, "a_vel_cmd": RATE})
    frame["a_tau_ff"], frame["a_torque_cmd"] = SINE, STEPS
    frame.to_csv(tmp_path / "r.csv", index=False)
    (tmp_path / "arm.xml").write_text(ARM)
    drives = {"a": DriveSettings(kp=KP, kd=KD)}
    found = pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked(drives=drives))
    assert np.allclose(found.samples["reference_rad_s.a"], RATE)
    assert np.allclose(found.samples["feedforward_nm.a"], SINE)
    assert "not used: a_torque_cmd" in found.said
    assert mjcf_world(found).hand.driven[0].joint.loop.lead == 1


def test_an_integral_is_as_unsure_as_the_log_says():
    """Move an integral gain within its uncertainty, and say how far; it is no cause."""
    position = moved(pid)
    said = {"ki": "40 +- 30%", "integral_limit": 2}
    result = diagnose(log_of(position, STEPS, said))
    assert result.verdict == ("none",)
    (ki,) = [one for one in result.limbs[0].nominal if one.effect == "ki"]
    assert (ki.value, ki.unit) == (pytest.approx(50, abs=15), "%")


def test_a_cascade_needs_the_gain_of_its_inner_loop():
    """Ask for kd where the gain of the position loop alone is given."""
    with pytest.raises(ValueError, match="needs kd"):
        DriveSettings(position_gain=30)


def test_what_an_mjcf_cannot_hold_is_noted_in_it():
    """Write the terms of a loop beside its servo as a comment, and a model that compiles."""
    log = log_of(STEPS, STEPS, {"ki": 60, "lag": 0.005})
    text = model_text(log, mjcf_world(log))
    assert "this file has not: ki 60, lag 0.005 -->" in text
    assert file_drives(text)["a"].kp == KP


def test_an_integral_that_is_not_said_is_asked_for():
    """Leave a servo's integral unknown without an accused sensor, and say its gain; then none."""
    position = moved(pid) + 3e-4 * np.random.default_rng(0).normal(size=len(TIME_S))
    unknown = diagnose(log_of(position, STEPS, {}))
    assert unknown.verdict == ("unknown",)
    (limb,) = unknown.limbs
    assert not limb.leading and limb.law and limb.law in limb.sentences[1]
    assert "an integral" in limb.law
    ki, most = (float(x.split(": ")[1]) for x in limb.law.split("`")[1].split(", "))
    assert (ki, most) == pytest.approx((60, 2), rel=0.25)
    assert diagnose(log_of(position, STEPS, {"ki": 60, "integral_limit": 2})).verdict == ("none",)


def test_a_delay_of_next_to_nothing_is_none():
    """Read no command after the last tick where a delay is lost in rounding."""
    log = log_of(SINE, SINE, {})
    spec = mjcf_world(log)
    limb = Limb(spec=spec, recordings=recordings(log, spec), rigid=True)
    late = limb.nominal.copy()
    late[:, DELAY] = 1e-22
    assert all(map(np.array_equal, limb.ticks(late), limb.ticks(limb.nominal)))
