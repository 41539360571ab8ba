"""Recording: deterministic, whole, and changed by an effect only where it acts."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from backends.shard import simulate
from benchmark.cli import app as cli
from benchmark.console import Bar
from benchmark.errors import CommandError
from benchmark.parts import registry
from benchmark.settings.run_spec import RunSpec
from diagnosis.logs.log import Log, LogError, read_log, write_log
from diagnosis.recording.excitation import PROTOCOLS, hand_joints
from diagnosis.recording.record import CHANNELS, Plan, Policy, record
from tasks.batch import DROP_M, BatchEnv
from tasks.initial_states import sample_initial_states

ROOT = Path(__file__).resolve().parents[2]
OTHER_FINGERS = ("J0", "J1", "J6", "J7")
"""Joints that share no body with J3."""
KINDS = ("command", "position", "motor", "torque", "velocity", "push")


def circle_policy(spec) -> Policy:
    """A policy that keeps its targets' lead."""
    return Policy(
        task=registry.load("task", "circle")(),
        observation=registry.load("observation", "contact-centers")(spec.hand),
        act=lambda observation: np.zeros((len(observation), len(spec.hand.driven))),
    )


def take(protocol: str, effects: str = "none", backend: str = "mujoco", **plan: object) -> Log:
    """A log of protocols between commas, on one core."""
    engine = registry.load("backend", backend)
    spec = RunSpec(backend=backend, task="circle", effects=effects).world()
    settings = Plan(**{"protocols": tuple(protocol.split(",")), **plan})

    def start(specs):
        return simulate(engine, specs, 1)

    return record(start, spec, settings, "test", circle_policy(spec))


def same(a: pd.DataFrame, b: pd.DataFrame, columns: list[str]) -> bool:
    return all(np.array_equal(a[c].to_numpy(float), b[c].to_numpy(float)) for c in columns)


def joint_columns(log: Log, joints: tuple[str, ...], kinds: tuple[str, ...] = KINDS) -> list[str]:
    return [log.column(kind, joint) for kind in kinds for joint in joints]


@pytest.fixture(scope="module")
def everything() -> Log:
    """All protocols of the ideal hand."""
    return take(",".join(PROTOCOLS))


@pytest.mark.parametrize("number", range(len(PROTOCOLS)))
def test_every_protocol_is_whole(everything, number):
    """Write every channel without a gap, touch and stick where there is a stick."""
    frame = everything.episode(number)
    for kind in KINDS:
        assert np.isfinite(everything.signal(kind, number)).all()
    held = PROTOCOLS[number] in ("grasp", "pull", "policy")
    touch, stick = everything.touch(number), everything.stick(number)
    assert (touch is not None) == (stick is not None) == held
    assert (everything.pull(number) is not None) == held
    if held:
        assert touch.shape == (len(frame), 3, 128)
    if held and PROTOCOLS[number] != "pull":
        assert (touch[-1] > 0).any(axis=1).all()
        assert stick[-1, 2] > stick[0, 2] - DROP_M
    assert np.allclose(np.diff(frame["t_s"]), 0.005)
    assert (np.ptp(everything.signal("position", number), axis=0) > 0).all()


@pytest.mark.parametrize("number", range(len(PROTOCOLS)))
def test_a_protocol_is_the_same_alone(everything, number):
    """Give the same numbers whatever else is recorded beside it."""
    alone = take(PROTOCOLS[number])
    columns = joint_columns(alone, alone.joints)
    assert same(alone.samples, everything.episode(number), columns)


def test_rows_follow_the_convention(everything):
    """Start at rest in the centre; the first command shows in the next row and not before."""
    center = hand_joints(RunSpec(backend="mujoco", task="line").world().hand).center_rad
    command, position = (everything.signal(k, 0) for k in ("command", "position"))
    first = int(np.argmax((command != command[0]).any(axis=1)))
    assert (position[: first + 1] == center).all()
    assert (position[first + 1] != center).any()


@pytest.mark.parametrize(("form", "protocol"), [("parquet", "grasp"), ("csv", "steps")])
def test_a_seed_gives_the_same_file(tmp_path, form, protocol):
    """Write the same bytes for a seed, other ones for another."""
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        write_log(take(protocol, "encoder-noise=1mrad", seed=seed), tmp_path / name, form)
    a, b, c = ((tmp_path / n / f"samples.{form}").read_bytes() for n in "abc")
    assert a == b != c


@pytest.mark.parametrize(
    ("effects", "changed"),
    [
        ("encoder-bias=1deg@J3", ("position",)),
        ("encoder-noise=1mrad@J3", ("position",)),
        ("command-delay=20ms@J3", ("position", "motor", "torque", "velocity")),
        ("backlash=1.5deg@J3", ("position", "motor", "torque", "velocity")),
        ("kp-scale=-20%@J3", ("position", "motor", "torque", "velocity")),
    ],
)
def test_effects_change_what_they_should(everything, effects, changed):
    """Change the channels of the finger where the effect acts, and no other number."""
    log = take("steps", effects)
    plain = everything.episode(PROTOCOLS.index("steps"))
    assert same(log.samples, plain, joint_columns(log, OTHER_FINGERS))
    for kind in KINDS:
        column = joint_columns(log, ("J3",), (kind,))
        assert same(log.samples, plain, column) == (kind not in changed), kind


