"""What was made fast stays the same to the last bit, and `bench speed` measures what it says."""

import dataclasses
import itertools
import json
import subprocess
import sys

import numpy as np
import pytest

from backends import drive, kinematics, sticks, trx
from backends.drive import DriveBank
from backends.engine import Engine
from backends.shard import simulate
from backends.spec import Drive, Spec
from backends.state import State
from benchmark.cli import app as cli
from benchmark.errors import CommandError
from benchmark.parts import registry
from benchmark.runs.train import training_worlds
from benchmark.settings.run_spec import RunSpec
from benchmark.speed import _stopwatch, speed
from tasks.initial_states import sample_initial_states

SIGNALS = tuple(f.name for f in dataclasses.fields(State))
ONE_WITH_PROCESSES = [
    pytest.param(name, marks=() if name == "bullet" else pytest.mark.slow)
    for name in registry.names("backend")
]
"""Of engines that take two processes for two cores, one is quick."""
HEADLINE = (
    "backend",
    "envs",
    "processes",
    "env_steps_per_s",
    "physics_steps_per_s",
    "raw_physics_steps_per_s",
    "overhead",
)


@pytest.fixture(params=registry.names("backend"))
def engine(request: pytest.FixtureRequest) -> type[Engine]:
    """Every engine that is installed."""
    try:
        return registry.load("backend", request.param)
    except CommandError as error:
        pytest.skip(str(error))


def drawn(worlds: int) -> list[Spec]:
    """Worlds as training draws them."""
    return training_worlds(RunSpec(backend="mujoco", task="line", worlds=worlds), 0)


def play(sim, periods: int, load: bool = False) -> list[np.ndarray]:
    """All signals of all states under restless targets."""
    specs = list(sim.specs)
    start = sample_initial_states(specs, np.random.default_rng(0))
    sim.reset(start, np.ones(len(specs), dtype=bool))
    target = start.joint_rad + np.array([s.hand.preload_rad for s in specs])
    rng, seen = np.random.default_rng(1), []
    for _ in range(periods):
        jerk = rng.uniform(-0.03, 0.03, target.shape)
        state = sim.advance(target + jerk, np.zeros_like(target) if load else None)
        seen += [getattr(state, name).copy() for name in SIGNALS]
    sim.close()
    return seen


def same(a: list[np.ndarray], b: list[np.ndarray]) -> bool:
    """Whether two plays are equal to the last bit."""
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_compiled_drives_equal_plain_ones(engine: type[Engine]) -> None:
    """Give with drives between compiled steps what they give in Python, over several teams."""
    specs = drawn(11)
    plain = play(engine(specs), 9, load=True)
    assert same(play(engine(specs), 9), plain)


def follow(sim, bare) -> None:
    """Hold the bare engine to the joints of restless worlds, some of which begin anew.

    A period is driven tick by tick, as under loads.
    """
    specs = list(sim.specs)
    start = sample_initial_states(specs, np.random.default_rng(0))
    target = start.joint_rad + np.array([s.hand.preload_rad for s in specs])
    rng = np.random.default_rng(1)
    for period in range(9):
        if period in (0, 7):
            anew = np.arange(len(specs)) % 3 <= (2 if period == 0 else 1)
            sim.reset(start, anew)
            bare.reset(start, anew)
        load = np.zeros_like(target) if period == 3 else None
        before = sim.state.joint_rad.copy()
        sim.advance(target + rng.uniform(-0.03, 0.03, target.shape), load)
        bare.rollout(sim.applied_nm)
        assert np.array_equal(bare.state.joint_rad, sim.state.joint_rad)
        assert np.array_equal(bare.state.joint_rad_s, sim.state.joint_rad_s)
        assert (sim.state.joint_rad != before).any(axis=1).all()
    sim.close()
    bare.close()


def test_the_bare_engine_takes_the_same_steps(engine: type[Engine]) -> None:
    """End to the last bit where the drives end, under the torques that they applied."""
    specs = drawn(9)
    follow(engine(specs), engine(specs))


@pytest.mark.parametrize("name", ONE_WITH_PROCESSES)
def test_the_bare_engine_takes_them_on_two_cores(name: str) -> None:
    """Follow worlds that two cores share."""
    engine, specs = registry.load("backend", name), drawn(9)
    follow(simulate(engine, specs, 2), simulate(engine, specs, 2))


