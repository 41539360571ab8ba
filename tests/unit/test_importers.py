"""Importers: units, signs, settings and mechanisms, on small files made here and on real ones."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat, savemat

from benchmark.cli import app as cli
from benchmark.parts import registry
from diagnosis.logs.log import Log, LogError, read_log, write_log

ROOT = Path(__file__).resolve().parents[2]
REAL = ROOT.parent / "shared/real_logs"
COUNT = 2 * np.pi / 4096


def load(kind: str, path: Path) -> dict[str, Log]:
    return registry.load("importer", kind)().read(path)


def through_disk(log: Log, folder: Path) -> Log:
    """The log as a diagnosis gets it."""
    write_log(log, folder)
    return read_log(folder)


def emps(folder: Path) -> Path:
    """Half a second of the cascade controller moving a mass without friction."""
    t = np.arange(500) / 1000
    law = {"gtau": 35.0, "kp": 160.0, "kv": 240.0}
    path = folder / "emps.mat"
    savemat(path, {"t": t, "qg": 0.1 * t**2, "qm": 0.1 * (t - 0.01) ** 2, "vir": 2 * t, **law})
    return path


def bam(folder: Path, gain: int = 400, name: str = "a", **changes: object) -> Path:
    """A second on command and a second switched off."""
    t = np.arange(400) / 200
    entries = [
        {
            "timestamp": s,
            "goal_position": np.sin(3 * s),
            "position": 0.8 * np.sin(3 * s - 0.1),
            "speed": 2.4 * np.cos(3 * s - 0.1),
            "torque_enable": bool(s < 1),
        }
        for s in t
    ]
    settings = {"kp": gain, "mass": 0.5, "length": 0.1, "vin": 7.4, "trajectory": "swing"}
    path = folder / f"{name}.json"
    path.write_text(json.dumps({**settings, "entries": entries, **changes}))
    return path


def play_test(folder: Path, tested: tuple[str, str] = ("1", "2")) -> Path:
    """Two coupled servos, the second facing the first; one puller pulls, then the other."""
    rows = 60
    below, above = np.zeros(rows), np.zeros(rows)
    below[20:30], above[40:50] = 1.0, 0.5
    turn = np.r_[-100 * np.ones(5), np.zeros(rows - 5)]
    stamps = pd.Timestamp("2025-11-12T09:53:06.000Z") + pd.to_timedelta(0.1 * np.arange(rows), "s")
    table = {"timestamp": [s.isoformat().replace("+00:00", "Z") for s in stamps]}
    for servo, facing in zip(tested, (1, -1), strict=True):
        table[f"target pos ({servo})"] = 2047 + facing * turn
        table[f"pos ({servo})"] = 2047 + facing * (0.9 * turn + 5 * above)
    pullers = [servo for servo in "1234" if servo not in tested]
    ways = ((1747, 400, below), (2347, -400, above))
    for servo, (rest, way, share) in zip(pullers, ways, strict=True):
        table[f"target pos ({servo})"] = rest + way * (share > 0)
        table[f"pos ({servo})"] = rest + way * share
    table = pd.DataFrame(table)
    table.loc[0, [c for c in table if c.startswith("pos")]] = np.nan
    path = folder / "test.csv"
    table.to_csv(path, index=False)
    return path


def test_emps_controller_becomes_a_pd_law(tmp_path):
    """Turn gains and voltage of the cascade into N/m, Ns/m and N."""
    (log,) = load("emps", emps(tmp_path)).values()
    log = through_disk(log, tmp_path / "log")
    drive = log.meta.mechanism.joints["axis"]
    assert log.is_linear("axis") and drive.sensor == "motor"
    assert drive.kp == pytest.approx(35 * 240 * 160)
    assert drive.kd == pytest.approx(35 * 240)
    assert drive.limit == pytest.approx(350)
    assert np.allclose(log.signal("torque", 0)[:, 0], 35 * 2 * np.arange(500) / 1000)


def test_bam_logs_are_grouped_by_gain(tmp_path):
    """Make one log per gain, with motions on command alone, and gains that grow with it."""
    for gain, name in ((400, "a"), (400, "b"), (800, "c")):
        bam(tmp_path, gain, name)
    logs = load("bam", tmp_path)
    assert list(logs) == ["kp400", "kp800"]
    log = through_disk(logs["kp400"], tmp_path / "log")
    assert [e.note for e in log.episodes] == ["swing", "swing"]
    assert len(log.episode(0)) == 200
    kp = [one.meta.mechanism.joints["servo"].kp for one in logs.values()]
    assert kp[1] == pytest.approx(2 * kp[0])
    drives = {one.meta.mechanism.joints["servo"].limit for one in logs.values()}
    assert len(drives) == 1


def test_bam_pendulum_hangs_down(tmp_path):
    """Pull the pendulum back to zero with m g l sin q."""
    (log,) = load("bam", bam(tmp_path)).values()
    model = mujoco.MjModel.from_xml_string(log.mjcf_xml)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.7
    mujoco.mj_forward(model, data)
    weight_nm = 0.5 * -model.opt.gravity[2] * 0.1
    assert data.qfrc_bias[0] == pytest.approx(weight_nm * np.sin(0.7))


def test_play_test_pushes_both_servos_alike(tmp_path):
    """Share the pull, turn it round for the servo that faces the other way, scale with the band."""
    (log,) = load("play-test", play_test(tmp_path)).values()
    log = through_disk(log, tmp_path / "log")
    assert log.joints == ("servo1", "servo2")
    push, position = log.signal("push", 0), log.signal("position", 0)
    assert np.allclose(push[:, 0], -push[:, 1])
    full_nm = 0.3 * 9.80665 * 0.1
    assert push[19:29, 0] == pytest.approx(-full_nm / 2)
    assert push[39:49, 0] == pytest.approx(full_nm / 4)
    assert not push[:19].any() and not push[49:].any()
    assert position[45] == pytest.approx([2.5 * COUNT, -2.5 * COUNT])
    assert log.dt_s(0) == pytest.approx(0.1)


def test_any_servo_may_pull(tmp_path):
    """Know the servos that pull by where they rest, and leave out one that never answered."""
    table = pd.read_csv(play_test(tmp_path, tested=("3", "4")))
    table["target pos (5)"], table["pos (5)"] = np.nan, np.nan
    table.to_csv(tmp_path / "test.csv", index=False)
    (log,) = load("play-test", tmp_path).values()
    assert log.joints == ("servo3", "servo4")
    assert log.signal("push", 0)[19:29, 0] == pytest.approx(-0.3 * 9.80665 * 0.1 / 2)


@pytest.mark.parametrize(("kind", "make"), [("emps", emps), ("bam", bam), ("play-test", play_test)])
def test_mechanisms_compile_and_name_their_joints(tmp_path, kind, make):
    """Give a model that an engine takes, with the logged joints and one drive each."""
    (log,) = load(kind, make(tmp_path)).values()
    model = mujoco.MjModel.from_xml_string(log.mjcf_xml)
    names = tuple(model.joint(j).name for j in range(model.njnt))
    assert names == log.joints == tuple(log.meta.mechanism.joints)
    slides = model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    assert [log.is_linear(name) for name in names] == slides.tolist()


@pytest.mark.parametrize(
    ("kind", "name", "text", "words"),
    [
        ("emps", "a.mat", "nonsense", "cannot be read as a MATLAB file"),
        ("bam", "a.json", "{", "cannot be read as JSON"),
        ("bam", "a.json", "[]", "holds no JSON object"),
        ("bam", "a.json", "{}", "has no kp, mass, length, vin, trajectory, entries"),
        ("play-test", "a.csv", "timestamp\n2025-11-12\n", "has no column"),
        ("play-test", "a.csv", "", "is empty"),
        ("play-test", "b.txt", "", "no recording at"),
    ],
)
def test_other_files_are_refused(tmp_path, kind, name, text, words):
    """Say that a file is no recording of this kind."""
    (tmp_path / name).write_text(text)
    with pytest.raises(LogError, match=words):
        load(kind, tmp_path)


def test_a_file_that_ends_its_reader_is_refused(tmp_path):
    """Survive a damaged array of which SciPy's reader dies, and name the file."""
    path = emps(tmp_path)
    data = bytearray(path.read_bytes())
    data[data.index(b"vir") - 27] = 255  # flags of the array
    path.write_bytes(data)
    with pytest.raises(LogError, match="cannot be read as a MATLAB file: it ends its reader"):
        load("emps", tmp_path)


