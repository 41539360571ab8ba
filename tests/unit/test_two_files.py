"""A robot's model and its table, as people write them, become a log, or one question."""

import json
import re
import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.cli import app as cli
from diagnosis.logs._meta import DriveSettings
from diagnosis.logs.log import LogError, read_log
from diagnosis.logs.two_files import Asked, pair
from diagnosis.replay.nominal import mjcf_world
from diagnosis.triage.triage import triage

BODY = (
    '<body name="{0}" pos="0.3 0 0"><inertial mass="0.8" pos="0.15 0 0" '
    'diaginertia="8e-4 4e-3 4e-3"/>'
    '<joint name="{0}" axis="0 1 0" range="-90 90" armature="0.02"/>'
)
NAMES = "shoulder_pan", "elbow_flex"
ARM = (
    f'<mujoco model="arm"><worldbody>{BODY.format(NAMES[0])}{BODY.format(NAMES[1])}</body></body>'
    "</worldbody><actuator>"
    + "".join(f'<position joint="{n}" kp="40" kv="1.2" forcerange="-8 8"/>' for n in NAMES)
    + "</actuator></mujoco>"
)
T = np.arange(800) / 200
COMMAND = np.stack([0.4 * np.sin(2 * T), 0.3 * np.sin(3 * T)], axis=1)
POSITION = np.stack([0.4 * np.sin(2 * (T - 0.03)), 0.3 * np.sin(3 * (T - 0.03))], axis=1)


@pytest.fixture
def robot(tmp_path):
    """The file of an arm of two joints."""
    (tmp_path / "arm.xml").write_text(ARM)
    return tmp_path / "arm.xml"


def table(command: str, position: str, time: str = "t", **more) -> pd.DataFrame:
    """The table of a motion; `{}` in a name stands for the joint, `#` for its number."""
    frame = pd.DataFrame({time: T})
    for values, name in ((COMMAND, command), (POSITION, position)):
        for k, joint in enumerate(NAMES):
            frame[name.format(joint).replace("#", str(k))] = values[:, k]
    return frame.assign(**more)


@pytest.mark.parametrize(
    ("command", "position", "time"),
    [
        ("command_rad.{}", "position_rad.{}", "t_s"),
        ("{}_cmd", "{}_pos", "time"),
        ("{}.goal_position", "{}.present_position", "timestamp"),
        ("target {}", "{}", "Time [s]"),
        ("{}", "{}_actual", "elapsed_sec"),
        ("q_des_#", "q_#", "t"),
        ("{}.qDes", "{}.qAct", "millis"),
        ("/joint_commands/position[#]", "/joint_states/position[#]", "stamp"),
    ],
)
def test_columns_are_known_from_their_names(robot, tmp_path, command, position, time):
    """Take commands, positions and times under the names that people give them."""
    frame = table(command, position, time, current_0=0.1)
    frame.to_csv(tmp_path / "run.csv", index=False)
    made = pair(robot, [tmp_path / "run.csv"], Asked())
    assert made.joints == NAMES
    assert np.allclose(made.signal("command", 0), COMMAND)
    assert np.allclose(made.signal("position", 0), POSITION)
    assert "not used: current_0" in made.said


def test_gains_in_every_row_are_those_of_the_drives(robot, tmp_path):
    """Take gains that are sent with each target; leave those that change, and say so."""
    frame = table("{}_q_des", "{}_q").assign(shoulder_pan_kp=30.0, elbow_flex_kp=50 + T)
    frame.to_csv(tmp_path / "run.csv", index=False)
    made = pair(robot, [tmp_path / "run.csv"], Asked())
    assert made.meta.mechanism.joints["shoulder_pan"].kp == 30.0
    assert "elbow_flex" not in made.meta.mechanism.joints
    assert "kp of shoulder_pan is 30, of 'shoulder_pan_kp'" in made.said
    assert "not used: 'elbow_flex_kp', which changes: a drive has one kp" in made.said


def test_drives_are_said_by_patterns_of_joints(robot, tmp_path):
    """Take a joint's own words before those of patterns; refuse a pattern that is of no joint."""
    table("{}_cmd", "{}_pos").to_csv(tmp_path / "run.csv", index=False)
    drives = {"elbow_flex": {"kp": 7.0}, "*": {"kp": 5.0, "kd": 0.5}, "should*": {"kd": 0.9}}
    said = {name: DriveSettings.model_validate(one) for name, one in drives.items()}
    joints = pair(robot, [tmp_path / "run.csv"], Asked(drives=said)).meta.mechanism.joints
    assert (joints["elbow_flex"].kp, joints["elbow_flex"].kd) == (7.0, 0.5)
    assert (joints["shoulder_pan"].kp, joints["shoulder_pan"].kd) == (5.0, 0.9)
    with pytest.raises(LogError, match="no joint of the log is 'wrist_\\*'; it has shoulder_pan"):
        pair(robot, [tmp_path / "run.csv"], Asked(drives={"wrist_*": said["*"]}))