def test_skin_effects_change_touch_alone(everything):
    """Change no joint by a drift of the taxels."""
    log = take("grasp", "taxel-drift=0.05mm/s")
    number = PROTOCOLS.index("grasp")
    assert same(log.samples, everything.episode(number), joint_columns(log, log.joints))
    assert not np.array_equal(log.touch(0), everything.touch(number))


def test_a_known_push_moves_the_joint(everything):
    """Yield to a push by its torque over the stiffnesses of PD law and gear, within friction."""
    number = PROTOCOLS.index("push")
    command, position, push = (
        everything.signal(k, number) for k in ("command", "position", "push")
    )
    drives = RunSpec(backend="mujoco", task="line", effects="none").world().drives
    for j, drive in enumerate(drives):
        firm = np.abs(push[:, j]) == np.abs(push[:, j]).max()
        late = firm & np.roll(firm, 30)
        yields = 1 / drive.kp_nm_rad + 1 / drive.gear_stiffness_nm_rad
        friction = drive.coulomb_nm / drive.kp_nm_rad
        wanted = push[late, j] * yields
        assert late.any()
        assert np.abs(position[late, j] - command[late, j] - wanted).max() < 1.1 * friction


def test_the_log_keeps_the_effects_secret(tmp_path):
    """Write the same log.yaml whatever the effects are."""
    for name, effects in (("a", "none"), ("b", "backlash=2deg@J3,kp-scale=-10%")):
        write_log(take("steps", effects), tmp_path / name)
    assert (tmp_path / "a/log.yaml").read_text() == (tmp_path / "b/log.yaml").read_text()


def test_repeats_and_variants():
    """Repeat commands with other noise; vary them with the variant."""
    log = take("multisine", "encoder-noise=1mrad", variants=2, repeats=2)
    command = [log.signal("command", k) for k in range(4)]
    position = [log.signal("position", k) for k in range(4)]
    assert np.array_equal(command[0], command[1]) and np.array_equal(command[2], command[3])
    assert not np.array_equal(command[0], command[2])
    noise = (position[0] - position[1]) / np.sqrt(2)
    assert noise.std() == pytest.approx(1e-3, rel=5 / np.sqrt(noise.size))
    assert [e.note for e in log.episodes][1] == "variant 0, repeat 1"


def test_a_poor_robot_logs_less():
    """Write the channels that were asked for, touch as yes or no when so."""
    log = take("steps", channels=("command", "position", "torque"))
    kinds = {column.split("_")[0] for column in log.samples.columns.drop(["episode", "t_s"])}
    assert kinds == {"command", "position", "torque"}
    binary = take("grasp", channels=("command", "position", "contact"))
    assert set(np.unique(binary.touch(0))) == {0.0, 1.0}
    assert binary.meta.channels["touch"].unit == "1"
    assert binary.stick(0) is None


def test_the_policy_is_played_as_in_its_task():
    """Sample a policy at 200 Hz and find, at every policy step, the state of the 50 Hz task."""
    log = take("policy", seed=3)
    spec = RunSpec(backend="mujoco", task="circle", effects="none").world()
    policy = circle_policy(spec)
    env = BatchEnv(
        simulate(registry.load("backend", "mujoco"), [spec], 1), policy.task, policy.observation, 3
    )
    try:
        rng = np.random.default_rng([3, 0, 1])
        observation = env.reset(start=sample_initial_states([spec], rng))
        position, target = [env.state.joint_rad[0].copy()], []
        for _ in range(env.horizon):
            observation = env.step(policy.act(observation)).observation
            position.append(env.state.joint_rad[0].copy())
            target.append(env.target_rad[0].copy())
    finally:
        env.close()
    assert np.array_equal(log.signal("position", 0)[::4], position)
    assert np.array_equal(log.signal("command", 0)[:-1:4], target)


def test_a_fallen_stick_ends_the_episode(everything):
    """Cut an episode where the stick has fallen."""
    log = take("grasp", "contact-friction=-90%")
    stick = log.stick(0)
    assert len(stick) < len(everything.episode(PROTOCOLS.index("grasp")))
    assert (stick[:, 2] >= stick[0, 2] - DROP_M).all()


