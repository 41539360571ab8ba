"""Recording: run the protocols on an engine and write a log like that of a robot.

The engine is passed in and runs at the rate of the log. Episodes are worlds of one batch. A log
names its mechanism but not its effects, because a diagnosis has to find them.
"""

import dataclasses
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd

from backends.engine import Simulator
from backends.spec import Spec
from backends.state import Array, InitialState
from diagnosis.logs.log import Channel, EpisodeMeta, HandMechanism, Log, LogError, LogMeta, make_log
from diagnosis.motion.batch import Simulate, at_rest, joined, read_every, states, together
from diagnosis.recording import excitation
from diagnosis.recording._tape import Tape, TapedSimulator
from diagnosis.recording.excitation import Excitation
from tasks.batch import BatchEnv
from tasks.initial_states import sample_initial_states
from tasks.observation import Observation
from tasks.task import Figure

CHANNELS = ("command", "position", "motor", "torque", "velocity", "push", "touch", "stick", "pull")
OPTIONAL = ("contact",)
"""Instead of 'touch': whether each taxel is active, as after the threshold of a robot."""
ALWAYS = ("command", "position")
"""Channels that every log needs."""
HELD = ("grasp", "pull", "policy")
"""Protocols with the stick in the hand."""


@dataclass(frozen=True, kw_only=True)
class Policy:
    """The policy that acts in the closed-loop protocol."""

    task: Figure
    observation: Observation
    act: Callable[[Array], Array]
    """Actions (N, J) in [-1, 1] from observations (N, width)."""


class Episode(NamedTuple):
    """One episode to be recorded."""

    protocol: str
    variant: int
    """Seed of phases, orders and grip."""
    repeat: int
    """Seed of the noise."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is recorded: every protocol in some variants, each repeated some times."""

    protocols: tuple[str, ...]
    channels: tuple[str, ...] = CHANNELS
    rate_hz: float = excitation.RATE_HZ
    variants: int = 1
    repeats: int = 1
    seed: int = 0

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """All episodes in the order of the log."""
        every = product(self.protocols, range(self.variants), range(self.repeats))
        return tuple(Episode(*one) for one in every)


def record(
    simulate: Simulate,
    spec: Spec,
    plan: Plan,
    source: str,
    policy: Policy | None = None,
    known_effects: str = "none",
    progress: Callable[[float], None] = lambda share: None,
) -> Log:
    """A log of the world `spec`; `known_effects` are the effects that the log may name.

    `progress` takes the finished share. Raises LogError if the plan cannot be recorded, ValueError
    if the engine refuses a number or the stick cannot be gripped, and SimulationDivergedError if a
    signal is not finite.
    """
    _check(spec, plan, policy)
    frames: dict[int, pd.DataFrame] = {}
    kinds = [e.protocol if e.protocol in HELD else "free" for e in plan.episodes]
    batches = list(dict.fromkeys(kinds))
    for done, kind in enumerate(batches):
        chosen = [k for k, one in enumerate(kinds) if one == kind]
        starts = [_start(spec, plan, k) for k in chosen]
        worlds = [read_every(spec, 1 / plan.rate_hz, kind in HELD)] * len(chosen)
        tape, motions = Tape(worlds, plan.channels, kind in HELD), list[Excitation]()
        if policy is not None and kind == "policy":
            shares = _act(simulate(worlds), tape, spec, plan.seed, policy, joined(starts))
        else:
            pairs = zip(chosen, starts, strict=True)
            motions += [_motion(spec, plan, plan.episodes[k], start) for k, start in pairs]
            shares = _move(simulate(worlds), tape, motions, joined(starts))
        with closing(shares):
            for share in shares:
                progress((done + share) / len(batches))
        ends = [len(motion.t_s) for motion in motions] or [len(tape.rows)] * len(chosen)
        frames |= dict(zip(chosen, tape.frames(ends), strict=True))
    for number, frame in frames.items():
        frame.insert(0, "episode", number)
    samples = pd.concat([frames[k] for k in sorted(frames)], ignore_index=True)
    return make_log(_meta(spec, plan, source, known_effects), samples)


