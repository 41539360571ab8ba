"""Bug or physics: every bug put into a recorded log is named, and no effect is taken for one."""

import dataclasses
from collections.abc import Callable, Iterator

import arms
import numpy as np
import pytest
from arms import STILL_RAD, Real, log_of
from diagnosis_logs import faults
from pandas import DataFrame as Samples

from backends import sticks, trx
from backends.shard import simulate
from benchmark.parts import registry
from benchmark.settings.effects import parse_effects
from diagnosis.logs.log import Log, make_log
from diagnosis.motion.recordings import Recording
from diagnosis.recording.record import Plan, record
from diagnosis.replay.nominal import mjcf_world
from diagnosis.triage._lines import ZERO_RAD
from diagnosis.triage._signals import line
from diagnosis.triage._tracks import Fault, _converted
from diagnosis.triage.triage import KINDS, FaultError
from diagnosis.walk import diagnose

SPEC = trx.spec(sticks.STICKS["reference"])
PLAN = Plan(
    protocols=("steps", "triangle", "multisine", "push"),
    channels=("command", "position", "motor", "torque", "push"),
)
SHORT = dataclasses.replace(PLAN, protocols=("steps", "push"))
NOISE_RAD = 7e-4

Change = Callable[[Samples], None]


def recorded(effects: str, plan: Plan = PLAN) -> Log:
    world = SPEC
    for effect in parse_effects(effects, SPEC.hand):
        world = effect.on_spec(world)
    engine = registry.load("backend", "mujoco")
    return record(lambda specs: simulate(engine, specs, 1), world, plan, "test")


@pytest.fixture(scope="module")
def ideal() -> Log:
    return recorded("none", SHORT)


@pytest.fixture(scope="module")
def built() -> Log:
    """The hand with the play and the locks that the nominal world does not have."""
    return recorded("built", SHORT)


def changed(log: Log, change: Change) -> Log:
    samples = log.samples.copy()
    change(samples)
    return make_log(log.meta.model_copy(update={"channels": {}}), samples, log.mjcf_xml)


def found(log: Log) -> tuple[Fault, ...]:
    return faults(log, SPEC)


def swapped(one: str, other: str) -> Change:
    def change(samples: Samples) -> None:
        samples[[one, other]] = samples[[other, one]].to_numpy()

    return change


def times(column: str, factor: float) -> Change:
    def change(samples: Samples) -> None:
        samples[column] *= factor

    return change


def plus(column: str, amount: float) -> Change:
    def change(samples: Samples) -> None:
        samples[column] += amount

    return change


def all_in_degrees(samples: Samples) -> None:
    for column in [c for c in samples if c.startswith(("command", "position"))]:
        samples[column] *= 180 / np.pi


def by_episode(samples: Samples) -> Iterator[Samples]:
    for _, part in samples.groupby("episode"):
        yield part


def changes_of_target(samples: Samples) -> None:
    for part in by_episode(samples):
        start = part["position_rad.J4"].iloc[0]
        steps = np.diff(part["command_rad.J4"], prepend=start)
        samples.loc[part.index, "command_rad.J4"] = steps


def wrapped(samples: Samples) -> None:
    """An absolute encoder whose range ends within the motion."""
    samples["position_rad.J4"] = (samples["position_rad.J4"] + 2 + np.pi) % (2 * np.pi) - np.pi


def clocked(late_s: float = 0.0, rate: float = 1.0) -> Change:
    """Positions on another clock than commands."""

    def change(samples: Samples) -> None:
        for part in by_episode(samples):
            t = part["t_s"].to_numpy()
            for column in [c for c in samples if c.startswith("position")]:
                values = np.interp(t * rate - late_s, t, part[column])
                samples.loc[part.index, column] = values

    return change


def stamped(factor: float) -> Change:
    return times("t_s", factor)