def test_wrapped_angles_are_taken_on(tmp_path):
    """Join readings and targets of a joint without ends where they begin anew after a turn."""
    (tmp_path / "arm.xml").write_text(ARM.replace('range="-90 90"', 'limited="false"'))
    turned = table("{}_cmd", "{}_pos")
    turned.iloc[:, 1:] = 20.0 * turned.iloc[:, 1:]
    wrapped = turned.copy()
    wrapped.iloc[:, 1:] = (turned.iloc[:, 1:] + np.pi) % (2 * np.pi) - np.pi
    wrapped.to_csv(tmp_path / "run.csv", index=False)
    made = pair(tmp_path / "arm.xml", [tmp_path / "run.csv"], Asked(unit="rad"))
    assert np.allclose(made.signal("position", 0), 20.0 * POSITION)
    assert np.allclose(made.signal("command", 0), 20.0 * COMMAND)
    assert any("taken on without jumps" in text for text in made.said)


def test_a_table_names_its_protocol(robot, tmp_path):
    """Take the protocol of an episode from the table's own column."""
    table("{}_cmd", "{}_pos", protocol="steps").to_csv(tmp_path / "run.csv", index=False)
    (episode,) = pair(robot, [tmp_path / "run.csv"], Asked()).episodes
    assert episode.protocol == "steps"


def test_a_table_with_decimal_commas_degrees_and_milliseconds(robot, tmp_path):
    """Read the numbers as they are meant, and say which unit they had."""
    frame = table("{} Soll [deg]", "{} Ist [deg]", "Zeit [ms]")
    frame = pd.concat([frame[["Zeit [ms]"]] * 1000, np.degrees(frame.iloc[:, 1:])], axis=1)
    frame["elbow_flex Moment [Nm]"] = 1.5
    frame.round(6).to_csv(tmp_path / "run.csv", index=False, sep=";", decimal=",")
    made = pair(robot, [tmp_path / "run.csv"], Asked())
    assert np.allclose(made.signal("position", 0), POSITION, atol=1e-6)
    assert np.all(made.signal("torque", 0, ["elbow_flex"]) == 1.5)
    assert made.dt_s(0) == pytest.approx(5e-3)
    assert (
        made.said[0] == "run.csv: CSV between semicolons, with decimal commas, 800 rows, 6 columns"
    )
    assert "command_rad.elbow_flex is 'elbow_flex Soll [deg]' in deg" in made.said


def test_a_joint_may_be_called_as_a_unit(tmp_path):
    """Take what stands in brackets for the unit, where a joint has that name."""
    (tmp_path / "arm.xml").write_text(ARM.replace(NAMES[0], "turn"))
    frame = table("{}.target [turn]", "{}.position [turn]")
    frame.columns = [name.replace(NAMES[0], "turn") for name in frame.columns]
    frame.iloc[:, 1:] /= 2 * np.pi
    frame.to_csv(tmp_path / "run.csv", index=False)
    made = pair(tmp_path / "arm.xml", [tmp_path / "run.csv"], Asked())
    assert np.allclose(made.signal("position", 0), POSITION)


def test_degrees_without_a_word_are_known_from_the_ranges(robot, tmp_path):
    """Take degrees where only these fit the joints; ask where nothing fits."""
    frame = table("{}_cmd", "{}_pos")
    for size, name in ((180 / np.pi, "deg"), (1e3, "far")):
        many = pd.concat([frame[["t"]], size * frame.iloc[:, 1:]], axis=1)
        many.to_csv(tmp_path / f"{name}.csv", index=False)
    made = pair(robot, [tmp_path / "deg.csv"], Asked())
    assert np.allclose(made.signal("position", 0), POSITION)
    with pytest.raises(LogError, match="in which unit are they\\? Say it with --unit"):
        pair(robot, [tmp_path / "far.csv"], Asked())
    made = pair(robot, [tmp_path / "far.csv"], Asked(unit="mrad"))
    assert np.allclose(made.signal("position", 0), POSITION)


