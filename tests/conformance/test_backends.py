"""Every engine keeps the contract: answers, shapes, repeatability, independence, workers."""

import dataclasses
import multiprocessing
import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

from backends.engine import Engine, Simulator
from backends.shard import Sharded, WorkerError, simulate
from backends.spec import Spec, field_names
from backends.state import Array, InitialState, State
from backends.sticks import STICKS
from benchmark.parts import registry
from benchmark.settings.run_spec import RunSpec
from tasks.initial_states import sample_initial_states

SIGNALS = tuple(f.name for f in dataclasses.fields(State))
ANSWERS = {"exact", "approximate", "refused"}


def world(stick: str = "reference", effects: str = "built") -> Spec:
    """The nominal world of a run; no number of it depends on the engine."""
    return RunSpec(backend="mujoco", task="line", stick=stick, effects=effects).world()


def varied() -> list[Spec]:
    """Worlds that differ in shape, mass, friction and drives."""
    return [
        world(),
        world("square"),
        world("steel", "kp-scale=20%,backlash=2deg"),
        world("fabric", "none"),
    ]


def grasps(specs: list[Spec], seed: int = 0) -> InitialState:
    """A random grasp in every world."""
    return sample_initial_states(specs, np.random.default_rng(seed))


def some(initial: InitialState, worlds: list[int]) -> InitialState:
    """The rows of some worlds."""
    rows = {f.name: getattr(initial, f.name)[worlds] for f in dataclasses.fields(initial)}
    return InitialState(**rows)


def squeeze(specs: list[Spec], start: InitialState) -> Array:
    """Targets that press the grasp, shape (N, J)."""
    return start.joint_rad + np.array([s.hand.preload_rad for s in specs])


def every(n: int) -> Array:
    """A mask of all worlds."""
    return np.ones(n, dtype=bool)


def copied(state: State, worlds: slice = slice(None)) -> State:
    """A state that the engine does not overwrite."""
    return State(**{name: getattr(state, name)[worlds].copy() for name in SIGNALS})


def play(sim: Simulator, target_rad: Array, periods: int = 12, seed: int = 7) -> list[State]:
    """Copies of the states under restless targets around `target_rad`, equal in every world."""
    rng = np.random.default_rng(seed)
    noise = rng.uniform(-0.05, 0.05, (periods, 1, target_rad.shape[1]))
    return [copied(sim.advance(target_rad + jerk)) for jerk in noise]


def run(sim: Simulator, start: InitialState, periods: int = 12) -> list[State]:
    """The states after a reset of all worlds, by `play`."""
    first = copied(sim.reset(start, every(len(sim.specs))))
    return [first, *play(sim, squeeze(list(sim.specs), start), periods)]


def differing(a: list[State], b: list[State]) -> list[str]:
    """Names of the signals in which two runs are not equal to the last bit."""
    pairs = list(zip(a, b, strict=True))
    return [
        name
        for name in SIGNALS
        if not all(np.array_equal(getattr(x, name), getattr(y, name)) for x, y in pairs)
    ]


def test_support_answers_every_field_and_no_other(engine: type[Engine]) -> None:
    """Answer for each number of the spec with one of three words, and with why unless exact."""
    assert set(engine.support) == set(field_names())
    for answer in engine.support.values():
        word, _, why = answer.partition(": ")
        assert word in ANSWERS
        assert bool(why.strip()) == (word != "exact")


def test_state_has_its_shapes(engine: type[Engine]) -> None:
    """Report finite float64 arrays of the stated shapes."""
    specs = varied()
    sim = engine(specs)
    states = run(sim, grasps(specs))
    blank = State.allocate(len(specs), 6, 3)
    for state in states:
        for name in SIGNALS:
            value = getattr(state, name)
            assert value.shape == getattr(blank, name).shape
            assert value.dtype == np.float64
        assert state.first_bad_signal() is None
    last = states[-1]
    assert np.linalg.norm(last.stick_quat_wxyz, axis=1) == pytest.approx(1.0, abs=1e-6)
    assert np.abs(last.joint_rad_s).max() > 0
    sim.close()


def test_contacts_are_as_declared(engine: type[Engine]) -> None:
    """Report touch where the fingers press, and none where the engine says that it has none."""
    specs = varied()
    sim = engine(specs)
    touched = run(sim, grasps(specs))[-1].contact_force_n.any(axis=(1, 2))
    sim.close()
    if engine.no_contacts:
        assert not touched.any(), "it reports contacts: take `no_contacts` out of the class"
        pytest.skip(f"no contacts: {engine.no_contacts}")
    assert touched.all(), "no contact is reported where fingers press; write them in `_observe`"


def test_reset_state_is_the_initial_state(engine: type[Engine]) -> None:
    """Report after a reset what was asked for, at rest and without contact."""
    specs = varied()
    sim, start = engine(specs), grasps(specs)
    run(sim, grasps(specs, 1), 3)
    state = sim.reset(start, every(len(specs)))
    for name in ("joint_rad", "stick_pos_m", "stick_quat_wxyz"):
        assert np.array_equal(getattr(state, name), getattr(start, name))
    angles = {"joint_rad", "motor_rad", "measured_rad"}
    for name in angles:
        assert np.array_equal(getattr(state, name), start.joint_rad)
    for name in set(SIGNALS) - angles - {"stick_pos_m", "stick_quat_wxyz"}:
        assert not getattr(state, name).any()
    sim.close()


