"""Every effect acts in every engine: where it should, more when it is larger, and nowhere else.

Three worlds of one engine have magnitude zero, m and 2 m, and are excited alike. The hand is the
ideal one; effects on joints are put on J3, the proximal joint of the second finger, or on J4
where only last links have them.
"""

import dataclasses
import re
from functools import cache

import numpy as np
import pytest

from backends import sticks, trx
from backends.effect import UNITS, Effect
from backends.engine import Engine
from backends.shard import simulate
from backends.spec import Spec
from backends.state import Array, InitialState, State
from backends.touch import Skin
from benchmark.parts import registry
from benchmark.settings.effects import parse_effects
from tasks.initial_states import sample_initial_states

IDEAL = trx.spec(sticks.STICKS["reference"])
PERIODS = 25
STATE = frozenset(f.name for f in dataclasses.fields(State))
TOUCH = frozenset({"reading_m", "active", "center_m"})
OTHER_FINGERS = [0, 1, 4, 5]
"""Columns of the joints that do not share a finger with J3."""


@dataclasses.dataclass(frozen=True)
class Case:
    """How an effect is shown."""

    magnitude: str
    excitation: str = "free"
    """'free': moving fingers, the stick aside; 'fast': in large steps. 'push': a load on resting
    joints. 'close': fingers close on the stick. 'grasp': the stick is moved. 'slip': a weak grasp
    lets it slide. 'twist': two fingers of a weak grasp move against each other."""
    signal: str = "joint_rad"
    """The signal that has to change."""
    beside: str = "none"
    """What the hand has in all worlds."""


CASES = {
    "backlash": Case("0.5deg"),
    "self-lock": Case("0.05Nm", "push", "motor_rad"),
    "coulomb-friction": Case("10mNm"),
    "direction-friction": Case("10mNm"),
    "cogging": Case("10mNm"),
    "end-stop": Case("-18deg", "fast"),
    "presliding": Case("10mNm"),
    "stiction": Case("10mNm"),
    "viscous-friction": Case("5mNms"),
    "load-friction": Case("10%", "push", "motor_rad"),
    "series-elasticity": Case("50%", "push"),
    "gear-damping": Case("50%"),
    "rotor-inertia": Case("1000gcm2"),
    "link-mass": Case("50%"),
    "gravity-compensation": Case("50%", beside="gravity-tilt=30deg"),
    "gravity-tilt": Case("5deg", "free", "stick_pos_m"),
    "kp-scale": Case("10%"),
    "kd-scale": Case("10%"),
    "torque-limit": Case("-40%"),
    "torque-speed-limit": Case("40mNms", "fast"),
    "thermal-fade": Case("400%", "fast"),
    "command-delay": Case("5ms"),
    "command-rate-limit": Case("0.2s/rad"),
    "command-dropout": Case("10%"),
    "command-resolution": Case("1deg"),
    "control-jitter": Case("8ms"),
    "dead-zone": Case("0.5deg"),
    "encoder-bias": Case("1deg", "free", "measured_rad"),
    "encoder-scale": Case("5%", "free", "measured_rad"),
    "encoder-eccentricity": Case("1deg", "free", "measured_rad"),
    "encoder-eccentricity-sine": Case("1deg", "free", "measured_rad"),
    "encoder-resolution": Case("0.5deg", "free", "measured_rad"),
    "sensor-delay": Case("5ms", "free", "measured_rad"),
    "encoder-noise": Case("1mrad", "free", "measured_rad"),
    "taxel-threshold": Case("0.1mm", "grasp", "active"),
    "taxel-drift": Case("0.2mm/s", "grasp", "reading_m"),
    "taxel-dropout": Case("20%", "grasp", "reading_m"),
    "taxel-halo": Case("3mm", "grasp", "active"),
    "stick-mass": Case("200%", "slip", "stick_pos_m"),
    "stick-radius": Case("5%", "close"),
    "contact-friction": Case("-40%", "grasp", "stick_pos_m"),
    "contact-softness": Case("0.1mm/N", "grasp"),
    "torsional-friction": Case("1mm", "twist", "stick_quat_wxyz"),
    "touch-force": Case("0.2N", "slip", "active"),
}
IN_AIR = ("free", "fast", "push")
OF_STICK = ("stick-mass", "stick-radius", "contact-friction")
every_effect = pytest.mark.parametrize("name", registry.names("effect"))
Run = dict[str, Array]


