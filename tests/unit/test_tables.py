"""Tables in every form that people write: long, in several files, with empty cells, odd headers."""

import json
import tracemalloc

import numpy as np
import pandas as pd
import pytest

from benchmark.cli import app as cli
from diagnosis import read_log
from diagnosis.logs.foreign import read_table
from diagnosis.logs.log import Log, LogError
from diagnosis.logs.two_files import Asked, pair, put_together
from tests.unit.test_two_files import ARM, COMMAND, NAMES, POSITION, T, table

SOME = slice(5, 700)
"""Rows away from the ends, where nothing is cut."""


@pytest.fixture
def folder(tmp_path):
    """A folder with the model of an arm of two joints."""
    (tmp_path / "arm.xml").write_text(ARM)
    return tmp_path


def read(folder, *names: str, **asked) -> Log:
    """The log of tables in the folder."""
    return pair(folder / "arm.xml", [folder / name for name in names], Asked(**asked))


def long(**more) -> pd.DataFrame:
    """A row per sample and joint, joint after joint."""
    parts = [
        {"time": T, "joint": name, "position": POSITION[:, k], "command": COMMAND[:, k], **more}
        for k, name in enumerate(NAMES)
    ]
    return pd.concat(map(pd.DataFrame, parts), ignore_index=True)


def same(log: Log, episode: int = 0) -> bool:
    """Whether a log holds the motion as it was."""
    read = (log.signal(kind, episode, NAMES) for kind in ("command", "position"))
    pairs = zip(read, (COMMAND, POSITION), strict=True)
    return all(len(a) == len(b) and np.allclose(a, b, atol=1e-6) for a, b in pairs)


def in_order(frame: pd.DataFrame) -> pd.DataFrame:
    """Sample after sample."""
    return frame.sort_values("time", kind="stable")


def melted(frame: pd.DataFrame) -> pd.DataFrame:
    """A row per sample, joint and signal."""
    return frame.melt(["time", "joint"], ["position", "command"], "signal", "value")


def by_name(frame: pd.DataFrame) -> pd.DataFrame:
    """A row per sample and name of joint and signal."""
    named = frame.assign(name=frame["joint"] + "." + frame["signal"])
    return named.drop(columns=["joint", "signal"])