def test_a_joint_a_little_beyond_its_range_tells_no_unit(robot, tmp_path):
    """Ask for the unit, instead of taking all joints' angles for degrees."""
    frame = table("{}_cmd", "{}_pos")
    frame[f"{NAMES[0]}_pos"] *= 1.8 * float(re.search('range="\\S+ (\\S+)"', ARM)[1]) / 0.4
    frame.to_csv(tmp_path / "run.csv", index=False)
    with pytest.raises(LogError, match=f"'{NAMES[0]}_pos' reads up to"):
        pair(robot, [tmp_path / "run.csv"], Asked())
    assert pair(robot, [tmp_path / "run.csv"], Asked(unit="rad")).joints == NAMES


def test_gaps_begin_episodes_and_coarse_stamps_are_spread(robot, tmp_path):
    """Cut where the recording stopped or began anew; spread rows that share a stamp."""
    frame = table("{}_cmd", "{}_pos")
    frame["t"] = np.round(frame["t"], 2)
    frame.loc[300:, "t"] += 5.0
    frame.loc[500:, "t"] -= 6.5
    frame.to_csv(tmp_path / "run.csv", index=False)
    made = pair(robot, [tmp_path / "run.csv"], Asked())
    assert [len(made.episode(n)) for n in range(3)] == [300, 200, 300]
    assert made.dt_s(0) == pytest.approx(5e-3, rel=0.02)
    assert any("times repeat, so rows are spread" in text for text in made.warnings)


@pytest.mark.parametrize(
    ("command", "position", "said"),
    [
        (
            "{}_a",
            "{}_pos",
            "command of elbow_flex: 'elbow_flex_a' or 'elbow_flex_b'\\? Say it with",
        ),
        ("{}_pos_a", "{}_pos_b", "position of shoulder_pan: .* Say it with --column"),
        ("a#x", "b#", "no column names a joint of the model, which has shoulder_pan, elbow_flex"),
    ],
)
def test_what_cannot_be_known_is_asked_for(robot, tmp_path, command, position, said):
    """Ask in one sentence, with the option that settles it."""
    frame = table(command, position)
    frame = frame.assign(elbow_flex_b=0.0) if "_a" in command else frame[["t", "a0x"]]
    frame.to_csv(tmp_path / "run.csv", index=False)
    with pytest.raises(LogError, match=said):
        pair(robot, [tmp_path / "run.csv"], Asked())


def test_a_topic_that_ros_echoes_is_read(robot, tmp_path):
    """Take names from a comment's line, and joints from columns that hold a name each."""
    frame = table("field.desired.positions#", "field.actual.positions#", "%time")
    frame["%time"] = (1e9 * (T + 1718.0)).astype(np.int64)
    for k, name in enumerate(NAMES):
        frame.insert(1 + k, f"field.joint_names{k}", name)
    frame.to_csv(tmp_path / "run.csv", index=False)
    made = pair(robot, [tmp_path / "run.csv"], Asked())
    assert np.allclose(made.signal("command", 0), COMMAND)
    assert np.allclose(made.signal("position", 0), POSITION)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"t": 0.0, "q": [1, 2]}\n' * 9, "is JSON; save its rows as CSV"),
        ("1718,5000,,pan,0.0,0.1,0.2\n" * 9, "the first line of .* holds numbers; write the names"),
    ],
)
def test_a_text_without_columns_is_refused(robot, tmp_path, text, said):
    """Say what a file is, and what to do."""
    (tmp_path / "run.csv").write_text(text)
    with pytest.raises(LogError, match=said):
        pair(robot, [tmp_path / "run.csv"], Asked())


@pytest.mark.parametrize("loose", [0.0, 0.05])
def test_a_follower_that_does_not_follow_is_said(tmp_path, loose):
    """Compare the reading of a joint that follows another by the model with that one's."""
    bound = '<equality><joint joint1="elbow_flex" joint2="shoulder_pan"/></equality></mujoco>'
    led = ARM[: ARM.rindex("<position")]
    (tmp_path / "arm.xml").write_text(f"{led}</actuator>{bound}")
    frame = table("{}_cmd", "{}_pos").drop(columns="elbow_flex_cmd")
    frame["elbow_flex_pos"] = frame["shoulder_pan_pos"] + loose * np.sign(np.cos(2 * T))
    frame.to_csv(tmp_path / "run.csv", index=False)
    made = pair(tmp_path / "arm.xml", [tmp_path / "run.csv"], Asked())
    said = [one for one in made.warnings if "elbow_flex follows shoulder_pan" in one]
    assert bool(said) == bool(loose)


