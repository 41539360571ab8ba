"""Make a blind case: hidden world, random motions, sensor readings. Knows no solver.

The real side is an engine or a plant. Engines share the drive law with the solver. Plants have
other equations and share nothing. An engine that is no backend, because it holds no stick, is a
file in `engines`.
"""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from backends.catalogue import catalogue
from backends.effect import with_effects
from backends.engine import Simulator
from backends.spec import Spec
from backends.state import Array
from diagnosis.blind import motion, rigs
from diagnosis.blind.draw import Case
from diagnosis.blind.files import BlindSet, write_json
from diagnosis.blind.grasp import HOLDS, fallen, gripped, tracked
from diagnosis.blind.motion import Motion
from diagnosis.blind.plant import Mechanics, Plant
from diagnosis.blind.sides import PLANTS, mechanics
from diagnosis.logs.log import Channel, EpisodeMeta, Log, LogMeta, make_log, write_log
from diagnosis.motion.batch import joined, read_every, states
from diagnosis.recording._tape import Tape, frame

READ = ("position", "motor", "torque", "touch", "contact", "stick")
"""What the sensors of an engine's worlds read."""
Simulate = Callable[[str, Sequence[Spec]], Simulator]
"""Starts worlds on the engine with this name."""


def write_case(
    blind: BlindSet, case: Case, simulate: Simulate, seed: int, make: int | None
) -> None:
    """Write a case's log and the facts that its solver may use, and nothing of the answer.

    `make` is the number of the plant's healthy logs; None: there are none. A solver may know
    whether the log is from a robot, which a plant stands for, or from a simulator.
    """
    log = real_log(case, simulate, case_rng(case, seed))
    write_log(log, blind.log(case.number))
    robot = case.real in PLANTS or rigs.robot(case.rig) is not None
    given = {"excluded": list(case.excluded), "robot": robot}
    given |= {} if make is None else {"make": make}
    write_json(blind.log(case.number) / "case.json", given)


def write_sound(folder: Path, case: Case, simulate: Simulate, seed: int) -> None:
    """Write a healthy log."""
    write_log(real_log(case, simulate, case_rng(case, seed)), folder)


def case_rng(case: Case, seed: int) -> np.random.Generator:
    """The random generator of a case's motions and noise."""
    return np.random.default_rng([seed, 2, case.number])


def real_log(case: Case, simulate: Simulate, rng: np.random.Generator) -> Log:
    """The log of the hidden world of a case."""
    spec, noise = rigs.nominal(case.rig), rigs.torque_noise(case.rig)
    moved = motions(case, spec, hidden_world(case, spec), rng)
    episodes = readings(case, spec, moved, simulate, rng)
    frames = [
        _frame(number, case, one, _noisy(spec, read, noise, rng))
        for number, (one, read) in enumerate(zip(moved, episodes, strict=True))
    ]
    mechanism, mjcf_xml = rigs.described(case.rig)
    meta = LogMeta(
        schema=1,
        source=f"blind case {case.number}",
        mechanism=mechanism,
        channels={"touch": Channel(unit="1")} if "contact" in case.channels else {},
        episodes=tuple(EpisodeMeta(episode=k, protocol=m.protocol) for k, m in enumerate(moved)),
    )
    return make_log(meta, pd.concat(frames, ignore_index=True), mjcf_xml)


def readings(
    case: Case, spec: Spec, moved: Sequence[Motion], simulate: Simulate, rng: np.random.Generator
) -> list[dict[str, Array]]:
    """The readings of every episode of a case; `spec` is the rig's nominal world."""
    if case.real in PLANTS:
        return _on_plant(case, spec, moved, rng)
    world = hidden_world(case, spec)
    rate_hz = rigs.rate_hz(case.rig)
    return engine_readings(lambda specs: simulate(case.real, specs), world, moved, rng, rate_hz)


def motions(case: Case, spec: Spec, world: Spec, rng: np.random.Generator) -> list[Motion]:
    """Random episodes: in free air with the nominal hand, in a grasp with the hidden stick."""
    rate_hz = rigs.rate_hz(case.rig)
    return [
        gripped(protocol, world, rng)
        if protocol in HOLDS
        else motion.motion(protocol, spec, rng, rate_hz)
        for protocol in case.protocols
        for _ in range(case.variants)
    ]