FORMS = {
    "joint after joint": long(),
    "sample after sample": in_order(long()),
    "numbers of motors": long()
    .replace({"joint": {name: k + 1 for k, name in enumerate(NAMES)}})
    .rename(columns={"joint": "motor_id"}),
    "signal by signal": in_order(melted(long())),
    "names of signals": by_name(melted(long())),
    "units in a column": melted(long())
    .assign(unit="deg")
    .assign(value=lambda f: 180 / np.pi * f["value"]),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_long_table_is_read(folder, form):
    """Read a row per time and joint, and one per time, joint and signal."""
    FORMS[form].to_csv(folder / "run.csv", index=False)
    assert same(read(folder, "run.csv"))


def test_episodes_of_a_long_table_stay_apart(folder):
    """Keep episodes that a column numbers, and those whose clock starts again."""
    pd.concat([long(episode=n) for n in (3, 7)]).to_csv(folder / "named.csv", index=False)
    pd.concat([in_order(long())] * 2).to_csv(folder / "again.csv", index=False)
    for name in ("named.csv", "again.csv"):
        log = read(folder, name)
        assert len(log.episodes) == 2 and same(log, 0) and same(log, 1)


def test_a_long_table_may_name_its_protocol(folder):
    """Take the protocol that `bench excite` writes from the rows of any joint."""
    long(protocol="steps").to_csv(folder / "run.csv", index=False)
    log = read(folder, "run.csv")
    assert same(log) and [one.protocol for one in log.episodes] == ["steps"]


def test_a_column_of_names_beside_numbered_joints(folder):
    """Take numbered columns as they are beside a column that names the robot."""
    table("q_des_#", "q_#", name="robot 7").to_csv(folder / "run.csv", index=False)
    assert same(read(folder, "run.csv"))


def test_labels_that_are_no_joints_are_named(folder):
    """Say which names a long table has, where the model has others."""
    strange = long().replace({"joint": dict(zip(NAMES, ("wheel", "tail"), strict=True))})
    strange.to_csv(folder / "run.csv", index=False)
    with pytest.raises(LogError, match="'joint' names tail, wheel, and the model has shoulder_pan"):
        read(folder, "run.csv")


def test_joints_that_are_read_after_each_other(folder):
    """Take readings of other instants between those beside them, and say so."""
    late = long()
    late.loc[late["joint"] == NAMES[1], "time"] += 0.0013
    in_order(late).to_csv(folder / "run.csv", index=False)
    log = read(folder, "run.csv")
    moved = 0.3 * np.sin(3 * (log.samples["t_s"] + T[1] - 0.0013 - 0.03))
    assert np.allclose(log.signal("position", 0, [NAMES[1]])[:, 0], moved, atol=1e-4)
    assert np.allclose(log.signal("command", 0, NAMES)[SOME], COMMAND[1:][SOME])
    assert "interpolated" in " ".join(log.warnings)


def test_one_file_per_joint(folder, monkeypatch):
    """Take several files, a folder, and a name with *, and the joint from the file's name."""
    (folder / "run").mkdir()
    for k, name in enumerate(NAMES):
        frame = pd.DataFrame({"time": T, "cmd": COMMAND[:, k], "pos": POSITION[:, k]})
        frame.to_csv(folder / "run" / f"test 3 {name}.csv", index=False)
    for given in (["run"], ["run/*.csv"], [f"run/test 3 {name}.csv" for name in NAMES]):
        assert same(read(folder, *given))
    assert same(read_log(folder / "run", robot=folder / "arm.xml"))


def test_one_file_of_commands_and_one_of_readings(folder):
    """Hold commands of another rate until the next; never a later one."""
    (folder / "run").mkdir()
    for kind, values, every in (("commands", COMMAND, 4), ("states", POSITION, 1)):
        frame = pd.DataFrame({"time": 1e3 * T, **dict(zip(NAMES, values.T, strict=True))})
        frame[::every].to_csv(folder / "run" / f"{kind}.csv", index=False)
    log = read(folder, "run")
    assert np.allclose(log.signal("position", 0, NAMES), POSITION)
    assert np.allclose(log.signal("command", 0, NAMES), COMMAND[np.arange(len(T)) // 4 * 4])
    assert "holds until the next" in " ".join(log.warnings)


def test_several_recordings_are_episodes(folder):
    """Take files that each have all as recordings, one after the other."""
    for n in range(3):
        table("{}_cmd", "{}_pos").to_csv(folder / f"run{n}.csv", index=False)
    log = read(folder, "run*.csv")
    assert len(log.episodes) == 3 and same(log, 2)


def test_files_of_different_times_are_refused(folder):
    """Say when each file was, where they have no time in common."""
    for k, name in enumerate(NAMES):
        frame = pd.DataFrame({"time": T + 60 * k, "cmd": COMMAND[:, k], "pos": POSITION[:, k]})
        frame.to_csv(folder / f"run_{name}.csv", index=False)
    with pytest.raises(LogError, match="no time in common: .* 60 to 63.99 s"):
        read(folder, *(f"run_{name}.csv" for name in NAMES))


def test_a_few_empty_cells_are_left_out(folder):
    """Leave rows without readings out, hold commands, and say how many and where.

    A single row without a time is put back from its neighbours.
    """
    frame = table("{}_cmd", "{}_pos").astype(object)
    frame.loc[40:42, "shoulder_pan_pos"] = ["", "nan", "timeout"]
    frame.loc[100, "elbow_flex_cmd"] = frame.loc[50, "t"] = None
    frame.loc[41, "shoulder_pan_pos"] = np.inf
    frame.to_csv(folder / "run.csv", index=False)
    log = read(folder, "run.csv")
    kept = np.setdiff1d(np.arange(len(T)), [40, 41, 42])
    assert np.allclose(log.samples["t_s"], T[kept])
    assert np.allclose(log.signal("position", 0, NAMES), POSITION[kept], atol=1e-4)
    held = np.where(kept == 100, 99, kept)
    command = log.signal("command", 0, [NAMES[1]])[:, 0]
    assert np.allclose(command, COMMAND[held, 1], atol=1e-4)
    said = " ".join(log.warnings)
    assert "1 row without a time left out" in said
    assert "position_rad.shoulder_pan: empty in 3 of 799 rows, the first at 0.2 s" in said
    assert "command_rad.elbow_flex: empty in 1 of 796 rows, the first at 0.5 s" in said


def test_readings_that_lack_singly_are_interpolated(folder):
    """Keep rows, and the commands in them, of which each joint lacks a few of its own."""
    frame, lack = table("{}_cmd", "{}_pos"), np.random.default_rng(0)
    for name in NAMES:
        frame.loc[lack.random(len(T)) < 0.08, f"{name}_pos"] = np.nan
    assert frame.isna().any(axis=1).mean() > 0.1
    frame.to_csv(folder / "run.csv", index=False)
    log = read(folder, "run.csv")
    kept = np.isin(np.round(T, 6), np.round(log.samples["t_s"] + T[0], 6))
    assert kept.mean() > 0.98
    assert np.allclose(log.signal("position", 0, NAMES), POSITION[kept], atol=1e-3)
    assert np.allclose(log.signal("command", 0, NAMES), COMMAND[kept], atol=1e-3)
    assert any("there readings are interpolated" in text for text in log.warnings)


def test_many_empty_cells_are_refused(folder):
    """Refuse a joint that is often not read, or is commanded and never read."""
    frame = table("{}_cmd", "{}_pos")
    frame.loc[np.random.default_rng(0).random(len(T)) < 0.4, "elbow_flex_pos"] = np.nan
    frame.to_csv(folder / "run.csv", index=False)
    with pytest.raises(LogError, match=r"elbow_flex is empty in \d+ of 800 rows; allowed: up to"):
        read(folder, "run.csv")
    frame.assign(elbow_flex_pos=np.nan).to_csv(folder / "run.csv", index=False)
    with pytest.raises(LogError, match="'elbow_flex_pos' is empty in all rows.*: a dead sensor"):
        read(folder, "run.csv")


def test_a_dropout_begins_an_episode(folder):
    """Cut where a joint was not read for long."""
    frame = table("{}_cmd", "{}_pos")
    frame.loc[300:350, "elbow_flex_pos"] = np.nan
    frame.to_csv(folder / "run.csv", index=False)
    assert [len(read(folder, "run.csv").episode(n)) for n in (0, 1)] == [300, 449]


def test_messages_of_their_own_rows(folder):
    """Hold commands and slow channels that stand in rows of their own."""
    frame = table("{}_cmd", "{}_pos")
    commands = frame[["t", *(f"{name}_cmd" for name in NAMES)]][::4]
    read_at = frame[["t", *(f"{name}_pos" for name in NAMES)]].assign(t=T + 7e-4)
    effort = frame[["t"]][::10].assign(elbow_flex_torque=1.5)
    pd.concat([commands, read_at, effort]).sort_values("t").to_csv(folder / "run.csv", index=False)
    log = read(folder, "run.csv")
    assert np.allclose(log.signal("position", 0, NAMES), POSITION)
    assert np.allclose(log.signal("command", 0, NAMES), COMMAND[np.arange(len(T)) // 4 * 4])
    assert np.allclose(log.signal("torque", 0, [NAMES[1]]), 1.5)


def test_rows_that_are_doubled_or_out_of_order(folder):
    """Leave doubled rows out and sort late ones, without a new episode or other stamps."""
    frame = table("{}_cmd", "{}_pos")
    frame.loc[[100, 101]] = frame.loc[[101, 100]].to_numpy()
    pd.concat([frame[:300], frame[298:]]).to_csv(folder / "run.csv", index=False)
    assert same(read(folder, "run.csv"))


HEADS = {
    "a comment": ("# t,{0}_cmd,{0}_pos\n", ","),
    "a comment of savetxt": ("# t {0}_cmd {0}_pos\n", " "),
    "units below": ("t;{0}_cmd;{0}_pos\n[s];[rad];[rad]\n", ";"),
    "names of joints above": ("t;{0};\n;cmd;pos\n", ";"),
    "a line for a spreadsheet": ("sep=;\nt;{0}_cmd;{0}_pos\n", ";"),
    "the only joint of the model": ("time,target,actual\n", ","),
}


@pytest.mark.parametrize("head", HEADS)
def test_headers_as_people_write_them(folder, head):
    """Find the names of columns in comments, in two lines, and of the only joint of a model."""
    first, separator = HEADS[head]
    alone = ARM.replace(f'<position joint="{NAMES[0]}" kp="40" kv="1.2" forcerange="-8 8"/>', "")
    alone = alone.replace(
        f'<joint name="{NAMES[0]}" axis="0 1 0" range="-90 90" armature="0.02"/>', ""
    )
    (folder / "arm.xml").write_text(alone)
    rows = np.stack([T, COMMAND[:, 1], POSITION[:, 1]], axis=1)
    text = "\n".join(separator.join(f"{x:.6f}" for x in row) for row in rows)
    (folder / "run.csv").write_text(first.format(NAMES[1]) + text + "\n")
    log = read(folder, "run.csv")
    assert np.allclose(log.signal("command", 0)[:, 0], COMMAND[:, 1], atol=1e-6)
    assert np.allclose(log.signal("position", 0)[:, 0], POSITION[:, 1], atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_errors_of_positions_are_positions(folder, sign):
    """Take an error from the command or add it, so that no position comes before its command."""
    frame = table("{}_cmd", "{}_position_error")
    for k, name in enumerate(NAMES):
        frame[f"{name}_position_error"] = sign * (COMMAND - POSITION)[:, k]
    frame.to_csv(folder / "run.csv", index=False)
    log = read(folder, "run.csv")
    assert same(log)
    way = "less" if sign > 0 else "plus"
    assert f"position_rad.{NAMES[0]} is its command {way} '{NAMES[0]}_position_error'" in log.said


def test_a_current_position_is_a_position(folder):
    """Read a current position as the present one, and a present current as no position."""
    frame = table("{}_target_position", "{}_current_position").assign(elbow_flex_current=0.1)
    frame.to_csv(folder / "run.csv", index=False)
    assert same(log := read(folder, "run.csv")) and "not used: elbow_flex_current" in log.said


def test_lists_in_cells_have_the_names_that_stand_beside_them(folder):
    """Read texts that hold lists, in the order of a list of names or of the model's joints."""
    for file, values, kind in (("control", COMMAND, "x"), ("state", POSITION, "y")):
        cells = [str(row[::-1].tolist()) for row in values]
        frame = pd.DataFrame({"timestamp": T, "positions": cells, kind: "a"})
        frame.to_csv(folder / f"{file}.csv", index=False)
    (folder / "joint_list.txt").write_text("\n".join(NAMES[::-1]))
    asked = [folder / "control.csv", folder / "state.csv"]
    assert same(pair(folder / "arm.xml", asked, Asked()))
    (folder / "joint_list.txt").unlink()
    turned = pair(folder / "arm.xml", asked, Asked())
    assert np.allclose(turned.signal("position", 0, NAMES[::-1]), POSITION)


@pytest.mark.parametrize("form", [name for name in FORMS if name != "numbers of motors"])
def test_long_tables_name_their_joints_without_a_model(folder, form):
    """Take the labels of rows for joints where there is no model."""
    FORMS[form].to_csv(folder / "run.csv", index=False)
    assert same(put_together(None, None, [folder / "run.csv"], Asked()))


def test_currents_stand_for_torques_without_a_model(folder):
    """Take a joint's current as it is, where only its changes count."""
    table("{}_cmd", "{}_pos").assign(elbow_flex_current=0.1).to_csv(folder / "run.csv", index=False)
    log = put_together(None, None, [folder / "run.csv"], Asked())
    assert np.allclose(log.signal("torque", 0, [NAMES[1]]), 0.1)


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16"])
@pytest.mark.parametrize("clock", ["2026-03-01T12:00:{:09.6f}Z", "12:00:{:09.6f}"])
def test_dates_and_letters_of_a_spreadsheet(folder, encoding, clock):
    """Read dates and times of day, and the degree sign as Windows writes it."""
    frame = table("{} Soll [°]", "{} Ist [°]")
    frame.iloc[:, 1:] *= 180 / np.pi
    frame = frame.assign(t=[clock.format(t) for t in T])
    frame.to_csv(folder / "run.csv", index=False, encoding=encoding)
    assert same(read(folder, "run.csv"))


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"0,0.1,0.2\n1,0.2,0.3\n", "holds numbers; write the names of its columns"),
        (b"PK\x03\x04\0\0", "is a spreadsheet or an archive; save the table as CSV"),
        (b"\x93NUMPY\1\0", "is a NumPy file"),
        (b"\0\1\2\3", "is no text; give a table as CSV or parquet"),
        (b"t,a\n", "has no rows"),
    ],
)
def test_what_is_no_table_is_refused(folder, data, said):
    """Say what a file is, and what to do with it."""
    (folder / "run.csv").write_bytes(data)
    with pytest.raises(LogError, match=said):
        read(folder, "run.csv")
    (folder / "empty").mkdir(exist_ok=True)
    with pytest.raises(LogError, match="has 0 tables; allowed: 1 to 500 files"):
        read(folder, "empty")


def test_a_healthy_table_is_read_as_the_log_is(folder, capfd):
    """Take the tables of a healthy robot with the model of today's, on the command line."""
    table("{}_cmd", "{}_pos").to_csv(folder / "today.csv", index=False)
    long().to_csv(folder / "may.csv", index=False)
    words = ["diagnose", "--robot", str(folder / "arm.xml"), "--log", str(folder / "today.csv")]
    words += ["--out", str(folder / "out"), "--json", "--healthy"]
    assert cli.call([*words, str(folder / "may.csv")]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["ordinary_from"] == "healthy logs" and found["verdict"] == ["none"]
    again = ["diagnose", str(folder / "out" / "log"), "--out", str(folder / "two"), "--json"]
    assert cli.call([*again, "--healthy", str(folder / "may.csv")]) == 0
    assert json.loads(capfd.readouterr().out)["verdict"] == ["none"]
    assert cli.call([*words, str(folder / "june.csv"), "--force"]) == 2
    assert "no file" in capfd.readouterr().err


def test_a_name_with_a_star_that_the_shell_has_replaced(folder, capfd):
    """Say how several tables are given, where the second stands as LOG."""
    for name in ("a", "b"):
        table("{}_cmd", "{}_pos").to_csv(folder / f"{name}.csv", index=False)
    words = ["check", "--robot", str(folder / "arm.xml"), "--log", str(folder / "a.csv")]
    assert cli.call([*words, str(folder / "b.csv")]) == 2
    assert "say --log before each" in capfd.readouterr().err


def test_a_table_is_read_with_few_copies(tmp_path):
    """Hold the text of a table twice at most, beside its numbers."""
    file = tmp_path / "run.csv"
    values = np.random.default_rng(0).normal(size=(20_000, 5))
    np.savetxt(file, values, delimiter=",", header="t,a,b,c,d", comments="", fmt="%.7g")
    read_table(file)
    tracemalloc.start()
    try:
        read_table(file)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2 * file.stat().st_size + 1.5 * values.nbytes