def world(text: str, spec: Spec = IDEAL) -> Spec:
    """The ideal hand, or another world, with effects."""
    for effect in parse_effects(text, spec.hand):
        spec = effect.on_spec(spec)
    return spec


def usual(name: str) -> Case:
    """How an effect shows that has no case of its own: by the part of the spec that it changes."""
    kind: type[Effect] = registry.load("effect", name)
    magnitude = f"{0.2 * kind.bounds[1] / UNITS[kind.unit][1]:g}{kind.unit}"
    return {
        "encoder": Case(magnitude, "free", "measured_rad"),
        "taxels": Case(magnitude, "grasp", "reading_m"),
        "stick": Case(magnitude, "grasp", "stick_pos_m"),
        "contact": Case(magnitude, "grasp", "stick_pos_m"),
        "spec": Case(magnitude, "free", "stick_pos_m"),
    }.get(kind.spec_fields()[0].split(".")[0], Case(magnitude))


def case_of(name: str) -> Case:
    """How an effect is shown."""
    return CASES.get(name) or usual(name)


def written(name: str, times: int) -> str:
    """An effect of a case, its magnitude so many times, on J3 or J4 where it acts on joints."""
    kind: type[Effect] = registry.load("effect", name)
    number, unit = re.fullmatch(r"([-.\d]+)(.*)", case_of(name).magnitude).groups()
    joint = "" if not kind.per_joint else "@J4" if kind.at_ends else "@J3"
    return f"{name}={times * float(number)}{unit}{joint}"


def start(excitation: str, worlds: int, seed: int = 7) -> InitialState:
    """The nominal grasp in all worlds, the stick aside or the fingers open where that is asked."""
    grasp = sample_initial_states([IDEAL], np.random.default_rng(0), 0.0)
    repeat = np.zeros(worlds, dtype=int)
    joint, stick = grasp.joint_rad[repeat], grasp.stick_pos_m[repeat]
    if excitation in IN_AIR:
        stick[:, 0] += 5.0
    if excitation == "close":
        joint[:, ::2] -= 0.1
    return InitialState(
        joint_rad=joint,
        stick_pos_m=stick,
        stick_quat_wxyz=grasp.stick_quat_wxyz[repeat],
        noise_seed=np.full(worlds, seed),
    )


def targets(excitation: str) -> Array:
    """Target angles [rad], shape (PERIODS, J)."""
    time_s = 0.02 * np.arange(PERIODS)[:, None]
    joint = np.arange(6)
    wave = 0.0 * time_s + 0.0 * joint
    if excitation == "free":
        wave = 0.1 * np.sin(2 * np.pi * (2 + 0.3 * joint) * time_s + joint)
        wave += 0.05 * np.sign(np.sin(2 * np.pi * 1.3 * time_s + 2 * joint))
    if excitation == "fast":
        wave = 0.4 * np.sign(np.sin(2 * np.pi * 1.3 * time_s + 2 * joint))
    if excitation == "grasp":
        wave = 0.03 * np.sin(2 * np.pi * 2 * time_s + joint)
    if excitation == "twist":
        wave = 0.03 * np.sin(2 * np.pi * 2 * time_s) * np.array([1, 0, -1, 0, 0, 0])
    squeeze = {"slip": 0.05, "twist": 0.4}.get(excitation, 1.0)
    return np.array(IDEAL.hand.grasp_rad) + squeeze * np.array(IDEAL.hand.preload_rad) + wave


