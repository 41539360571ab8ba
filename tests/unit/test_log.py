"""Logs: what is written comes back, and every unusable input gives one clear error."""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from diagnosis.logs.log import (
    DriveSettings,
    EpisodeMeta,
    HandMechanism,
    Log,
    LogError,
    LogMeta,
    MjcfMechanism,
    read_log,
    write_log,
)

MJCF = "<mujoco><worldbody/></mujoco>"
ROBOT = {
    "schema": 1,
    "source": "my robot",
    "mechanism": {"hand": "trx"},
}
"""The least that a log.yaml holds."""


def table(samples: int = 400, rate_hz: float = 200.0) -> pd.DataFrame:
    """Two joints on different frequencies that follow 20 ms late, as a user would log them."""
    t = np.arange(samples) / rate_hz
    columns = {"t_s": t}
    for joint, pace in (("J0", 5.0), ("J1", 8.3)):
        columns[f"command_rad.{joint}"] = 0.3 * np.sin(pace * t)
        columns[f"position_rad.{joint}"] = 0.28 * np.sin(pace * (t - 0.02))
    return pd.DataFrame(columns)


def full_log() -> Log:
    """Two episodes with every kind of column, touch and stick in the second alone."""
    first, second = table(), table(300)
    for part in (first, second):
        for kind in ("motor_rad", "torque_nm", "velocity_rad_s", "push_nm"):
            part[f"{kind}.J0"] = np.linspace(-1, 1, len(part)) / 3
    second["touch.finger1"] = list(np.arange(300 * 128, dtype=np.float32).reshape(300, 128) / 7)
    for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz"):
        second[f"stick_{name}"] = 0.0
    second["stick_qw"] = 1.0
    samples = pd.concat([first.assign(episode=0), second.assign(episode=3)], ignore_index=True)
    episodes = (EpisodeMeta(episode=0, protocol="steps"), EpisodeMeta(episode=3, note="n"))
    meta = LogMeta(schema=1, source="test", mechanism=HandMechanism(hand="trx"), episodes=episodes)
    return Log(meta=meta, samples=samples)


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Writes a log folder by hand: a table or text as CSV, and log.yaml fields."""

    def one(samples: pd.DataFrame | str, **fields: object) -> Path:
        folder = tmp_path / "log"
        folder.mkdir()
        (folder / "log.yaml").write_text(yaml.safe_dump({**ROBOT, **fields}))
        text = samples if isinstance(samples, str) else samples.to_csv(index=False)
        (folder / "samples.csv").write_text(text)
        return folder

    return one


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_what_is_written_comes_back(tmp_path, form):
    """Give back every number to the bit, whatever the form."""
    log = full_log()
    write_log(log, tmp_path / "log", form)
    back = read_log(tmp_path / "log")
    assert back.joints == ("J0", "J1")
    assert [e.episode for e in back.episodes] == [0, 3]
    assert back.episodes[0].protocol == "steps" and back.episodes[1].note == "n"
    for column in log.samples.columns.drop("touch.finger1"):
        assert np.array_equal(back.samples[column], log.samples[column], equal_nan=True), column
    wanted = np.stack(list(log.samples["touch.finger1"].iloc[400:]))
    assert np.array_equal(back.touch(3)[:, 0], wanted)
    assert back.touch(0) is None and back.stick(0) is None
    assert back.stick(3).shape == (300, 7)


def test_the_protocol_may_stand_in_the_samples(write):
    """Take the protocol of each episode from the column that `bench excite` writes."""
    samples = pd.concat([table(), table()], ignore_index=True)
    samples["episode"] = np.repeat([0, 1], len(table()))
    samples["protocol"] = np.repeat(["steps", "multisine"], len(table()))
    log = read_log(write(samples))
    assert [(e.episode, e.protocol) for e in log.episodes] == [(0, "steps"), (1, "multisine")]
    assert "protocol" not in log.samples


def test_a_protocol_is_a_name_whatever_stands_there(write):
    """Take lists in the cells of a parquet file as names, or refuse them, without a trace."""
    folder = write(table())
    cells = [[1.0, 2.0]] * len(table())
    table().assign(protocol=cells).to_parquet(folder / "samples.parquet")
    (folder / "samples.csv").unlink(missing_ok=True)
    assert len(read_log(folder).episodes) == 1


def test_an_episode_beyond_any_integer_is_refused(write):
    """Say what a number of an episode is, also where protocols stand beside it."""
    with pytest.raises(LogError, match="'episode' must be a whole number"):
        read_log(write(table().assign(episode=1e300, protocol="steps")))


def test_an_episode_has_one_protocol(write):
    """Refuse an episode whose samples name another protocol than log.yaml does."""
    samples = table().assign(protocol="steps")
    with pytest.raises(LogError, match="episode 0 has the protocols push, steps; name one"):
        read_log(write(samples, episodes=[{"episode": 0, "protocol": "push"}]))


def test_forms_hold_the_same(tmp_path):
    """Write a log that was read from CSV as the same parquet file."""
    write_log(full_log(), tmp_path / "a")
    write_log(full_log(), tmp_path / "b", "csv")
    write_log(read_log(tmp_path / "b"), tmp_path / "c")
    first = (tmp_path / "a/samples.parquet").read_bytes()
    assert first == (tmp_path / "c/samples.parquet").read_bytes()
    assert (tmp_path / "a/log.yaml").read_text() == (tmp_path / "c/log.yaml").read_text()


def test_mechanism_file_comes_back(tmp_path):
    """Keep the MJCF beside the samples."""
    drive = DriveSettings(kp=1.0, kd=0.1)
    mechanism = MjcfMechanism(mjcf="arm.xml", joints={"J0": drive, "J1": drive})
    meta = LogMeta(schema=1, source="test", mechanism=mechanism)
    write_log(Log(meta=meta, samples=table(), mjcf_xml=MJCF), tmp_path / "log")
    back = read_log(tmp_path / "log")
    assert back.mjcf_xml == MJCF
    assert back.meta.mechanism == mechanism


def test_a_csv_and_eight_lines_do(write):
    """Infer rates, units and the one episode from a bare CSV."""
    folder = write(table())
    lines = (folder / "log.yaml").read_text().splitlines()
    log = read_log(folder)
    assert len(lines) <= 8
    assert log.episodes == (EpisodeMeta(episode=0, protocol="free"),)
    assert log.meta.nominal_uncertainty == 0.05
    assert log.dt_s(0) == pytest.approx(0.005)
    assert log.signal("position", 0).shape == (400, 2)
    assert log.warnings == ()


def test_linear_joints_are_in_metres(write):
    """Take _m and _n columns for a joint that slides."""
    samples = table().rename(columns=lambda c: c.replace("_rad.", "_m."))
    samples["torque_n.J0"] = 1.0
    log = read_log(write(samples))
    assert log.is_linear("J0")
    assert log.column("torque", "J0") == "torque_n.J0"
    assert not log.has("torque", "J1")
    with pytest.raises(LogError, match=r"has no 'torque_n.J1'"):
        log.column("torque", "J1")
    assert np.isnan(log.signal("torque", 0)).any(axis=0).tolist() == [False, True]


def test_absent_parts_are_named():
    """Say which kinds, episodes and channels there are."""
    log = full_log()
    assert log.has("motor", "J0") and not log.has("motor", "J1")
    with pytest.raises(LogError, match="known: command, position"):
        log.column("speed", "J0")
    with pytest.raises(LogError, match="no episode 1; it has: 0, 3"):
        log.episode(1)


def edited(column: str, row: int | slice, value: object) -> pd.DataFrame:
    """The table with one cell changed, or some."""
    samples = table().astype(object)
    samples.loc[row, column] = value
    return samples


def without(column: str) -> pd.DataFrame:
    return table().drop(columns=column)


@pytest.mark.parametrize(
    ("samples", "words"),
    [
        (without("t_s"), "no column 't_s'"),
        (without("position_rad.J1"), "have no column 'position_rad.J1'"),
        (table()[["t_s"]], "no joint; add columns"),
        (table().assign(**{"positon_rad.J0": 0.0}), "Did you mean 'position_rad.J0'?"),
        (table().assign(**{"torque_n.J0": 0.0}), "rename it 'torque_nm.J0'"),
        (table(samples=10), "10 samples; needed: at least 20"),
        (table().iloc[:0], "no rows"),
        (edited("position_rad.J0", slice(7, 90), math.nan), "is empty in 84 of 400 rows; allowed"),
        (edited("position_rad.J0", 7, 1e300), r"is 1e\+300 in sample 7 of episode 0"),
        (table().assign(episode="9" * 400, protocol="free"), "must be a whole number from 0"),
        (edited("command_rad.J0", 7, 1e11), r"is 1e\+11 in sample 7 of episode 0"),
        (edited("position_rad.J0", 7, "off"), "is 'off' in sample 7"),
        (edited("t_s", 7, 6 / 200), "'t_s' repeats at sample 7"),
        (edited("t_s", 7, 0.0), "'t_s' goes back at sample 7"),
        (edited("t_s", 7, math.nan), "'t_s' is not a number in sample 7"),
        (table().drop(index=range(100, 150)), "a hole of 51 periods before sample 100"),
        (table().assign(t_s=1000 * table()["t_s"]), "'t_s' in milliseconds?"),
        (table().assign(episode=0.5), "must be a whole number from 0"),
        (table().assign(episode=math.inf), "must be a whole number from 0"),
        (table().assign(episode=math.inf, protocol="free"), "must be a whole number from 0"),
        (table().assign(episode=-1.0, protocol="free"), "must be a whole number from 0"),
        (table().assign(episode=[*[0] * 100, *[1] * 100, *[0] * 200]), "not in one piece"),
        (table().assign(stick_x_m=0.0), "lacks stick_y_m"),
        (table().assign(pull_n=np.linspace(0, 9e4, 400)), "'pull_n' reaches 9e.04 N; allowed"),
        (table().assign(pull_n=np.linspace(0, -90, 400)), "'pull_n' goes down to -90 N; forces"),
        (table().assign(**{"touch.finger1": "0 1 x"}), "allowed: numbers separated by spaces"),
        (
            table().assign(**{"touch.finger1": ["0 1", *["0 1 0"] * 399]}),
            r"has \[2, 3\] values",
        ),
    ],
)
def test_unusable_samples_give_one_clear_error(write, samples, words):
    """Refuse samples that cannot be right and say where and why."""
    with pytest.raises(LogError, match=words.replace("?", r"\?")):
        read_log(write(samples))


@pytest.mark.parametrize("value", [math.nan, math.inf, "9" * 400])
def test_a_few_empty_cells_are_filled(write, value):
    """Interpolate single readings and hold a command, as of two files, and say so."""
    whole, (one, two) = table(), ("position_rad.J0", "command_rad.J1")
    lacking = edited(one, 7, value)
    lacking.loc[9, two] = math.nan
    log = read_log(write(lacking))
    assert log.samples[one][7] == pytest.approx(whole[one][7], abs=1e-3)
    assert log.samples[two][9] == whole[two][8]
    assert [text.partition(":")[0] for text in log.warnings] == [one, two]
    assert "empty in 1 of 400 rows, the first at 0.035 s" in log.warnings[0]


def test_a_push_that_nobody_knows_is_refused(write):
    """Refuse an episode of pushes without the channel, which any effect would look like."""
    episodes = [{"episode": 0, "protocol": "push"}]
    folder = write(table(), episodes=episodes)
    with pytest.raises(LogError, match="episode 0 is of protocol 'push' and has no channel 'push'"):
        read_log(folder)
    table().assign(**{"push_nm.J1": 0.01}).to_csv(folder / "samples.csv", index=False)
    assert read_log(folder).joints == ("J0", "J1")


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"schema": 2}, "schema 2; allowed: 1"),
        ({"schema": None}, "schema None; allowed: 1"),
        ({"mechanism": {"hand": ""}}, "mechanism.hand: string should have at least 1"),
        ({"mechanism": {}}, "mechanism.hand: field required"),
        ({"mechanism": 5}, "mechanism: input should be a valid dictionary"),
        (
            {"mechanism": {"mjcf": "../arm.xml", "joints": {"J0": {"kp": 1, "kd": 0}}}},
            "log's folder",
        ),
        ({"mechanism": {"mjcf": "a.xml", "joints": {"J0": {"kp": -1, "kd": 0}}}}, "J0.kp: input"),
        (
            {"mechanism": {"mjcf": "a.xml", "joints": {1.5: {"kp": 1, "kd": 0}}}},
            "joints.1.5: a name must",
        ),
        ({"mechanism": {"mjcf": "a.xml", "joints": {"J0": {"kp": 1, "kd": 0}}}}, "no model at"),
        ({"souce": "x"}, "souce: unknown field; correct or remove it"),
        ({"channels": {"position_rad": {"unit": "deg"}}}, "declared in deg; allowed: rad"),
        ({"channels": {"command_rad": {"unit": "V"}}}, "declared in V; allowed: rad; convert"),
        ({"channels": {"position_m": {"unit": "m"}}}, "declares 'position_m', which samples lack"),
        ({"channels": {"position_rad": {"unit": "rad", "rate_hz": 0}}}, "greater than 0"),
        ({"channels": {"position_rad": {"unit": "rad", "rate_hz": 500}}}, "t_s says 200 Hz"),
        ({"channels": {"position_rad": {"unit": "rad", "rate_hz": 50}}}, "t_s says 200 Hz"),
        ({"episodes": [{"episode": 1}]}, r"lists episodes \[1\], samples hold \[0\]"),
        ({"nominal_uncertainty": -1}, "greater than or equal to 0"),
    ],
)
def test_unusable_yaml_gives_one_clear_error(write, fields, words):
    """Refuse a log.yaml with the field, what was given and what is allowed."""
    with pytest.raises(LogError, match=words):
        read_log(write(table(), **fields))


def test_slow_channels_repeat_their_last_value(write):
    """Take a channel at a quarter of the rows' rate."""
    samples = table()
    samples["torque_nm.J0"] = np.repeat(np.arange(100.0), 4)
    channels = {"torque_nm": {"unit": "Nm", "rate_hz": 50}}
    assert read_log(write(samples, channels=channels)).meta.channels["torque_nm"].rate_hz == 50