def test_same_inputs_twice_are_bit_equal(engine: type[Engine]) -> None:
    """Repeat a run in fresh worlds to the last bit."""
    specs = varied()
    runs = []
    for _ in range(2):
        sim = engine(specs)
        runs.append(run(sim, grasps(specs)))
        sim.close()
    assert differing(*runs) == []


def test_reset_world_equals_a_fresh_one(engine: type[Engine]) -> None:
    """Repeat a fresh world's run after resets in contact, elsewhere and in place, and in a fall."""
    specs = varied()
    sim, start = engine(specs), grasps(specs)
    fresh = run(sim, start)
    aside = dataclasses.replace(start, stick_pos_m=start.stick_pos_m + 1.0)
    for history, periods in ((grasps(specs, 1), 5), (start, 1), (start, 9), (aside, 8)):
        run(sim, history, periods)
        assert differing(fresh, run(sim, start)) == []
    sim.close()


def test_masked_reset_leaves_the_others(engine: type[Engine]) -> None:
    """Go on in the unmasked worlds as if nothing had happened; start the masked one afresh."""
    specs = varied()
    start, other = grasps(specs), grasps(specs, 1)
    target, only = squeeze(specs, start), np.arange(len(specs)) == 1
    runs = []
    for is_reset in (False, True):
        sim = engine(specs)
        run(sim, start, 6)  # beyond the weightless time
        if is_reset:
            sim.reset(other, only)
        runs.append(play(sim, target, 8))
        sim.close()
    rest = np.flatnonzero(~only)
    for left, right in zip(*runs, strict=True):
        for name in SIGNALS:
            assert np.array_equal(getattr(left, name)[rest], getattr(right, name)[rest])
    assert not np.array_equal(runs[0][-1].stick_pos_m[1], runs[1][-1].stick_pos_m[1])
    alone = engine([specs[1]])
    alone.reset(some(other, [1]), every(1))
    again = play(alone, target[1:2], 8)
    assert differing(again, [copied(s, slice(1, 2)) for s in runs[1]]) == []
    alone.close()


def test_worlds_do_not_influence_each_other(engine: type[Engine]) -> None:
    """Run alone as in a batch of other worlds, to the last bit."""
    specs = varied()
    batch, start = engine(specs), grasps(specs)
    together = run(batch, start)
    batch.close()
    for n, spec in enumerate(specs):
        sim = engine([spec])
        alone = run(sim, some(start, [n]))
        sim.close()
        assert differing(alone, [copied(s, slice(n, n + 1)) for s in together]) == []


def test_worlds_may_differ_in_weightless_time(engine: type[Engine]) -> None:
    """Compensate the weight in each world as long as its own spec says."""
    heavy = dataclasses.replace(world(), timing=dataclasses.replace(world().timing, weightless_s=0))
    specs = [world(), heavy]
    start = grasps(specs)
    batch, alone = engine(specs), engine([heavy])
    together = [copied(state, slice(1, 2)) for state in run(batch, start, 4)]
    assert differing(run(alone, some(start, [1]), 4), together) == []