def skip_refused(engine: type[Engine], specs: list[Spec]) -> None:
    """Skip the test where the engine says that it cannot have these worlds."""
    for number, answer in engine.support.items():
        if answer.startswith("refused") and any(np.any(s.values(number)) for s in specs):
            pytest.skip(f"{number} is {answer}")


def run(engine: type[Engine], specs: list[Spec], excitation: str, seed: int = 7) -> Run:
    """Every signal of state and touch, shape (PERIODS, N, ...)."""
    skip_refused(engine, specs)
    if engine.no_contacts and excitation not in IN_AIR:
        pytest.skip(f"no contacts: {engine.no_contacts}")
    worlds = len(specs)
    sim, skin = simulate(engine, specs, 1), Skin(specs)
    sim.reset(start(excitation, worlds, seed), np.ones(worlds, dtype=bool))
    rows: list[Run] = []
    for period, target in enumerate(targets(excitation), start=1):
        push = excitation == "push"
        load = 0.3 * np.sin(2 * np.pi * period / 50) * np.ones((worlds, 6)) if push else None
        state = sim.advance(np.tile(target, (worlds, 1)), load)
        touch = skin.feel(state, np.full(worlds, 0.02 * period))
        rows.append({name: getattr(state, name).copy() for name in STATE})
        rows[-1] |= {name: getattr(touch, name).astype(float) for name in TOUCH}
    sim.close()
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@cache
def nominal(engine: type[Engine], excitation: str, beside: str) -> Run:
    """A run of the world alone that an effect is put into."""
    return run(engine, [world(beside)], excitation)


def change(signal: Array, world: int) -> float:
    """Root mean square difference of a world's signal to that of world 0."""
    return float(np.sqrt(np.square(signal[:, world] - signal[:, 0]).mean()))


def equal(signal: Array) -> bool:
    """Whether the signal is the same in all worlds, to the last bit."""
    return bool((signal == signal[:, :1]).all())


def spared(name: str) -> frozenset[str]:
    """Signals that an effect must not touch in its own excitation."""
    part = registry.load("effect", name).spec_fields()[0].split(".")[0]
    of_stick = {s for s in STATE if s.startswith(("stick_", "contact_"))}
    if name == "touch-force":
        return STATE
    return {
        "encoder": STATE - {"measured_rad"} | TOUCH,
        "taxels": STATE if case_of(name).signal == "reading_m" else STATE | {"reading_m"},
        "drive": of_stick | TOUCH,
        "command": of_stick | TOUCH,
        "body": of_stick | TOUCH,
    }.get(part, frozenset())


@every_effect
def test_more_is_more_and_nothing_else_changes(engine: type[Engine], name: str) -> None:
    """Repeat the nominal run to the bit at zero, change its signal more when larger, spare others.

    An effect on J3 spares the joints of the other fingers, which move freely here.
    """
    case = case_of(name)
    worlds = [world(written(name, k), world(case.beside)) for k in (0, 1, 2)]
    runs = run(engine, worlds, case.excitation)
    for signal, alone in nominal(engine, case.excitation, case.beside).items():
        assert np.array_equal(runs[signal][:, :1], alone), signal
    assert 0.0 < change(runs[case.signal], 1) < change(runs[case.signal], 2)
    assert [s for s in spared(name) if not equal(runs[s])] == []
    if registry.load("effect", name).per_joint:
        of_joints = [s for s in STATE if s.startswith(("joint_", "motor_", "drive_", "measured_"))]
        assert [s for s in of_joints if not equal(runs[s][..., OTHER_FINGERS])] == []


@pytest.mark.parametrize("name", OF_STICK)
def test_stick_matters_in_contact_alone(engine: type[Engine], name: str) -> None:
    """Move fingers that touch nothing as without the effect, to the bit; a surface falls alike."""
    runs = run(engine, [world(written(name, k)) for k in (0, 1, 2)], "free")
    falls = set() if name == "contact-friction" else {s for s in STATE if s.startswith("stick_")}
    assert [s for s in STATE - falls | TOUCH if not equal(runs[s])] == []