def test_gains_that_no_drive_has_are_refused(tmp_path):
    """Name the number of a recording that cannot be."""
    data = {name: np.arange(500.0) / 1000 for name in ("t", "qg", "qm", "vir")}
    savemat(tmp_path / "emps.mat", {**data, "gtau": 35.0, "kp": -160.0, "kv": 240.0})
    with pytest.raises(LogError, match="position_gain: input should be greater than"):
        load("emps", tmp_path)


def test_garbled_entries_are_refused(tmp_path):
    """Refuse entries without their fields, and gains recorded on different pendulums."""
    with pytest.raises(LogError, match="lack 'torque_enable', or it is invalid"):
        load("bam", bam(tmp_path, entries=[{"timestamp": 0.0}]))
    bam(tmp_path, name="a")
    bam(tmp_path, name="b", mass=1.0)
    with pytest.raises(LogError, match="differ in 'mass'"):
        load("bam", tmp_path)


def test_what_is_not_used_is_said(tmp_path):
    """Name the columns of a recording that its log does not use, and none where all are."""
    other = bam(tmp_path)
    data = json.loads(other.read_text())
    entries = [entry | {"temp": 30} for entry in data["entries"]]
    other.write_text(json.dumps(data | {"entries": entries}))
    held = {k: v for k, v in loadmat(emps(tmp_path)).items() if not k.startswith("_")}
    savemat(tmp_path / "more.mat", held | {"heat": 1.0})
    found = {
        path.name: [log.said for log in load(kind, path).values()]
        for kind, path in (
            ("bam", other),
            ("emps", tmp_path / "emps.mat"),
            ("emps", tmp_path / "more.mat"),
        )
    }
    assert found == {
        "a.json": [("not used: temp",)],
        "emps.mat": [()],
        "more.mat": [("not used: heat",)],
    }