@pytest.mark.parametrize(
    "left_out", [(), (*(drive.COLUMNS[k] for k in drive.EXTRAS), "end_stop_rad")]
)
def test_many_drives_at_a_time_equal_one_by_one(left_out: tuple[str, ...]) -> None:
    """Turn rotors as `motor_tick` turns each: with the whole law, and where the short one does."""
    rng = np.random.default_rng(0)
    own = {f.name: 0.02 for f in dataclasses.fields(Drive) if f.name not in left_out}
    spec = trx.spec(sticks.STICKS["reference"])
    law = [Drive(**{k: v * rng.uniform(0.5, 2) for k, v in own.items()}) for _ in spec.drives]
    spec = spec.with_drives(law)
    bank, table = DriveBank([spec] * 3), np.array([drive.drive_table(spec)] * 3)
    assert bank.is_long == (not left_out)
    motor, motor_speed, pd = np.zeros((3, 3, len(law)))
    for _ in range(200):
        target, joint, speed_ = rng.normal(0, 0.05, (3, 3, len(law)))
        torque = bank.step(target, joint, speed_)
        for n, j in np.ndindex(motor.shape):
            motor[n, j], motor_speed[n, j], pd[n, j], gear = drive.motor_tick(
                target[n, j],
                joint[n, j],
                speed_[n, j],
                motor[n, j],
                motor_speed[n, j],
                pd[n, j],
                table[n, j],
                spec.timing.drive_s,
            )
            assert (pd[n, j], gear) == (bank.pd_nm[n, j], torque[n, j])
        assert np.array_equal(bank.motor_rad, motor)
        assert np.array_equal(bank.motor_rad_s, motor_speed)
    assert np.abs(torque).max() > 0


def test_compiled_frames_equal_plain_ones() -> None:
    """Walk to the fingertips as plain kinematics do, within the rounding of a chain's products."""
    hand = trx.spec(sticks.STICKS["reference"]).hand
    joint_rad = np.random.default_rng(0).uniform(-2, 2, (50, 6))
    chain, (origin, rotation) = kinematics.tip_chain(hand), kinematics.tip_frames(hand, joint_rad)
    at, turn = kinematics.room(chain)
    for n, angles in enumerate(joint_rad):
        walked = np.empty_like(origin[n]), np.empty_like(rotation[n])
        kinematics.tips_placed(angles, chain, at, turn, *walked)
        for left, right in zip(walked, (origin[n], rotation[n]), strict=True):
            assert left == pytest.approx(right, abs=20 * np.finfo(float).eps)


def test_restart_observes_the_others_as_they_are() -> None:
    """Return after a masked reset what reading every world anew returns."""
    run = RunSpec(backend="mujoco", task="circle", worlds=5, observation="raw-taxels")
    env = run.make_env(training_worlds(run, 0), 0, 1)
    env.reset()
    rng = np.random.default_rng(0)
    for _ in range(12):
        env.step(rng.uniform(-1, 1, (5, env.action_width)))
    observed = env.reset(np.arange(5) == 2)
    assert np.array_equal(observed, env._observe(env.state, env.reference()[1]))
    assert np.ptp(observed[np.arange(5) != 2], axis=0).any()
    env.close()


def test_state_bits_are_those_of_the_engine() -> None:
    """Name the parts of a state as the engine that calls back does."""
    mujoco = pytest.importorskip("mujoco")
    from backends import _mujoco_drive as called

    parts = {"QPOS": called.QPOS, "QVEL": called.QVEL, "USERDATA": called.USER}
    parts["QFRC_APPLIED"] = called.APPLIED
    for name, bit in parts.items():
        assert bit == getattr(mujoco.mjtState, f"mjSTATE_{name}").value