def test_reset_recovers_from_nan(engine: type[Engine]) -> None:
    """Show a NaN target in the state of its world alone, and forget it at the reset."""
    specs = [world()] * 2
    sim, start = engine(specs), grasps(specs)
    fresh = run(sim, start)
    sim.reset(start, every(2))
    target = squeeze(specs, start)
    target[1, 2] = np.nan
    state = sim.advance(target)
    assert state.first_bad_signal() is not None
    assert state.rows(slice(0, 1)).first_bad_signal() is None
    assert differing(fresh, run(sim, start)) == []
    sim.close()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_diverging_world_is_not_restarted(
    engine: type[Engine], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Let an unstable world run away until a signal is not finite; never start it again unasked.

    Write nothing where the user is, as MuJoCo does by itself.
    """
    monkeypatch.chdir(tmp_path)
    spec = world()
    stiff = {"gear_stiffness_nm_rad": 5e3, "gear_damping_nms_rad": 1.0}
    spec = spec.with_drives(tuple(dataclasses.replace(d, **stiff) for d in spec.drives))
    sim, start = engine([spec]), grasps([spec])
    sim.reset(start, every(1))
    for _ in range(50):
        state = sim.advance(squeeze([spec], start))
        if state.first_bad_signal() is not None:
            break
        assert state.joint_rad.any()
        assert np.abs(state.joint_rad_s).max() > 1.0
    assert state.first_bad_signal() is not None
    sim.close()
    assert list(tmp_path.iterdir()) == []


def test_workers_change_nothing(engine: type[Engine]) -> None:
    """Give with two threads or processes what one gives, noise and masked resets included."""
    noisy = world("reference", "encoder-noise=2mrad,command-dropout=30%")
    refused = [name for name, answer in engine.support.items() if answer.startswith("refused")]
    takes = not any(np.any(noisy.values(name)) for name in refused)
    specs = [*varied(), *([noisy] if takes else [])]
    start, other = grasps(specs), grasps(specs, 1)
    mask = np.arange(len(specs)) % 2 == 0
    runs = []
    for workers in (1, 2):
        sim = simulate(engine, specs, workers)
        states = run(sim, start, 6)
        states.append(copied(sim.reset(other, mask)))
        runs.append([*states, *play(sim, squeeze(specs, other), 6)])
        sim.close()
        sim.close()
    assert differing(*runs) == []


def test_a_payload_that_tilts_inertia_is_refused(engine: type[Engine]) -> None:
    """Refuse a load beside a link's axes, which no diagonal inertia holds."""
    spec = world()
    *others, last = spec.hand.driven
    askew = dataclasses.replace(last, com_m=(0.02, 0.01, 0.0), payload=0.5)
    with pytest.raises(ValueError, match="products"):
        engine([spec.with_driven([*others, askew])])


def test_dead_worker_is_reported(engine: type[Engine]) -> None:
    """Raise WorkerError instead of hanging when a process is killed; close without complaint."""
    specs = [world()]
    before = set(multiprocessing.active_children())
    sim = Sharded(engine, specs, 1)
    (worker,) = set(multiprocessing.active_children()) - before
    start = grasps(specs)
    sim.reset(start, every(1))
    os.kill(worker.pid, signal.SIGKILL)
    worker.join(10)
    for _ in range(2):
        with pytest.raises(WorkerError, match="died"):
            sim.advance(squeeze(specs, start))
    sim.close()
    sim.close()


def test_worker_killed_at_work_is_reported() -> None:
    """Raise WorkerError when a process dies in the middle of a policy step."""
    specs = [world()] * 8
    before = set(multiprocessing.active_children())
    sim = Sharded(registry.load("backend", "mujoco"), specs, 2)
    workers = set(multiprocessing.active_children()) - before
    assert len(workers) == 2
    victim = next(iter(workers))
    start = grasps(specs)
    sim.reset(start, every(8))
    killer = threading.Timer(0.1, os.kill, (victim.pid, signal.SIGKILL))
    killer.start()
    with pytest.raises(WorkerError, match="died"):
        play(sim, squeeze(specs, start), 2000)
    killer.join()
    sim.close()
    assert not any(worker.is_alive() for worker in workers)


def test_a_worker_that_nobody_waits_for_ends_in_silence(capfd: pytest.CaptureFixture[str]) -> None:
    """Let Ctrl-C in the middle of a step print no trace of the processes."""
    specs = [world()]
    before = set(multiprocessing.active_children())
    sim = Sharded(registry.load("backend", "mujoco"), specs, 1)
    (worker,) = set(multiprocessing.active_children()) - before
    (pipe,) = sim._pipes
    pipe.send("advance")
    pipe.close()
    worker.join(60)
    assert worker.exitcode == 0 and capfd.readouterr().err == ""
    sim.close()


def test_failing_worker_says_why(engine: type[Engine]) -> None:
    """Raise WorkerError with the worker's own error when its world cannot be built."""
    spec = world()
    lost = dataclasses.replace(spec.hand.bodies[-1], parent="nobody")
    hand = dataclasses.replace(spec.hand, bodies=(*spec.hand.bodies[:-1], lost))
    with pytest.raises(WorkerError, match=r"^\w+: .*\w"):
        Sharded(engine, [dataclasses.replace(spec, hand=hand)], 1)


def test_different_rates_are_refused(engine: type[Engine]) -> None:
    """Raise ValueError for a batch whose worlds would not step together."""
    timing = dataclasses.replace(world().timing, drive_s=5e-4)
    with pytest.raises(ValueError, match="rates"):
        engine([world(), dataclasses.replace(world(), timing=timing)])


def test_unknown_shape_is_refused(engine: type[Engine]) -> None:
    """Raise for a stick whose shape the engine does not know instead of choosing another."""
    spec = world()
    odd = dataclasses.replace(spec, stick=dataclasses.replace(spec.stick, shape="pyramid"))
    with pytest.raises((KeyError, ValueError), match="pyramid"):
        engine([odd])


def test_closing_twice_is_harmless(engine: type[Engine]) -> None:
    """Close a used engine and an unused one twice."""
    for used in (True, False):
        sim = engine([world()])
        if used:
            run(sim, grasps([world()]), 1)
        sim.close()
        sim.close()


def test_every_stick_is_held(engine: type[Engine]) -> None:
    """Hold each stick for 1 s with the built drives: sunk under 2 mm, creeping under 1 mm/s."""
    specs = [world(stick) for stick in STICKS]
    sim, start = engine(specs), grasps(specs)
    sim.reset(start, every(len(specs)))
    path = [sim.advance(squeeze(specs, start)).stick_pos_m.copy() for _ in range(50)]
    sim.close()
    assert np.linalg.norm(path[-1] - start.stick_pos_m, axis=1).max() < 2e-3
    assert np.linalg.norm(path[-1] - path[24], axis=1).max() < 5e-4