BUGS: dict[str, tuple[Change, str, tuple[str, ...], str]] = {
    "position dead": (
        lambda samples: samples.__setitem__("position_rad.J1", 0.1),
        "sensor",
        ("J1",),
        "reads 0.1 rad throughout",
    ),
    "positions swapped": (
        swapped("position_rad.J1", "position_rad.J4"),
        "order",
        ("J1", "J4"),
        "J1 that of J4",
    ),
    "commands swapped": (
        swapped("command_rad.J0", "command_rad.J1"),
        "order",
        ("J0", "J1"),
        "J0 that of J1",
    ),
    "position turned": (times("position_rad.J1", -1), "sign", ("J1",), "times as far"),
    "command turned": (times("command_rad.J3", -1), "sign", ("J3",), "times as far"),
    "motor turned": (times("motor_rad.J1", -1), "sign", ("J1",), "the column 'motor'"),
    "push in Nmm": (times("push_nm.J1", 1e3), "unit", ("J1",), "they are in Nmm"),
    "push turned": (times("push_nm.J1", -1), "sign", ("J1",), "against its pushes"),
    "position in degrees": (
        times("position_rad.J0", 180 / np.pi),
        "unit",
        ("J0",),
        "the position is in degrees",
    ),
    "command in degrees": (
        times("command_rad.J0", 180 / np.pi),
        "unit",
        ("J0",),
        "the command is in degrees",
    ),
    "position in turns": (
        times("position_rad.J4", 1 / (2 * np.pi)),
        "unit",
        ("J4",),
        "the position is in turns",
    ),
    "position in counts": (
        times("position_rad.J0", 4096 / (2 * np.pi)),
        "unit",
        ("J0",),
        "counts of 4096 per turn",
    ),
    "both in degrees": (all_in_degrees, "unit", SPEC.hand.joint_names, "both are in degrees"),
    "zero a quarter turn off": (plus("position_rad.J0", np.pi / 2), "zero", ("J0",), "off by 90.0"),
    "zero half a turn off": (plus("position_rad.J4", np.pi), "zero", ("J4",), "off by 180.0"),
    "zero 20 degrees off": (plus("position_rad.J3", -np.radians(20)), "zero", ("J3",), "-20.0"),
    "sensor wraps": (wrapped, "zero", ("J4",), "by up to 360 degrees in a sample"),
    "changes for targets": (changes_of_target, "convention", ("J4",), "sum of the commands"),
    "logged too late": (clocked(-0.06), "clock", SPEC.hand.joint_names, "ahead of its command"),
    "on a late clock": (clocked(0.8), "clock", SPEC.hand.joint_names, "0.80 s later"),
    "on a slow clock": (clocked(rate=0.99), "clock", SPEC.hand.joint_names, "% too slow"),
    "half the rate": (stamped(2.0), "clock", SPEC.hand.joint_names, "2 times too long"),
    "double the rate": (stamped(0.5), "clock", SPEC.hand.joint_names, "2 times too short"),
}


@pytest.mark.parametrize("name", BUGS)
def test_bugs_are_named(ideal, name):
    """Name the kind and the joints of every bug, with what shows it."""
    change, kind, joints, words = BUGS[name]
    findings = found(changed(ideal, change))
    assert {f.kind for f in findings} == {kind}
    assert tuple(j for f in findings for j in f.joints) == joints
    assert words in findings[0].evidence + findings[0].remedy


@pytest.mark.parametrize(
    "name",
    [
        "positions swapped",
        "command turned",
        "command in degrees",
        "zero a quarter turn off",
        "changes for targets",
        "on a late clock",
        "half the rate",
    ],
)
def test_bugs_are_named_beside_physics(built, name):
    """Name the kind also where the mechanism has play and locks that nobody stated."""
    change, kind, joints, _ = BUGS[name]
    findings = found(changed(built, change))
    assert {f.kind for f in findings} == {kind}
    assert set(joints) >= {j for f in findings for j in f.joints}


def test_every_kind_is_tested():
    """Have a bug of every kind."""
    assert {kind for _, kind, _, _ in BUGS.values()} == set(KINDS)


def test_targets_relative_to_their_starts_are_named():
    """Know relative targets by episodes that start at several places, each with a command of 0."""
    whole = recorded("none")

    def change(samples: Samples) -> None:
        for number, part in enumerate(by_episode(samples)):
            for column in ("command_rad.J4", "position_rad.J4"):
                samples.loc[part.index, column] += 0.1 * number
            start = part["position_rad.J4"].iloc[0] + 0.1 * number
            samples.loc[part.index, "command_rad.J4"] -= start

    (finding,) = found(changed(whole, change))
    assert (finding.kind, finding.joints) == ("convention", ("J4",))
    assert "add the first position" in finding.remedy