@pytest.mark.parametrize(
    ("kind", "folder", "logs", "samples"),
    [
        ("emps", "emps", 1, 24841),
        ("bam", "bam_xl330", 4, 14910),
        ("play-test", "robonine", 5, 1665),
    ],
)
def test_real_recordings_come_in_clean(tmp_path, capfd, kind, folder, logs, samples):
    """Import what was recorded on hardware, without a warning."""
    path = REAL / folder
    if not path.is_dir():
        pytest.skip(f"no real recordings at {path}")
    out = tmp_path / "log"
    assert cli.call(["import", kind, str(path), "--out", str(out), "--json"]) == 0
    written = json.loads(capfd.readouterr().out)["written"]
    assert len(written) == logs
    assert sum(row["samples"] for row in written) == samples
    assert all(read_log(Path(row["dir"])).warnings == () for row in written)


def test_emps_without_friction_is_off_by_its_friction():
    """Explain what the frictionless axis misses by the authors' friction, held against kp."""
    path = REAL / "emps"
    if not path.is_dir():
        pytest.skip(f"no real recordings at {path}")
    (log,) = load("emps", path).values()
    drive, model = log.meta.mechanism.joints["axis"], mujoco.MjModel.from_xml_string(log.mjcf_xml)
    missed_m = _missed(log, model, friction=False)
    left_m = _missed(log, model, friction=True)
    fastest_m_s = np.abs(np.diff(log.signal("command", 0)[:, 0])).max() / log.dt_s(0)
    largest_m = (20.3935 + 203.5034 * fastest_m_s) / drive.kp
    assert 0.3 * largest_m < missed_m < largest_m
    assert left_m < 0.2 * missed_m


def _missed(log: Log, model: mujoco.MjModel, friction: bool) -> float:
    """Root mean square of position error when the axis is simulated at the log's rate [m]."""
    drive, mass = log.meta.mechanism.joints["axis"], model.body_mass[1] + model.dof_armature[0]
    command, position = (
        log.signal("command", 0)[:, 0],
        log.signal("position", 0)[:, 0],
    )
    q, speed, dt, missed = position[0], 0.0, 1e-3, []
    for target, measured in zip(command, position, strict=True):
        missed.append(q - measured)
        force = np.clip(drive.kp * (target - q) - drive.kd * speed, -drive.limit, drive.limit)
        if friction:
            force -= 203.5034 * speed + 20.3935 * np.sign(speed)
        speed += dt * force / mass
        q += dt * speed
    return float(np.sqrt(np.mean(np.square(missed))))