@pytest.mark.parametrize(
    ("samples", "words"),
    [
        (table().drop(index=range(100, 105)), "1 gap; the longest has 6.0 periods"),
        (table().to_csv(index=False).rstrip("\n"), "no newline at its end"),
    ],
)
def test_odd_samples_give_a_warning(write, samples, words):
    """Read what is usable and say what is odd."""
    log = read_log(write(samples))
    assert any(words in warning for warning in log.warnings), log.warnings


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("t_s;command_rad.J0\n0;1\n", "not separated by commas"),
        ("t_s,t_s\n0,1\n", "has two columns 't_s'"),
        (table().to_csv(index=False)[:-30], "is incomplete: its last line has"),
        (table().to_csv(index=False) + "1,2,3,4,5,6,7\n", "correct or remove that line"),
    ],
)
def test_damaged_csv_gives_one_clear_error(write, text, words):
    """Say what is wrong with the file itself."""
    with pytest.raises(LogError, match=words):
        read_log(write(text))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda data: data[: len(data) // 2], "is incomplete"),
        (lambda data: b"x" + data[1:], "is not a parquet file"),
        (lambda data: data[:4] + b"\xff" * (len(data) - 12) + data[-8:], "is damaged"),
        (lambda data: b"", "is not a parquet file"),
    ],
)
def test_damaged_parquet_gives_one_clear_error(tmp_path, damage, words):
    """Say what is wrong with the file itself."""
    write_log(full_log(), tmp_path / "log")
    path = tmp_path / "log/samples.parquet"
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(LogError, match=words):
        read_log(tmp_path / "log")


