"""Healthy logs on the command line: what they say is ordinary, and which are refused."""

import json

from diagnosis_logs import arm_log, hand_log

from benchmark.cli import app as cli
from diagnosis.logs.log import write_log


def test_healthy_logs_say_what_is_ordinary(tmp_path, capfd):
    """Judge by what the healthy robot leaves, and say so in JSON and in the report."""
    fine, today = tmp_path / "fine", tmp_path / "today"
    write_log(arm_log("none"), fine, "csv")
    write_log(arm_log("coulomb-friction=100mNm@elbow"), today, "csv")
    words = ["diagnose", str(today), "--healthy", str(fine), "--out", str(tmp_path / "out")]
    assert cli.call([*words, "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["coulomb-friction"] and f"--healthy {fine}" in found["log"]
    assert found["healthy"] == [str(fine)] and found["ordinary_from"] == "healthy logs"
    assert found["ordinary"] < 3.0
    assert (
        "healthy logs of this robot leave up to" in (tmp_path / "out" / "report.html").read_text()
    )


def test_a_healthy_log_that_is_not_is_doubted(tmp_path, capfd):
    """Warn of a log that leaves far more than another of the same healthy robot."""
    logs = {"today": "none", "fine": "none", "worn": "coulomb-friction=100mNm@elbow"}
    for name, effects in logs.items():
        write_log(arm_log(effects), tmp_path / name, "csv")
    today, *healthy = (str(tmp_path / name) for name in logs)
    beside = [word for path in healthy for word in ("--healthy", path)]
    words = ["diagnose", today, *beside, "--out", str(tmp_path / "out"), "--json"]
    assert cli.call(words) == 0
    (note,) = [n for n in json.loads(capfd.readouterr().out)["notes"] if "healthy" in n]
    assert note.startswith("healthy log 2 of 2 leaves") and "leave it out" in note


def test_healthy_logs_that_cannot_be_compared_are_refused(tmp_path, capfd):
    """Say in one line why a log is no measure: itself, of other joints, or moved otherwise."""
    log, short, hand = tmp_path / "log", tmp_path / "short", tmp_path / "hand"
    write_log(arm_log("none"), log, "csv")
    write_log(arm_log("none", ("steps",)), short, "csv")
    hand_log(hand, "none", "steps")
    capfd.readouterr()
    for other, said in (
        (log, "is the log that is diagnosed"),
        (short, "lacks the protocols multisine of the log that is diagnosed"),
        (hand, "has the joints J0, J1, J3, J4, J6, J7, and the log that is diagnosed has shoulder"),
        (tmp_path / "none", "no log"),
    ):
        assert cli.call(["diagnose", str(log), "--healthy", str(other)]) == 2
        err = " ".join(capfd.readouterr().err.split())
        assert said in err and "Traceback" not in err