def test_a_pull_ends_where_the_stick_is_out(everything):
    """Hold the stick still, pull more and more, and end where it has left the grip."""
    number = PROTOCOLS.index("pull")
    force, stick = everything.pull(number), everything.stick(number)
    pulled = force > 0
    assert 200 <= np.argmax(pulled) < len(force) - 10
    assert (np.diff(force[pulled]) > 0).all()
    assert np.ptp(stick[~pulled][100:, 2]) < 1e-4
    assert 0.005 < stick[0, 2] - stick[-1, 2] <= DROP_M
    assert not everything.pull(PROTOCOLS.index("grasp")).any()


@pytest.mark.parametrize("backend", registry.names("backend"))
def test_every_engine_writes_the_same_columns(everything, backend):
    """Record the grasp in every engine, commanded alike."""
    try:
        log = take("grasp", backend=backend)
    except CommandError as error:
        pytest.skip(str(error))
    number = PROTOCOLS.index("grasp")
    assert list(log.samples.columns) == list(everything.samples.columns)
    assert np.array_equal(log.signal("command", 0), everything.signal("command", number))
    assert np.isfinite(log.signal("position", 0)).all()


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        ({"protocols": ("jump",)}, "no protocol named 'jump'; known: steps"),
        ({"protocols": ()}, "no protocol is given"),
        ({"protocols": ("steps", "steps")}, "given twice"),
        ({"channels": ("command",)}, "every log needs position"),
        ({"channels": (*CHANNELS, "sound")}, "no channel named 'sound'"),
        ({"channels": (*CHANNELS, "contact")}, "two forms of one channel"),
        (
            {"protocols": ("push",), "channels": ("command", "position")},
            "'push' needs the channel 'push'; add it to the channels",
        ),
        ({"rate_hz": 300.0}, "the rate is 300 Hz; allowed: 50 to 1000 Hz"),
        ({"rate_hz": 20.0}, "the rate is 20 Hz"),
        ({"rate_hz": 2000.0}, "the rate is 2000 Hz"),
        ({"protocols": ("policy",), "rate_hz": 125.0}, "whole number of samples in 20 ms"),
    ],
)
def test_what_cannot_be_recorded_is_refused(plan, words):
    """Say what was given and what is allowed."""
    with pytest.raises(LogError, match=words):
        take("steps", **plan)


RECORD = ["record", "--backend", "mujoco", "--workers", "1"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--protocol", "jump"], "no protocol named 'jump'"),
        (["--protocol", "policy"], "needs a policy"),
        (["--effects", "backlsh=1deg"], "Did you mean 'backlash'?"),
        (["--known-effects", "backlash=99deg"], "out of range"),
        (["--rate", "nanHz"], "--rate is nan"),
        (["--rate", "300Hz"], "the rate is 300 Hz"),
        (["--seed", "-1"], "--seed is '-1'"),
        (["--repeats", "0"], "--repeats"),
        (["--channels", "sound"], "no channel named 'sound'"),
        (["--format", "xls"], "no form of samples 'xls'; known: parquet, csv"),
        (["--policy", "absent"], "no run folder at absent"),
        (["--stick", "wood"], "known: fabric, reference"),
    ],
)
def test_bad_usage_exits_2_and_writes_nothing(tmp_path, capfd, arguments, words):
    """Refuse before anything is simulated, without a traceback."""
    out = tmp_path / "log"
    assert cli.call([*RECORD, "--out", str(out), *arguments]) == 2
    said = capfd.readouterr()
    assert words in said.err and "Traceback" not in said.err
    assert said.out == "" and not list(tmp_path.iterdir())


def test_record_writes_a_log_and_one_json_object(tmp_path, capfd):
    """Record with a run's policy, say what was recorded, keep the effects in the provenance."""
    run = tmp_path / "run"
    train = ["run", "--backend", "mujoco", "--task", "eight", "--algo", "hold-still", "--smoke"]
    assert cli.call([*train, "--workers", "1", "--out", str(run)]) == 0
    capfd.readouterr()
    out = tmp_path / "log"
    asked = ["--protocol", "push,policy", "--policy", str(run), "--effects", "backlash=1deg@J3"]
    assert cli.call([*RECORD, *asked, "--out", str(out), "--json"]) == 0
    result = json.loads(capfd.readouterr().out)
    assert result["status"] == "done" and result["protocols"] == ["push", "policy"]
    log = read_log(out)
    assert len(log.samples) == result["samples"] and log.warnings == ()
    assert [e.protocol for e in log.episodes] == ["push", "policy"]
    assert "backlash" not in (out / "log.yaml").read_text()
    assert json.loads((out / "provenance.json").read_text())["effects"] == "backlash=1deg@J3"
    assert cli.call([*RECORD, "--out", str(out)]) == 2
    assert "exists; choose another" in capfd.readouterr().err


def test_a_stopped_recording_leaves_no_log(tmp_path, monkeypatch):
    """Leave no folder behind when stopped on the way, and exit with 130."""

    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Bar, "update", stopped)
    assert cli.call([*RECORD, "--protocol", "steps", "--out", str(tmp_path / "log")]) == 130
    assert not list(tmp_path.iterdir())