EXCITE = ["excite", "--joints", "a,b"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([*EXCITE], "--joints needs --range"),
        ([*EXCITE, "--range=60:-60deg"], "the lower end first"),
        ([*EXCITE, "--range=-60:60"], "LOW:HIGH with rad"),
        ([*EXCITE, "--range=nan:60deg"], "LOW:HIGH with rad"),
        ([*EXCITE, "--range=0:1m,0:1rad"], "mixes angles and lengths"),
        ([*EXCITE, "--range=0:1m,0:1m,0:1m"], "3 entries for 2 joints"),
        ([*EXCITE, "--range=0:1m", "--protocol", "push"], "needs --limit"),
        ([*EXCITE, "--range=0:1m", "--limit", "-1N"], "--limit is '-1N'"),
        ([*EXCITE, "--range=0:1m", "--protocol", "grasp"], "some of steps, triangle"),
        ([*EXCITE, "--range=0:1m", "--rate", "5Hz"], "--rate is 5 Hz; allowed: 20 to 1000"),
        (["excite", "--joints", "a,a", "--range=0:1m"], "different names"),
        (["excite", "--range=0:1m"], "need --joints"),
        (["import", "emp", "x"], "Did you mean 'emps'?"),
        (["import", "emps", "absent"], "no recording at absent"),
    ],
)
def test_bad_usage_exits_2_and_writes_nothing(tmp_path, capfd, arguments, words):
    """Refuse with one message and no traceback."""
    out = tmp_path / ("commands.csv" if arguments[0] == "excite" else "log")
    assert cli.call([*arguments, "--out", str(out)]) == 2
    said = capfd.readouterr()
    assert words in said.err and "Traceback" not in said.err
    assert said.out == "" and not list(tmp_path.iterdir())


def test_excite_writes_what_a_log_can_be_made_of(tmp_path, capfd):
    """Write commands in the log's own column names: with positions beside them they are a log."""
    out = tmp_path / "commands.csv"
    asked = [*EXCITE, "--range=-60:60deg", "--limit", "3Nm", "--out", str(out), "--json"]
    assert cli.call(asked) == 0
    result = json.loads(capfd.readouterr().out)
    table = pd.read_csv(out)
    assert result["episodes"] == ["steps", "triangle", "multisine", "push"]
    assert list(table.columns[:4]) == ["episode", "protocol", "t_s", "command_rad.a"]
    assert table[["command_rad.a", "command_rad.b"]].abs().max().max() <= np.pi / 3
    folder = tmp_path / "log"
    folder.mkdir()
    (folder / "log.yaml").write_text("schema: 1\nsource: a robot\nmechanism: {hand: mine}\n")
    for joint in "ab":
        table[f"position_rad.{joint}"] = table[f"command_rad.{joint}"]
    table.drop(columns="protocol").to_csv(folder / "samples.csv", index=False)
    assert read_log(folder).joints == ("a", "b")


def test_excite_replaces_no_file(tmp_path, capfd):
    """Leave what is there as it is: it may be a log."""
    out = tmp_path / "samples.csv"
    out.write_text("mine")
    assert cli.call([*EXCITE, "--range=0:1m", "--protocol", "steps", "--out", str(out)]) == 2
    assert "samples.csv exists; choose another --out" in capfd.readouterr().err
    assert out.read_text() == "mine"


def test_excite_moves_linear_joints_one_at_a_time(tmp_path):
    """Name metres and newtons, and give every joint its own episode."""
    out = tmp_path / "commands.csv"
    asked = [*EXCITE, "--range=0:20mm,-5:5mm", "--limit", "9N", "--one-at-a-time"]
    assert cli.call([*asked, "--protocol", "push", "--out", str(out)]) == 0
    table = pd.read_csv(out)
    for moved, held, number in (("a", "b", 0), ("b", "a", 1)):
        part = table[table["episode"] == number]
        assert np.ptp(part[f"command_m.{held}"]) == 0 == np.ptp(part[f"push_n.{held}"])
        assert np.ptp(part[f"command_m.{moved}"]) > 0 < np.ptp(part[f"push_n.{moved}"])
