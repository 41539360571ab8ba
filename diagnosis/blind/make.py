"""Makes a blind case: hidden world, random motions, what its sensors would log. Knows no solver.

The real side is an engine, or the plant of other equations. Engines share the drive law with the
solver, as a simulator and its user share a textbook; the plant shares nothing.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd

from backends.effect import Effect
from backends.engine import Simulator
from backends.spec import Spec
from backends.state import Array, InitialState
from diagnosis.blind import motion, rigs
from diagnosis.blind.draw import Case
from diagnosis.blind.files import BlindSet, write_json
from diagnosis.blind.motion import RATE_HZ, Motion
from diagnosis.blind.plant import Plant
from diagnosis.logs.log import (
    EpisodeMeta,
    HandMechanism,
    Log,
    LogMeta,
    make_log,
    name_of,
    write_log,
)

PLANT = "plant"
TORQUE_NOISE = 0.02
"""Noise of a logged torque over the drive's limit, standard deviation."""
ASIDE_M = (5.0, 0.0, 0.0)
"""Where the stick floats without weight, for engines that must have one [m]."""

Simulate = Callable[[str, Sequence[Spec]], Simulator]
"""Puts worlds on the engine of that name."""


def write_case(
    blind: BlindSet,
    case: Case,
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate,
    seed: int,
) -> None:
    """Make a case's log and say what its solver may use; nothing of the answer is written."""
    log = real_log(case, catalogue, simulate, np.random.SeedSequence([seed, 2, case.number]))
    write_log(log, blind.log(case.number))
    write_json(blind.log(case.number) / "case.json", {"excluded": list(case.excluded)})


def real_log(
    case: Case,
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate,
    seed: np.random.SeedSequence,
) -> Log:
    """What the hidden world of a case would log."""
    rng, spec = np.random.default_rng(seed), rigs.nominal(case.rig)
    motions = [motion.motion(p, spec, rng) for p in case.protocols for _ in range(case.variants)]
    if case.real == PLANT:
        episodes = _on_plant(case, spec, motions, rng)
    else:
        world = _world(case, spec, catalogue)
        episodes = _on_engine(lambda specs: simulate(case.real, specs), world, motions, rng)
    frames = [
        _frame(number, spec, one, _noisy(spec, read, rng), case.channels)
        for number, (one, read) in enumerate(zip(motions, episodes, strict=True))
    ]
    meta = LogMeta(
        schema=1,
        source=f"blind case {case.number}",
        mechanism=HandMechanism(hand=case.rig),
        episodes=tuple(EpisodeMeta(episode=k, protocol=m.protocol) for k, m in enumerate(motions)),
    )
    return make_log(meta, pd.concat(frames, ignore_index=True))


def _world(case: Case, spec: Spec, catalogue: Mapping[str, type[Effect]]) -> Spec:
    for fault in (*case.nominal, *case.faults):
        effect = catalogue[fault.effect](magnitude=fault.magnitude, joint=fault.joint)
        spec = effect.on_spec(spec)
    return spec


def _on_plant(
    case: Case, spec: Spec, motions: Sequence[Motion], rng: np.random.Generator
) -> list[dict[str, Array]]:
    plant = Plant(spec)
    for fault in (*case.nominal, *case.faults):
        plant.add(fault.effect, fault.magnitude, fault.joint)
    return [plant.run(m.target_rad, m.push_nm, 1 / RATE_HZ, rng) for m in motions]


def _on_engine(
    simulate: Callable[[Sequence[Spec]], Simulator],
    spec: Spec,
    motions: Sequence[Motion],
    rng: np.random.Generator,
) -> list[dict[str, Array]]:
    """What an engine's sensors read in every episode; episodes run side by side."""
    timing = dataclasses.replace(spec.timing, policy_s=1 / RATE_HZ, weightless_s=1e6)
    count = len(motions)
    worlds = [dataclasses.replace(spec, timing=timing)] * count
    start = InitialState(
        joint_rad=np.tile(motion.center_rad(spec), (count, 1)),
        stick_pos_m=np.tile(ASIDE_M, (count, 1)),
        stick_quat_wxyz=np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)),
        noise_seed=rng.integers(1 << 53, size=count),
    )
    target = np.stack([m.target_rad for m in motions], axis=1)
    push = np.stack([m.push_nm for m in motions], axis=1)
    read: dict[str, list[Array]] = {"position": [], "motor": [], "torque": []}
    engine = simulate(worlds)
    try:
        state = engine.reset(start, np.ones(count, dtype=bool))
        for k in range(len(target)):
            read["position"].append(state.measured_rad.copy())
            read["motor"].append(state.motor_rad.copy())
            read["torque"].append(state.drive_torque_nm.copy())
            if k + 1 < len(target):
                state = engine.advance(target[k], push[k])
    finally:
        engine.close()
    stacked = {kind: np.stack(values, axis=1) for kind, values in read.items()}
    return [{kind: values[e] for kind, values in stacked.items()} for e in range(count)]


def _noisy(spec: Spec, read: dict[str, Array], rng: np.random.Generator) -> dict[str, Array]:
    """The readings with the noise of motor encoders and current sensors."""
    limit = np.array([drive.torque_limit_nm for drive in spec.drives])
    shape = read["motor"].shape
    return {
        "position": read["position"],
        "motor": read["motor"] + rigs.NOISE_RAD * rng.normal(size=shape),
        "torque": read["torque"] + TORQUE_NOISE * limit * rng.normal(size=shape),
    }


def _frame(
    number: int, spec: Spec, one: Motion, read: dict[str, Array], channels: Sequence[str]
) -> pd.DataFrame:
    columns: dict[str, object] = {"episode": number, "t_s": motion.times_s()}
    signals = {"command": one.target_rad, "push": one.push_nm}
    signals |= {kind: read[kind] for kind in channels}
    for kind, values in signals.items():
        for j, joint in enumerate(spec.hand.joint_names):
            columns[name_of(kind, joint)] = values[:, j]
    return pd.DataFrame(columns)