def test_relative_targets_from_one_start_are_a_zero_that_is_off(ideal):
    """Say both where one cannot tell them apart: every episode starts at the same place."""

    def change(samples: Samples) -> None:
        samples["command_rad.J4"] -= samples["position_rad.J4"].iloc[0]

    (finding,) = found(changed(ideal, change))
    assert (finding.kind, finding.joints) == ("zero", ("J4",))
    assert "commands start at 0" in finding.evidence and "add the start" in finding.remedy


def noisy(log: Log) -> Log:
    """The log with noise on its position sensors."""
    rng, samples = np.random.default_rng(0), log.samples.copy()
    columns = [name for name in samples if name.startswith("position")]
    samples[columns] += NOISE_RAD * rng.normal(size=(len(samples), len(columns)))
    return make_log(log.meta, samples)


EFFECTS = (
    "none",
    "backlash=5deg@J0,self-lock=10Nm@J0",
    "command-delay=150ms@J0,sensor-delay=50ms@J4",
    "encoder-bias=12deg@J1,encoder-bias=-5deg@J0",
    "encoder-scale=-40%,encoder-resolution=1deg",
    "gravity-tilt=60deg,link-mass=500%",
    "kp-scale=-70%@J0,kp-scale=200%@J3,kd-scale=-80%@J6",
    "viscous-friction=0.14Nms",
)
MORE_EFFECTS = (
    "command-rate-limit=5s/rad@J1,command-rate-limit=1s/rad@J3",
    "coulomb-friction=0.5Nm@J0,stiction=0.3Nm@J3",
    "dead-zone=5deg@J0,series-elasticity=-50%@J3",
    "kd-scale=100%",
    "load-friction=80%@J0,rotor-inertia=0.002kgm2@J3",
    "torque-limit=-80%@J1",
)
"""Far more than a working mechanism has of each."""


@pytest.mark.parametrize(
    "effects", [*EFFECTS, *(pytest.param(text, marks=pytest.mark.slow) for text in MORE_EFFECTS)]
)
def test_effects_are_no_bugs(effects):
    """Find no bug in what physics alone does, however large."""
    assert found(noisy(recorded(effects, SHORT))) == ()


def test_the_hand_as_built_has_no_bugs():
    """Find no bug in the play and the locks of the hand on an engine."""
    assert found(recorded("built")) == ()


@pytest.mark.parametrize(("share", "kinds"), [(0.8, set()), (1.3, {"zero"})])
def test_the_border_between_bias_and_zero(ideal, share, kinds):
    """Take offsets up to 15 degrees for a sensor's bias, and larger ones for a wrong zero."""
    log = changed(ideal, plus("position_rad.J6", share * ZERO_RAD))
    assert {f.kind for f in found(log)} == kinds


def test_a_bug_stops_the_diagnosis(ideal):
    """Report the bug in place of a cause."""
    catalogue = {"kp-scale": registry.load("effect", "kp-scale")}
    with pytest.raises(FaultError, match="the data of this log is faulty: sign of J1") as raised:
        diagnose(changed(ideal, times("position_rad.J1", -1)), nominal=SPEC, catalogue=catalogue)
    assert raised.value.faults[0].kind == "sign"


def test_another_unit_is_found_on_a_part_of_a_long_log(monkeypatch):
    """Name degrees on both sides of an arm in a log of over a minute."""
    monkeypatch.setattr(arms, "SECONDS", 24.0)
    long = log_of(Real(joints=2, kp={0: 0.8}))

    def in_degrees(samples: Samples) -> None:
        columns = [name for name in samples.columns if "_rad." in name]
        samples[columns] = np.degrees(samples[columns])

    (finding,) = faults(changed(long, in_degrees), mjcf_world(long))
    assert (finding.kind, finding.joints) == ("unit", ("J0", "J1"))
    assert "degrees" in finding.evidence