def test_absent_files_are_named(tmp_path, write):
    """Say which file of a log is missing."""
    with pytest.raises(LogError, match="no log folder"):
        read_log(tmp_path / "absent")
    folder = write(table())
    (folder / "samples.csv").rename(folder / "other.csv")
    with pytest.raises(LogError, match="neither samples.parquet nor samples.csv"):
        read_log(folder)
    (folder / "log.yaml").write_text("schema: [")
    with pytest.raises(LogError, match="cannot be read as YAML"):
        read_log(folder)
    (folder / "log.yaml").unlink()
    with pytest.raises(LogError, match="eight lines"):
        read_log(folder)


def test_a_taken_folder_is_left_alone(tmp_path):
    """Refuse to write over what is there."""
    (tmp_path / "log").mkdir()
    (tmp_path / "log/mine.txt").write_text("mine")
    with pytest.raises(LogError, match="exists; choose another"):
        write_log(full_log(), tmp_path / "log")
    assert [p.name for p in (tmp_path / "log").iterdir()] == ["mine.txt"]


def test_what_cannot_be_read_is_not_written(tmp_path):
    """Write nothing when the samples are not sound."""
    log = full_log()
    bad = Log(meta=log.meta, samples=log.samples.assign(t_s=0.0))
    with pytest.raises(LogError, match="repeats"):
        write_log(bad, tmp_path / "log")
    assert not list(tmp_path.iterdir())