def _check(spec: Spec, plan: Plan, policy: Policy | None) -> None:
    """Raise LogError unless the plan can be recorded in worlds like `spec`."""
    _known("protocol", plan.protocols, excitation.PROTOCOLS)
    _known("channel", plan.channels, (*CHANNELS, *OPTIONAL))
    if {"touch", "contact"} <= set(plan.channels):
        raise LogError("touch and contact are two forms of one channel; choose one of them")
    missing = [name for name in ALWAYS if name not in plan.channels]
    if missing:
        raise LogError(f"every log needs {' and '.join(missing)}; add it to the channels")
    loads = {"push", "pull"} & set(plan.protocols) - set(plan.channels)
    for name in sorted(loads):
        raise LogError(
            f"the protocol '{name}' needs the channel '{name}'; add it to the channels, "
            "or leave the protocol out"
        )
    if "policy" in plan.protocols and policy is None:
        raise LogError(
            "the protocol 'policy' needs a policy; give a run with --policy, "
            "or leave the protocol out"
        )
    slowest_hz, drive_s = 1 / spec.timing.policy_s, spec.timing.drive_s
    ticks, samples = 1 / (plan.rate_hz * drive_s), spec.timing.policy_s * plan.rate_hz
    whole = _whole(ticks) and ("policy" not in plan.protocols or _whole(samples))
    if not (whole and slowest_hz * (1 - 1e-9) <= plan.rate_hz <= (1 + 1e-9) / drive_s):
        raise LogError(
            f"the rate is {plan.rate_hz:g} Hz; allowed: {slowest_hz:g} to {1 / drive_s:g} Hz, such "
            f"as 50, 200 or 1000; a sample must last a whole number of drive periods "
            f"({1e3 * drive_s:g} ms), and a policy needs a whole number of samples in "
            f"{1e3 * spec.timing.policy_s:g} ms"
        )


def _known(what: str, given: tuple[str, ...], known: tuple[str, ...]) -> None:
    if not given:
        raise LogError(f"no {what} is given; known: {', '.join(known)}")
    for name in given:
        if name not in known:
            raise LogError(f"no {what} named '{name}'; known: {', '.join(known)}")
        if given.count(name) > 1:
            raise LogError(f"{what} '{name}' is given twice; give each once")


def _whole(number: float) -> bool:
    return abs(number - round(number)) < 1e-9


def _move(
    engine: Simulator, tape: Tape, motions: Sequence[Excitation], start: InitialState
) -> Generator[float, None, None]:
    """Record motions in worlds side by side; gives the finished share."""
    target, load, pull = (
        together([getattr(motion, name) for motion in motions])
        for name in ("target_rad", "push_nm", "pull_n")
    )
    with closing(states(engine, start, target, load, pull)) as every:
        for t, state in enumerate(every):
            tape.note(state, target[t], load[t], pull[t])
            yield (t + 1) / len(target)


def _act(
    engine: Simulator, tape: Tape, spec: Spec, seed: int, policy: Policy, start: InitialState
) -> Generator[float, None, None]:
    """Record a policy's task; gives the finished share."""
    face = TapedSimulator(engine, tape, spec.timing.policy_s)
    with closing(BatchEnv(face, policy.task, policy.observation, seed)) as env:
        observation = env.reset(start=start)
        for step in range(env.horizon):
            observation = env.step(policy.act(observation)).observation
            yield (step + 1) / env.horizon
        tape.note(face.state, env.target_rad)


def _start(spec: Spec, plan: Plan, number: int) -> InitialState:
    """The start of an episode; repeats start alike."""
    episode = plan.episodes[number]
    noise = np.random.default_rng([plan.seed, number, 0]).integers(1 << 53, size=1)
    if episode.protocol in HELD:
        rng = np.random.default_rng([plan.seed, episode.variant, 1])
        return dataclasses.replace(sample_initial_states([spec], rng), noise_seed=noise)
    start = at_rest(excitation.hand_joints(spec.hand).center_rad[None])
    return dataclasses.replace(start, noise_seed=noise)


def _motion(spec: Spec, plan: Plan, episode: Episode, start: InitialState) -> Excitation:
    """The commands of an episode; repeats have the same commands."""
    joints = excitation.hand_joints(spec.hand)
    if episode.protocol in HELD:
        grip = start.joint_rad[0] + np.array(spec.hand.preload_rad)
        joints = dataclasses.replace(joints, center_rad=grip)
    seed = np.random.SeedSequence([plan.seed, episode.variant]).generate_state(1)
    return excitation.OPEN_LOOP[episode.protocol](joints, plan.rate_hz, int(seed[0]))


def _meta(spec: Spec, plan: Plan, source: str, known_effects: str) -> LogMeta:
    mechanism = HandMechanism(hand=spec.hand.name, stick=spec.stick.name, effects=known_effects)
    episodes = tuple(
        EpisodeMeta(episode=k, protocol=e.protocol, note=f"variant {e.variant}, repeat {e.repeat}")
        for k, e in enumerate(plan.episodes)
    )
    held = any(protocol in HELD for protocol in plan.protocols)
    binary = {"touch": Channel(unit="1")} if held and "contact" in plan.channels else {}
    return LogMeta(schema=1, source=source, mechanism=mechanism, channels=binary, episodes=episodes)