def hidden_world(case: Case, spec: Spec) -> Spec:
    """The nominal world with a case's nominal errors and effects; nominal for a plant."""
    faults = () if case.real in PLANTS else (*case.nominal, *case.faults)
    return with_effects(
        spec, (catalogue()[f.effect](magnitude=f.magnitude, joint=f.joint) for f in faults)
    )


def _on_plant(
    case: Case, spec: Spec, motions: Sequence[Motion], rng: np.random.Generator
) -> list[dict[str, Array]]:
    plant = Plant(spec, robot(case))
    for fault in (*case.nominal, *case.faults):
        plant.add(fault.effect, fault.magnitude, fault.joint)
    sample_s = 1 / rigs.rate_hz(case.rig)
    return [
        plant.run(m.target_rad, m.push_nm, sample_s, rng, slipped=2 * k >= len(motions))
        for k, m in enumerate(motions)
    ]


def robot(case: Case) -> Mechanics:
    """The equations of a case's plant: of a typical robot, or of the drawn one."""
    make, seed = mechanics(case.real), rigs.robot(case.rig)
    return make() if seed is None else make.individual(np.random.default_rng([seed, 2]))


def engine_readings(
    simulate: Callable[[Sequence[Spec]], Simulator],
    spec: Spec,
    motions: Sequence[Motion],
    rng: np.random.Generator,
    rate_hz: float = rigs.RATE_HZ,
) -> list[dict[str, Array]]:
    """The readings of an engine's sensors in every episode."""
    seeds = rng.integers(1 << 53, size=len(motions))
    read: dict[int, dict[str, Array]] = {}
    for held in (False, True):
        chosen = [k for k, one in enumerate(motions) if (one.protocol in HOLDS) == held]
        if chosen:
            engine = simulate([read_every(spec, 1 / rate_hz, held)] * len(chosen))
            done = _played(engine, [motions[k] for k in chosen], seeds[chosen], held)
            read |= dict(zip(chosen, done, strict=True))
    return [read[k] for k in range(len(motions))]


def _played(
    engine: Simulator, motions: Sequence[Motion], seeds: Array, held: bool
) -> list[dict[str, Array]]:
    """What the sensors of an engine's worlds read, each in its own motion; ends the engine."""
    tape = Tape(engine.specs, READ, held)
    target = np.stack([m.target_rad for m in motions], axis=1)
    push = np.stack([m.push_nm for m in motions], axis=1)
    still = np.zeros(len(target))
    pull = np.stack([still if m.pull_n is None else m.pull_n for m in motions], axis=1)
    start = dataclasses.replace(joined([m.start for m in motions]), noise_seed=seeds)
    for k, state in enumerate(states(engine, start, target, push, pull)):
        tape.note(state, target[k], push[k], pull[k])
    taken = tape.taken
    return [{kind: taken[kind][:, e] for kind in tape.channels} for e in range(len(motions))]


def _noisy(
    spec: Spec, read: dict[str, Array], torque_noise: float, rng: np.random.Generator
) -> dict[str, Array]:
    """The readings with the noise of motor encoders, current sensors and the stick's tracker."""
    limit = np.array([drive.torque_limit_nm for drive in spec.drives])
    shape = read["motor"].shape
    noisy = {
        "motor": read["motor"] + rigs.NOISE_RAD * rng.normal(size=shape),
        "torque": read["torque"] + torque_noise * limit * rng.normal(size=shape),
    }
    if "stick" in read:
        noisy["stick"] = tracked(read["stick"], rng)
    return read | noisy


def _frame(number: int, case: Case, one: Motion, read: dict[str, Array]) -> pd.DataFrame:
    signals = {"command": one.target_rad, "push": one.push_nm}
    signals |= {} if one.pull_n is None else {"pull": one.pull_n}
    signals |= {kind: read[kind] for kind in case.channels if kind in read}
    times_s = motion.times_s(rigs.rate_hz(case.rig))
    whole = frame(rigs.nominal(case.rig).hand, times_s, signals).assign(episode=number)
    return whole[: fallen(read["stick"])] if "stick" in read else whole