def test_softness_matters_in_contact_alone(engine: type[Engine]) -> None:
    """Move fingers that touch nothing as without it, within 32-bit rounding.

    SAPIEN solves soft contacts otherwise, and free joints with them: 2 urad apart. In contact the
    effect moves them by 3 mrad.
    """
    runs = run(engine, [world(written("contact-softness", k)) for k in (0, 1, 2)], "free")
    assert np.abs(runs["joint_rad"] - runs["joint_rad"][:, :1]).max() < 5e-6
    assert equal(runs["stick_pos_m"])


@pytest.mark.parametrize(
    "name", [n for n in registry.names("effect") if registry.load("effect", n).per_joint]
)
def test_no_bound_is_unstable(engine: type[Engine], name: str) -> None:
    """Let a swing of 1 mrad die out at both bounds, without the Coulomb friction that hides it."""
    smooth = [dataclasses.replace(drive, coulomb_nm=0.0) for drive in IDEAL.drives]
    kind, spec = registry.load("effect", name), IDEAL.with_drives(smooth)
    bounds = [kind(magnitude=bound).on_spec(spec) for bound in kind.bounds]
    skip_refused(engine, bounds)
    sim = engine(bounds)
    begin = start("free", 2)
    sim.reset(begin, np.ones(2, dtype=bool))
    speed = [np.abs(sim.advance(begin.joint_rad + 1e-3).joint_rad_s).max(1) for _ in range(50)]
    sim.close()
    assert (np.max(speed[-10:], axis=0) < 0.8 * np.max(speed[:10], axis=0) + 1e-4).all()


def test_effects_are_together_what_they_are_apart(engine: type[Engine]) -> None:
    """Show with a late command and a late sensor what each shows alone, one after the other."""
    texts = ("none", "command-delay=20ms", "sensor-delay=40ms", "command-delay=20ms")
    worlds = [world(t) for t in (*texts[:3], f"{texts[3]},{texts[2]}")]
    late = run(engine, worlds, "free")["measured_rad"]
    assert np.array_equal(late[2:, 2], late[:-2, 0])
    assert np.array_equal(late[2:, 3], late[:-2, 1])
    # The first target is that of the start, so a late command repeats it and then is the same.
    assert not np.array_equal(late[:, 1], late[:, 0])


def test_delays_of_one_joint_add_up(engine: type[Engine]) -> None:
    """Run with 8 ms on all joints and 12 ms more on J3 as with 8 ms on J4 and 20 ms on J3."""
    parts = "command-delay=8ms,command-delay=12ms@J3"
    whole = "command-delay=8ms@J4,command-delay=20ms@J3"
    runs = run(engine, [world(whole), world(parts)], "free")["joint_rad"]
    assert np.array_equal(runs[:, 0, 2:4], runs[:, 1, 2:4])
    assert not np.array_equal(runs[:, 0, 0], runs[:, 1, 0])


NOISY = "encoder-noise=2mrad,command-dropout=30%"


def test_noise_is_the_episodes_own(engine: type[Engine]) -> None:
    """Draw the same noise for the same episode seed, alone or in a batch, and another for another.

    The noise of an effect does not hang on the other worlds.
    """
    quiet, noisy = world("command-delay=3ms"), world(NOISY)
    alone = run(engine, [noisy], "free")["measured_rad"]
    assert np.array_equal(alone, run(engine, [noisy], "free")["measured_rad"])
    batch = run(engine, [quiet, noisy, noisy], "free")["measured_rad"]
    assert np.array_equal(batch[:, 1:], np.repeat(alone, 2, axis=1))
    other = run(engine, [noisy], "free", seed=8)["measured_rad"]
    assert (other != alone).all()