def test_a_column_that_is_named_counts(robot, tmp_path):
    """Take the columns that the user names, under any name."""
    frame = table("x#", "y#")
    frame.to_csv(tmp_path / "run.csv", index=False)
    named = {f"{n}.{kind}": f"{c}{k}" for k, n in enumerate(NAMES) for kind, c in KINDS.items()}
    made = pair(robot, [tmp_path / "run.csv"], Asked(columns=named))
    assert np.allclose(made.signal("command", 0), COMMAND)
    with pytest.raises(LogError, match="give JOINT.KIND=COLUMN, of the joints shoulder_pan"):
        pair(robot, [tmp_path / "run.csv"], Asked(columns={"wrist.command": "x0"}))


KINDS = {"command": "x", "position": "y"}


def test_a_lerobot_data_set_is_read(robot, tmp_path):
    """Take action and observation.state by the names in info.json, in degrees, by episode."""
    (tmp_path / "meta").mkdir()
    names = [f"{name}.pos" for name in NAMES]
    features = {column: {"names": names} for column in ("action", "observation.state")}
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"features": features}))
    frame = pd.DataFrame(
        {
            "action": list(np.degrees(COMMAND)),
            "observation.state": list(np.degrees(POSITION)),
            "timestamp": np.tile(T[:400], 2),
            "frame_index": np.tile(np.arange(400), 2),
            "episode_index": np.repeat([0, 1], 400),
        }
    )
    (tmp_path / "data").mkdir()
    frame.to_parquet(tmp_path / "data" / "file-000.parquet")
    made = pair(robot, [tmp_path / "data" / "file-000.parquet"], Asked())
    assert np.allclose(made.signal("position", 1), POSITION[400:])
    assert [e.episode for e in made.episodes] == [0, 1]


PAGE = Path(__file__).resolve().parents[2] / "docs/guide/own-robot.md"


def test_the_page_on_own_robots_can_be_followed(tmp_path, monkeypatch, capfd):
    """Check the model and the table that the page shows with every command that it shows."""
    page = PAGE.read_text()
    arm, header, calls = (
        re.findall(rf"```{kind}\n(.*?)```", page, re.DOTALL) for kind in ("xml", "text", "sh")
    )
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(arm[0])
    names = header[0].splitlines()[0].split(";")
    rows = np.degrees(np.stack([COMMAND[:, 0], POSITION[:, 0], COMMAND[:, 1], POSITION[:, 1]], 1))
    table = np.column_stack([1e3 * T, rows, np.ones(len(T))])
    pd.DataFrame(table, columns=names).to_csv("run.csv", index=False, sep=";", decimal=",")
    data_set(Path("lerobot_dataset"), ["shoulder", "elbow"])
    lines = [line for text in calls for line in text.splitlines()]
    checks = [line for line in lines if line.startswith("bench check") and "bag" not in line]
    for number, line in enumerate(checks):
        words = [*shlex.split(line)[1:], "--out", f"out{number}", "--json"]
        assert cli.call(words) in (0, 1)
        found = json.loads(capfd.readouterr().out)
        assert found["joints"] == ["shoulder", "elbow"]
        assert any("kp 60 Nm/rad (arm.xml)" in said for said in found["understood"])
    assert len(checks) == 3 and len(page.encode()) < 8000


