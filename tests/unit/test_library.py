"""The diagnosis as a library: a few names, plain data, and a report from that data."""

import json

import pytest
from arms import Real, log_of

import diagnosis
from diagnosis import Cause, Diagnosis, LogError, Stop, diagnose, page, read_log, solver


@pytest.fixture(scope="module")
def log():
    """A log of an arm with a weak drive."""
    return log_of(Real(joints=2, kp={1: 0.6}))


@pytest.fixture(scope="module")
def found(log) -> Diagnosis:
    return diagnose(log)


def test_every_name_is_there():
    """Give everything that the package promises, and nothing else."""
    for name in diagnosis.__all__:
        assert getattr(diagnosis, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'diagnos'"):
        diagnosis.diagnos  # noqa: B018


def test_a_cause_has_a_size_and_a_place(found):
    """Name the gain and its joint, with the truth in the interval."""
    (cause,) = found.magnitudes
    assert isinstance(cause, Cause) and (cause.effect, cause.joint) == ("kp-scale", "J1")
    assert cause.low < -40.0 < cause.high
    assert found.verdict == ("kp-scale",) and found.joints == ("J1",)
    assert found.gaps.after.value < found.gaps.nominal.value <= found.gaps.before.value
    assert 0.0 < found.probability < 1.0


@pytest.mark.parametrize(
    ("at", "known"), [("fit of kp-scale on J1", False), ("what is left", True)]
)
def test_what_is_known_is_kept_where_it_is_stopped(log, at, known):
    """Say that it was stopped, with the fits so far, and name what was found by then."""

    def progress(text: str, share: float) -> None:
        if text.startswith(at):
            raise Stop

    found = diagnose(log, progress=progress)
    assert found.stopped and found.sentences[0].startswith("Stopped before its end")
    assert found.verdict == (("kp-scale",) if known else ("unknown",))
    assert Diagnosis.of(json.loads(json.dumps(found.plain()))) == found and page(found, log)


def test_a_stopped_search_on_a_part_of_a_log_is_kept(log, monkeypatch):
    """Say what the part says, where a log is longer than a search needs."""
    monkeypatch.setattr(solver, "SEARCHED_S", 12.0)

    def progress(text: str, share: float) -> None:
        if "whole log" in text:
            raise Stop

    found = diagnose(log, progress=progress)
    assert found.stopped and found.verdict == ("kp-scale",)
    assert page(found, log)


def test_two_files_are_a_log(log, tmp_path):
    """Read a robot's model and its table as the log that they are."""
    (tmp_path / "arm.xml").write_text(log.mjcf_xml)
    log.samples.to_csv(tmp_path / "run.csv", index=False)
    again = read_log(tmp_path / "run.csv", robot=tmp_path / "arm.xml")
    assert again.joints == log.joints and len(again.samples) == len(log.samples)
    with pytest.raises(LogError, match="with a table its robot's model"):
        read_log(tmp_path / "run.csv")


def test_there_is_nothing_to_keep_at_first(log):
    """Pass Stop on where nothing has been fitted."""

    def progress(text: str, share: float) -> None:
        raise Stop

    with pytest.raises(Stop):
        diagnose(log, progress=progress)


def test_a_diagnosis_is_printed_without_its_samples(found):
    """Say no samples where it is printed."""
    assert len(repr(found)) < 10_000


def test_a_diagnosis_goes_to_json_and_back(found):
    """Be equal to what was read again, which has all that the format promises."""
    text = json.dumps(found.plain(), allow_nan=False)
    data = json.loads(text)
    assert Diagnosis.of(data) == found
    promised = {"verdict", "joints", "magnitudes", "confidence", "ranking", "indistinguishable"}
    promised |= {"where", "gap_before", "gap_after", "noise_floor", "shrinkage", "cpu_s"}
    promised |= {"probability", "share", "left", "ordinary", "ordinary_from"}
    assert promised <= data.keys()
    low, high = data["magnitudes"][0]["interval"]
    assert low < data["magnitudes"][0]["value"] < high
    low, high = data["shrinkage"]["interval"]
    assert low <= data["shrinkage"]["value"] <= high


def test_the_report_is_made_from_plain_data(found, log):
    """Make the same page again from JSON and the log, but for the names of its figures."""

    def text(one: Diagnosis) -> str:
        whole = page(one, log, {"log": "arm"})
        return whole.split("<h2>Measured and simulated</h2>")[0]

    assert text(Diagnosis.of(json.loads(json.dumps(found.plain())))) == text(found)


def test_progress_is_shown(log):
    """Say what is being done, from nothing to all of it."""
    said: list[tuple[str, float]] = []
    diagnose(log, progress=lambda text, share: said.append((text, share)))
    shares = [share for _, share in said]
    assert shares == sorted(shares) and shares[0] < 0.5 and shares[-1] == pytest.approx(1.0)
    assert all(text for text, _ in said)


def test_what_is_no_log_is_said(tmp_path):
    """Raise a LogError that says why."""
    with pytest.raises(LogError, match="no log"):
        read_log(tmp_path / "absent")


def test_a_notebook_shows_it(found):
    """Show the sentences, the shares and every size with its interval, as whole HTML."""
    shown = found._repr_html_()
    assert all(text in shown for text in ("kp-scale", "J1", "90 % interval", "Of the gap"))
    for tag in ("div", "p", "b"):
        assert shown.count(f"<{tag}>") + shown.count(f"<{tag} ") == shown.count(f"</{tag}>")