@pytest.mark.parametrize("name", ONE_WITH_PROCESSES)
def test_two_cores_need_no_guarded_script(name: str, tmp_path) -> None:
    """Start processes from a script without a main guard, and run the script once."""
    script = tmp_path / "script.py"
    script.write_text(
        "from benchmark.settings.run_spec import RunSpec\n"
        f"run = RunSpec(backend='{name}', task='line', worlds=2)\n"
        "env = run.make_env([run.world()] * 2, 0, 2)\n"
        "print(len(env.reset())); env.close()\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert done.stdout == "2\n"


def test_compiled_reading_is_sapiens_own() -> None:
    """Find the hand that SAPIEN's own calls read, in worlds that were built anew too."""
    pytest.importorskip("sapien")
    from backends.sapien import Backend

    sim = Backend(drawn(2))
    start = sample_initial_states(sim.specs, np.random.default_rng(0))
    target = start.joint_rad + 0.1
    for mask in (np.array([True, True]), np.array([False, True])):
        sim.reset(start, mask)
        for _ in range(6):
            state = sim.advance(target)
    for n, world in enumerate(sim._worlds):
        assert np.array_equal(state.joint_rad[n], world.hand.get_qpos()[sim._to_spec])
        assert np.array_equal(state.joint_rad_s[n], world.hand.get_qvel()[sim._to_spec])
    assert np.abs(state.joint_rad - start.joint_rad).min() > 0
    sim.close()


def test_compiled_contacts_are_pybullets_own() -> None:
    """Read the forces on the fingertips that pybullet's own call lists."""
    pybullet = pytest.importorskip("pybullet")
    from backends.bullet import Backend

    sim = Backend(drawn(2))
    start = sample_initial_states(sim.specs, np.random.default_rng(0))
    sim.reset(start, np.ones(2, dtype=bool))
    for _ in range(20):
        state = sim.advance(start.joint_rad + np.array(sim.specs[0].hand.preload_rad))
    for n, world in enumerate(sim._worlds):
        listed = pybullet.getContactPoints(world.hand, world.stick, physicsClientId=world.client)
        force = np.zeros_like(state.contact_force_n[n])
        for contact in listed:
            force[world.tips[contact[3]]] += contact[9] * np.array(contact[7])
        assert np.array_equal(state.contact_force_n[n], force)
        assert (np.linalg.norm(force, axis=1) > 0).all()
    sim.close()


def test_unknown_client_is_refused() -> None:
    """Raise for a client that was never connected instead of following a null pointer."""
    pytest.importorskip("pybullet")
    from backends._bullet_calls import pointer

    with pytest.raises(RuntimeError, match="no client 1000"):
        pointer(1000)


def test_stripped_library_is_refused(tmp_path) -> None:
    """Say what to install when a library does not tell where its symbols are."""
    pytest.importorskip("pybullet")
    from backends._bullet_calls import _symbol_values

    head = bytearray(64)
    head[40:48] = (64).to_bytes(8, "little")  # where the sections start
    head[60:62] = (1).to_bytes(2, "little")  # how many there are
    library = tmp_path / "stripped.so"
    library.write_bytes(bytes(head) + bytes(64))
    with pytest.raises(ImportError, match="stripped of its symbols"):
        _symbol_values(str(library), ("main",))


def test_a_world_takes_under_a_megabyte() -> None:
    """Grow by less than 1 MB per drawn MuJoCo world, measured in a process of its own."""
    code = (
        "from benchmark.speed import _memory; from benchmark.settings.run_spec import *; "
        "from benchmark.runs.train import training_worlds\n"
        "held = []\n"
        "for n in (16, 272):\n"
        "    run = RunSpec(backend='mujoco', task='circle', worlds=n)\n"
        "    env = run.make_env(training_worlds(run, 0), 0, 1)\n"
        "    env.reset(); env.step(env.target_rad); held.append(_memory.held_mb())\n"
        "print((held[1] - held[0]) / 272)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 0 < float(done.stdout.splitlines()[-1]) < 1.0


def measured(*arguments: str) -> list[str]:
    """Arguments of a short measurement."""
    return ["speed", "--backend", "mujoco", "--workers", "1", "--duration", "100ms", *arguments]


def test_speed_reports_and_writes_every_row(tmp_path, capfd) -> None:
    """Print one JSON object with the headline of the best row, and write the rows and a picture."""
    assert cli.call(measured("--worlds", "4,2", "--json", "--out", str(tmp_path))) == 0
    result = json.loads(capfd.readouterr().out)
    rows = result["rows"]
    assert [row["envs"] for row in rows] == [2, 4]
    for row in rows:
        assert row["physics_steps_per_s"] == pytest.approx(20 * row["env_steps_per_s"], rel=1e-3)
        parts_us = sum(row["us_per_env_step"].values())
        assert parts_us == pytest.approx(1e6 / row["env_steps_per_s"], rel=1e-3)
    best = max(rows, key=lambda row: row["env_steps_per_s"])
    assert {key: result[key] for key in HEADLINE} == {key: best[key] for key in HEADLINE}
    assert len((tmp_path / "speed.csv").read_text().splitlines()) == 3
    assert json.loads((tmp_path / "speed.json").read_text()) == result
    assert (tmp_path / "speed.png").read_bytes().startswith(b"\x89PNG")


def test_overhead_is_the_median_of_the_stretches_ratios() -> None:
    """Compare steps and new episodes with the same steps of the bare engine."""
    each = _stopwatch.STRETCH
    half = np.repeat([[1, 0, 4, 0.9, 1], [2, 0, 5, 1.8, 2], [30, 0, 90, 27, 10]], each, axis=0)
    half[::each, 1] = 0.6
    timing = _stopwatch._summary(half, half)
    assert timing.overhead[1] == pytest.approx(0.6 / each)
    assert (timing.step_s, timing.wall_s, timing.steps) == (11.0, 33.0, 6 * each)


@pytest.mark.parametrize("slower", [1.0, 1.1])
def test_an_engine_that_lies_well_in_memory_is_no_overhead(slower: float) -> None:
    """Let both engines be the bare one for as long."""
    own, each = 0.05, _stopwatch.STRETCH
    first, then = (
        np.tile(_stopwatch._Step(one + own, 0.0, one + own, one, other), (each, 1))
        for one, other in ((1.0, slower), (slower, 1.0))
    )
    timing = _stopwatch._summary(first, then)
    assert timing.overhead[1] == pytest.approx(2 * own / (1.0 + slower))


def measure(bare: list[Spec]) -> _stopwatch.Timing:
    """Time two worlds beside a bare engine of these; the clock counts how often it is read."""
    run, calls = RunSpec(backend="mujoco", task="circle", worlds=2), itertools.count()
    env = run.make_env(training_worlds(run, 0), 0, 1)
    beside = registry.load("backend", "mujoco")(bare)
    try:
        return _stopwatch.measure(env, beside, 0.0, lambda: float(next(calls)))
    finally:
        env.close()
        beside.close()


def test_drives_and_engine_are_timed_within_the_step() -> None:
    """Take the part of drives and engine from the steps, and the bare engine right after them."""
    run = RunSpec(backend="mujoco", task="circle", worlds=2)
    timing = measure(training_worlds(run, 0))
    assert timing.raw_s == timing.advance_s == 1.0 < timing.step_s


def test_other_steps_are_no_measurement() -> None:
    """Refuse to compare with worlds that end elsewhere."""
    run = RunSpec(backend="mujoco", task="circle", worlds=2)
    with pytest.raises(_stopwatch.DifferentStepsError):
        measure([run.world()] * 2)


def test_gain_compares_as_many_worlds_by_the_wall() -> None:
    """Divide by the row of the same engine and worlds on the fewest cores."""
    names = ("backend", "envs", "processes", "wall_env_steps_per_s")
    values = [("a", 8, 1, 10.0), ("a", 16, 1, 20.0), ("a", 16, 2, 38.0), ("b", 16, 1, 1.0)]
    rows = [dict(zip(names, row, strict=True)) for row in values]
    assert [speed._gain(row, rows) for row in rows] == [1.0, 1.0, 1.9, 1.0]


def test_more_than_the_memory_is_refused() -> None:
    """Skip a batch that smaller ones say will not fit."""
    rows = [{"envs": n, "memory_mb": 1e6 * n} for n in (1, 2)]
    with pytest.raises(CommandError, match=r"4 worlds, .* need about 8000\.0 GB of memory"):
        speed._check_memory(rows, 4)
    speed._check_memory(rows[:1], 4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--backend", "bulet"], "Did you mean 'bullet'?"),
        (["--worlds", "0"], "--worlds is 0; allowed: 1 to"),
        (["--worlds", "4,x"], "--worlds is 'x'"),
        (["--workers", "100000"], "--workers is 100000; allowed: 1 to"),
        (["--duration", "nans"], "allowed: 0.1 to 600"),
        (["--seed", "-1"], "--seed is '-1'"),
    ],
)
def test_what_cannot_be_measured_is_refused(arguments, words, capfd) -> None:
    """Refuse bad options with one message and exit code 2."""
    assert cli.call(["speed", *arguments]) == 2
    err = capfd.readouterr().err
    assert words in err
    assert "Traceback" not in err