def test_check_says_it_draws_it_and_writes_a_log(robot, tmp_path, capfd):
    """Name columns, drives and their sources; write a log that can be read, and a picture."""
    table("{}_cmd", "{}_pos").to_csv(tmp_path / "run.csv", index=False)
    words = ["check", "--robot", str(robot), "--log", str(tmp_path / "run.csv")]
    assert cli.call([*words, "--out", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert any("kp 40 Nm/rad (arm.xml)" in line for line in found["understood"])
    assert read_log(tmp_path / "out" / "log").joints == NAMES
    assert (tmp_path / "out" / "motion.png").is_file()
    assert cli.call(["check", "--robot", str(robot)]) == 2
    assert "--log TABLE is missing" in capfd.readouterr().err
    assert cli.call([*words, "--drive", "elbow_flex=kq:1", "--out", str(tmp_path / "two")]) == 2
    assert "kq is '1'" in capfd.readouterr().err


def test_a_remark_is_no_fault(robot, tmp_path, capfd):
    """Say where a joint did not follow, and end well: a diagnosis takes such a log."""
    frame = table("{}_cmd", "{}_pos")
    off = (T > 1.8) & (T < 2.4)
    frame.loc[off, "elbow_flex_pos"] = frame["elbow_flex_pos"][off].iloc[0]
    frame.to_csv(tmp_path / "run.csv", index=False)
    words = ["check", "--robot", str(robot), "--log", str(tmp_path / "run.csv")]
    assert cli.call([*words, "--out", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["ok"] and not found["faults"]
    said = " ".join(found["warnings"])
    assert re.search("elbow_flex did not follow from 1.[89] to 2.4 s", said)


def test_a_folder_in_place_of_a_model_is_named_with_its_files(tmp_path, capfd):
    """Say which files a folder holds, where one is asked for."""
    folder = tmp_path / "tables"
    folder.mkdir()
    for name in "abcdef":
        (folder / f"{name}.csv").write_text("t\n")
    words = ["check", "--robot", str(folder), "--log", str(folder)]
    assert cli.call(words) == 2
    assert "that holds a.csv, b.csv, c.csv, d.csv, ...; give one file" in capfd.readouterr().err


def test_the_folder_of_a_check_is_taken_for_its_log(tmp_path):
    """Name the log that a folder of results holds."""
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "log.yaml").write_text("schema: 1\n")
    with pytest.raises(LogError, match="did you mean .*log"):
        read_log(tmp_path)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (np.nan, "'elbow_flex_pos' is empty .* a dead sensor"),
        (0.1, "sensor of elbow_flex: .* dead"),
    ],
)
def test_a_dead_sensor_is_named(robot, tmp_path, value, said):
    """Say that a sensor reads nothing, or the same throughout, instead of a unit or a cause."""
    frame = table("{}_cmd", "{}_pos").assign(elbow_flex_pos=value)
    frame.to_csv(tmp_path / "run.csv", index=False)

    def looked_at() -> tuple[str, ...]:
        made = pair(robot, [tmp_path / "run.csv"], Asked())
        return triage(made, mjcf_world(made))

    with pytest.raises(LogError, match=said):
        looked_at()


def test_counts_are_known_by_their_number_and_zero(robot, tmp_path):
    """Ask how many counts make a turn, and take the answer with the zero."""
    frame = table("{}_goal_counts", "{}_present_counts")
    counts = np.round(frame.iloc[:, 1:] * 4096 / (2 * np.pi) + 2048)
    pd.concat([frame["t"], counts], axis=1).to_csv(tmp_path / "run.csv", index=False)
    with pytest.raises(LogError, match="such as 4096/turn@2048"):
        pair(robot, [tmp_path / "run.csv"], Asked())
    made = pair(robot, [tmp_path / "run.csv"], Asked(unit="4096/turn@2048"))
    assert np.allclose(made.signal("position", 0), POSITION, atol=1e-3)


def test_rows_that_lack_are_interpolated(robot, tmp_path):
    """Put back rows that evenly made ones lack, of a stream of commands with its values."""
    lost = np.random.default_rng(0).uniform(size=len(T)) < 0.1
    lost[[0, -1]] = False
    table("{}_cmd", "{}_pos")[~lost].to_csv(tmp_path / "run.csv", index=False)
    made = pair(robot, [tmp_path / "run.csv"], Asked())
    at = np.round(made.samples["t_s"] * 200).astype(int)
    assert len(at) > 0.99 * len(T) and any("of even ones lack" in w for w in made.warnings)
    assert np.allclose(made.signal("command", 0), COMMAND[at], atol=1e-3)
    assert np.allclose(made.signal("position", 0), POSITION[at], atol=1e-3)


def data_set(folder: Path, names: Sequence[str]) -> None:
    """Write two episodes as LeRobot does, with the names that stand in its info.json."""
    named = {"names": [f"{name}.pos" for name in names]}
    features = {"action": named, "observation.state": named}
    (folder / "meta").mkdir(parents=True)
    (folder / "meta/info.json").write_text(json.dumps({"features": features}))
    for number in range(2):
        frame = pd.DataFrame({"action": list(COMMAND), "observation.state": list(POSITION)})
        frame = frame.assign(timestamp=T, episode_index=number)
        file = folder / f"data/chunk-000/file-00{number}.parquet"
        file.parent.mkdir(parents=True, exist_ok=True)
        frame.to_parquet(file)


def test_a_data_set_of_lerobot_is_read_from_its_root(robot, tmp_path):
    """Read all files of a data set, with its names."""
    data_set(tmp_path / "set", NAMES)
    made = pair(robot, [tmp_path / "set"], Asked())
    assert len(made.episodes) == 2
    assert np.allclose(made.signal("position", 1), POSITION)
