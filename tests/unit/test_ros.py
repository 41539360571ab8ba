"""Recordings of ROS as they come: states and commands on topics, in bags of either storage."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmark.cli import app as cli
from diagnosis.logs.log import DriveSettings, LogError
from diagnosis.logs.two_files import Asked, pair

rosbags = pytest.importorskip("rosbags", reason="the extra ros is not installed")
from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
ARM = """<mujoco><worldbody><body><inertial mass="0.8" pos="0.15 0 0" diaginertia="8e-4 4e-3 4e-3"/>
<joint name="a" axis="0 1 0" range="-90 90" armature="0.02"/><body pos="0.3 0 0">
<inertial mass="0.2" pos="0.1 0 0" diaginertia="1e-4 1e-3 1e-3"/>
<joint name="b" axis="0 1 0" range="-90 90" armature="0.01"/></body></body></worldbody></mujoco>"""
NAMES, T = ["b", "a"], np.arange(0, 4, 0.01)
READ = np.stack([0.3 * np.sin(2 * T), 0.2 * np.sin(3 * T)], axis=1)
ASKED = np.stack([np.round(T) * 0.1, -np.round(T) * 0.05], axis=1)
DRIVES = {"*": DriveSettings(kp=40, kd=1)}


def header(time_s: float):
    """A header with a stamp."""
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=int(time_s), nanosec=round(time_s % 1 * 1e9))
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id="")


def state(time_s: float, values: np.ndarray):
    """A JointState."""
    none = np.zeros(0)
    return TYPES["sensor_msgs/msg/JointState"](
        header=header(time_s), name=NAMES, position=values, velocity=none, effort=0 * values + 0.5
    )


def array(time_s: float, values: np.ndarray):
    """Numbers without names."""
    layout = TYPES["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return TYPES["std_msgs/msg/Float64MultiArray"](layout=layout, data=values)


def trajectory(time_s: float, values: np.ndarray):
    """A trajectory of one point, 20 ms ahead."""
    ahead = TYPES["builtin_interfaces/msg/Duration"](sec=0, nanosec=20_000_000)
    none = np.zeros(0)
    point = TYPES["trajectory_msgs/msg/JointTrajectoryPoint"](
        positions=values, velocities=none, accelerations=none, effort=none, time_from_start=ahead
    )
    return TYPES["trajectory_msgs/msg/JointTrajectory"](
        header=header(time_s), joint_names=NAMES, points=[point]
    )


def bag(
    path: Path, asked, topic: str, storage: StoragePlugin, drop: bool = False, late_s=0 * T
) -> Path:
    """A bag with states at 100 Hz, and commands of a kind, so late each."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        kind = asked(0.0, ASKED[0]).__msgtype__
        read = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=STORE)
        other = None if drop else writer.add_connection(topic, kind, typestore=STORE)
        for k, time_s in enumerate(T):
            now = round((100 + time_s) * 1e9)
            if other is not None:
                sent_s = 100 + time_s + late_s[k]
                raw = STORE.serialize_cdr(asked(sent_s, ASKED[k]), kind)
                writer.write(other, round(sent_s * 1e9), raw)
            raw = STORE.serialize_cdr(state(100 + time_s, READ[k]), "sensor_msgs/msg/JointState")
            writer.write(read, now, raw)
    return path


@pytest.fixture
def robot(tmp_path):
    """An arm of two joints."""
    (tmp_path / "arm.xml").write_text(ARM)
    return tmp_path / "arm.xml"


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize(
    ("asked", "topic", "late"),
    [
        (state, "/joint_command", 0),
        (array, "/position_controller/commands", 0),
        (trajectory, "/arm_controller/joint_trajectory", 2),
    ],
)
def test_a_bag_is_a_log(robot, tmp_path, storage, asked, topic, late):
    """Read states and commands of either storage, by name, with the time that a point is due."""
    made = pair(robot, [bag(tmp_path / "run", asked, topic, storage)], Asked(drives=DRIVES))
    rows = made.samples
    assert set(made.joints) == {"a", "b"} and len(rows) == len(T) - late
    assert np.allclose(rows["position_rad.a"], READ[late:, 1])
    assert np.allclose(rows["command_rad.b"], ASKED[: len(T) - late, 0])
    assert np.allclose(rows["torque_nm.a"], 0.5) and np.isclose(made.dt_s(0), 0.01)
    assert topic in made.said[0]


@pytest.mark.parametrize("asked", [state, array])
def test_a_command_counts_from_the_nearest_reading(robot, tmp_path, asked):
    """Put commands that are sent with a reading into its row, whichever is written first."""
    late_s = 4e-3 * np.sin(7 * np.arange(len(T)))
    path = bag(tmp_path / "run", asked, "/command", StoragePlugin.MCAP, late_s=late_s)
    rows = pair(robot, [path], Asked(drives=DRIVES)).samples
    assert np.allclose(rows["command_rad.b"], ASKED[len(T) - len(rows) :, 0])


def test_a_single_mcap_file_is_read(robot, tmp_path):
    """Read a file without its folder."""
    bag(tmp_path / "run", state, "/joint_command", StoragePlugin.MCAP)
    (file,) = (tmp_path / "run").glob("*.mcap")
    moved = file.rename(tmp_path / "alone.mcap")
    assert set(pair(robot, [moved], Asked(drives=DRIVES)).joints) == {"a", "b"}


def test_what_a_bag_lacks_is_said(robot, tmp_path, capfd):
    """Name the topics where one is lacking; refuse a broken bag in one line."""
    lone = bag(tmp_path / "lone", state, "/x", StoragePlugin.SQLITE3, drop=True)
    with pytest.raises(LogError, match=r"one topic of commands .*/joint_states \(JointState\)"):
        pair(robot, [lone], Asked(drives=DRIVES))
    (tmp_path / "bad.mcap").write_bytes(b"not a bag")
    words = ["check", "--robot", str(robot), "--log", str(tmp_path / "bad.mcap")]
    assert cli.call(words) == 2
    assert "bad.mcap cannot be read" in capfd.readouterr().err


def test_the_page_on_own_robots_reads_a_bag(robot, tmp_path, monkeypatch, capfd):
    """Check a bag with the command that the page shows."""
    page = (Path(__file__).resolve().parents[2] / "docs/guide/own-robot.md").read_text()
    (line,) = (line for line in page.splitlines() if "--log bag_folder" in line)
    bag(tmp_path / "bag_folder", state, "/joint_command", StoragePlugin.MCAP)
    monkeypatch.chdir(tmp_path)
    words = [*line.split()[1:], "--drive", "*=kp:40,kd:1", "--json"]
    assert cli.call(words) in (0, 1)
    assert set(json.loads(capfd.readouterr().out)["joints"]) == set(NAMES)