def test_a_kill_leaves_no_half_log(tmp_path):
    """Leave either no folder or a whole log when the writer is killed."""
    code = (
        "import sys; sys.path.insert(0, 'tests/unit'); from pathlib import Path\n"
        "from test_log import full_log; from diagnosis.logs.log import write_log\n"
        "log = full_log(); print('ready', flush=True)\n"
        "k = 0\n"
        "while True:\n"
        "    write_log(log, Path(sys.argv[1]) / f'log{k}'); k += 1\n"
    )
    root = Path(__file__).resolve().parents[2]
    arguments = [sys.executable, "-c", code, str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, cwd=root, env=environment) as writer:
        assert writer.stdout is not None and writer.stdout.readline() == b"ready\n"
        while not (tmp_path / "log2").exists():
            time.sleep(0.01)
        writer.send_signal(signal.SIGKILL)
    finished = [p for p in tmp_path.iterdir() if not p.name.startswith(".")]
    assert len(finished) >= 3
    for folder in finished:
        assert len(read_log(folder).samples) == 700


def test_provenance_is_not_read(tmp_path):
    """Keep what made a log out of what a diagnosis reads."""
    write_log(full_log(), tmp_path / "a", provenance={"effects": "backlash=1deg"})
    write_log(full_log(), tmp_path / "b")
    a, b = read_log(tmp_path / "a"), read_log(tmp_path / "b")
    assert (tmp_path / "a/provenance.json").exists()
    assert a.meta == b.meta
    assert not (tmp_path / "b/provenance.json").exists()


def test_the_documented_example_is_a_log(tmp_path):
    """Read the eight lines and the CSV of the page, lengthened to an episode each."""
    page = (Path(__file__).resolve().parents[2] / "docs/reference/log-format.md").read_text()
    lines, rows = (page.split(f"```{kind}\n")[1].split("```")[0] for kind in ("yaml", "text"))
    header = rows.splitlines()[0].split(",")
    assert len(lines.splitlines()) == 8
    (tmp_path / "log.yaml").write_text(lines)
    (tmp_path / "arm.xml").write_text(MJCF)
    values = dict(zip(table().columns, header[1:], strict=True))
    part = table().rename(columns=values)
    samples = pd.concat([part.assign(episode=k) for k in (0, 1)])
    samples[header].to_csv(tmp_path / "samples.csv", index=False)
    log = read_log(tmp_path)
    assert log.joints == ("shoulder", "elbow")
    assert [e.protocol for e in log.episodes] == ["steps", "multisine"]