def test_joints_that_move_alike_are_not_swapped(ideal):
    """Leave the order alone where two joints are commanded alike: nothing can tell them apart."""

    def alike(samples: Samples) -> None:
        for kind in ("command_rad", "position_rad"):
            for joint in ("J3", "J6"):
                samples[f"{kind}.{joint}"] = samples[f"{kind}.J0"]

    assert found(changed(ideal, alike)) == ()


def test_a_joint_that_friction_holds_says_nothing_of_gravity(monkeypatch):
    """Take a pose once, however often other joints move: friction may hold what gravity would not.

    The joint stands where it was put, so it seems to have another zero.
    """
    text, upright = arms.mjcf, ('name="J0" axis="0 1 0"', 'name="J0" axis="0 0 1"')
    monkeypatch.setattr(arms, "SECONDS", 8.0)
    monkeypatch.setattr(arms, "mjcf", lambda *given, **more: text(*given, **more).replace(*upright))
    log = log_of(Real(joints=2, coulomb_nm={1: 40.0}, still=(1,)))
    log = changed(log, plus("position_rad.J1", 0.004))
    assert faults(log, mjcf_world(log)) == ()


def test_a_joint_that_friction_holds_at_its_target_has_no_dead_sensor():
    """Call a reading dead that stays while its own commands move, not while other joints pull."""
    held = {1: 40.0}
    for still, kinds in (((1,), []), ((), ["sensor"])):
        log = log_of(Real(joints=2, coulomb_nm=held, still=still))
        log = changed(log, lambda samples: samples.__setitem__("position_rad.J1", STILL_RAD))
        assert [fault.kind for fault in faults(log, mjcf_world(log))] == kinds


@pytest.mark.filterwarnings("error:All-NaN")
def test_a_replay_that_diverges_accuses_no_zero(monkeypatch):
    """Say nothing of zeros where six links fall under drives that are too weak to replay."""
    monkeypatch.setattr(arms, "SECONDS", 40 / 3)
    monkeypatch.setattr(arms, "HZ", 100)
    log = log_of(Real(joints=6, coulomb_nm={2: 1.5}))
    assert "nan" not in " ".join(map(str, faults(log, mjcf_world(log))))


def test_joints_that_stand_still_have_no_bugs(ideal):
    """Say nothing of joints that are not moved."""

    def still(samples: Samples) -> None:
        for joint in SPEC.hand.joint_names:
            for kind in ("command_rad", "position_rad"):
                samples[f"{kind}.{joint}"] = samples[f"{kind}.{joint}"].iloc[0]
            samples[f"push_nm.{joint}"] = 0.0

    assert found(changed(ideal, still)) == ()


def test_another_pace_is_another_pace_of_all_that_is_asked():
    """Convert targets and their speeds, and when they act, as times and units are multiplied."""
    still = np.zeros((3, 1))
    logged = Recording(
        protocol="steps",
        time_s=np.arange(3.0),
        command=np.full((3, 1), 90.0),
        push=still,
        measured=np.zeros((3, 3, 1)),
        start=np.zeros(1),
        speed=np.full((3, 1), 180.0),
        sent_s=np.arange(3.0) + 0.5,
    )
    paced = _converted(logged, 2.0, np.array([90.0]))
    assert (paced.command == 1.0).all() and (paced.speed == 1.0).all()
    assert paced.sent_s == pytest.approx([1.0, 3.0, 5.0])


def test_lines_are_about_the_means_of_episodes():
    """Take slope and correlation about means; none where one stands still, or of other pieces."""
    rng = np.random.default_rng(0)
    cause = [rng.normal(size=50), rng.normal(size=30)]
    effect = [5.0 - 2.0 * cause[0], 9.0 - 2.0 * cause[1]]
    assert line(cause, effect).slope == pytest.approx(-2.0)
    assert line(cause, effect).correlation == pytest.approx(-1.0)
    still, lost = [np.ones(50), np.ones(30)], [cause[0], np.full(30, np.nan)]
    none = [(still, effect), (cause, still), (lost, effect), (cause, lost)]
    other = [cause[0][:40], cause[1]]
    for pair in (*none, (other, effect), (cause[:1], effect)):
        assert line(*pair).correlation == 0.0
