"""Every effect keeps the contract: zero is the identity, more is more, it stays in its place."""

import dataclasses
import math
import re
from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from backends import sticks, trx
from backends.effect import UNITS, Effect, NumberEffect
from backends.engine import Engine
from backends.randomize import randomize
from backends.spec import Spec, field_names
from benchmark.errors import UsageError
from benchmark.parts import registry
from benchmark.settings.effects import BUILT, effect_name, parse_effects
from benchmark.settings.run_spec import RunSpec

SPEC = trx.spec(sticks.STICKS["reference"])
JOINTS = SPEC.hand.joint_names
WORMS = tuple(b.joint.name for b in SPEC.hand.driven if b.joint.gear == "worm")
ENDS = tuple(body.joint.name for body in SPEC.hand.ends)
KINDS: dict[str, type[Effect]] = {
    name: registry.load("effect", name) for name in registry.names("effect")
}
NUMBERS = {name: kind for name, kind in KINDS.items() if issubclass(kind, NumberEffect)}
RELATIVE = {name: kind for name, kind in NUMBERS.items() if kind.relative}
OF_JOINTS = {name: kind for name, kind in KINDS.items() if kind.per_joint}


def each(kinds: dict) -> pytest.MarkDecorator:
    """Run a test for each of these effects."""
    return pytest.mark.parametrize("kind", kinds.values(), ids=kinds.keys())


def moderate(kind: type[Effect]) -> float:
    """A magnitude within bounds, of which the double is too."""
    return 0.2 * kind.bounds[1]


def written(kind: type[Effect], magnitude: float, joint: str = "") -> str:
    """An effect as on the command line."""
    name = effect_name(kind(magnitude=magnitude))
    return f"{name}={magnitude / UNITS[kind.unit][1]!r}{kind.unit}{'@' if joint else ''}{joint}"


def applied(text: str, spec: Spec = SPEC) -> Spec:
    """The world with the effects of a command line."""
    for effect in parse_effects(text, spec.hand):
        spec = effect.on_spec(spec)
    return spec


def leaves(part: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every number and word of a spec with its path, such as .hand.bodies.1.mass_kg."""
    if isinstance(part, tuple):
        for index, item in enumerate(part):
            yield from leaves(item, f"{path}.{index}")
    elif dataclasses.is_dataclass(part):
        for field in dataclasses.fields(part):
            yield from leaves(getattr(part, field.name), f"{path}.{field.name}")
    else:
        yield path, part


def changes(spec: Spec, base: Spec = SPEC) -> dict[str, set[str]]:
    """The numbers that differ, by joint; those of no joint under an empty name."""
    old, found = dict(leaves(base)), {}
    for path, value in leaves(spec):
        if value != old[path]:
            body = re.match(r"\.hand\.bodies\.(\d+)", path)
            joint = SPEC.hand.bodies[int(body[1])].joint.name if body else ""
            *_, part, field = ["spec", *re.findall(r"[a-z]\w*", path)]
            found.setdefault(joint, set()).add(f"{part.replace('bodies', 'body')}.{field}")
    return found


def where(kind: type[Effect]) -> tuple[str, ...]:
    """The joints that an effect concerns when it names none."""
    if not kind.per_joint:
        return ("",)
    if kind.at_ends:
        return ENDS
    return WORMS if kind.gear == "worm" else JOINTS


def test_the_catalogue_is_whole() -> None:
    """Hold every effect of the design's catalogue."""
    catalogue = """backlash self-lock coulomb-friction stiction viscous-friction load-friction
    series-elasticity rotor-inertia link-mass gravity-tilt kp-scale kd-scale torque-limit
    command-delay command-rate-limit command-dropout dead-zone encoder-bias encoder-scale
    encoder-resolution sensor-delay encoder-noise taxel-threshold taxel-drift taxel-dropout
    taxel-halo stick-mass stick-radius contact-friction contact-softness"""
    assert set(catalogue.split()) <= set(KINDS)


@each(KINDS)
def test_zero_is_the_identity(kind: type[Effect]) -> None:
    """Leave the world equal, digest included, at magnitude zero, on all joints and on one."""
    low, high = kind.bounds
    assert low <= 0.0 < high
    for joint in (None, "J3") if kind.per_joint else (None,):
        spec = kind(magnitude=0.0, joint=joint).on_spec(SPEC)
        assert spec == SPEC
        assert spec.digest == SPEC.digest


@each(KINDS)
def test_its_numbers_are_numbers_of_the_spec(kind: type[Effect]) -> None:
    """Name numbers for which every engine answers."""
    assert kind.spec_fields()
    assert set(kind.spec_fields()) <= set(field_names())


@each(KINDS)
def test_only_its_own_number_changes(kind: type[Effect]) -> None:
    """Touch its number, of worm gears or of all joints where it acts on joints, and no other."""
    spec = kind(magnitude=moderate(kind)).on_spec(SPEC)
    assert changes(spec) == dict.fromkeys(where(kind), set(kind.spec_fields()))


@each(OF_JOINTS)
@pytest.mark.parametrize("joint", ["J3", "J4"])
def test_named_joint_alone_changes(kind: type[Effect], joint: str) -> None:
    """Touch the number of the named joint and nothing else, whatever its gear."""
    effect = kind(magnitude=moderate(kind), joint=joint)
    assert changes(effect.on_spec(SPEC)) == {joint: set(kind.spec_fields())}


@each(KINDS)
def test_larger_setting_larger_change(kind: type[Effect]) -> None:
    """Change the world differently at two magnitudes, and its number more at the larger one."""
    worlds = [SPEC, *(kind(magnitude=k * moderate(kind)).on_spec(SPEC) for k in (1, 2))]
    assert len({world.digest for world in worlds}) == 3
    for number in kind.spec_fields():
        base, less, more = (np.ravel(world.values(number)) for world in worlds)
        touched = less != base
        assert touched.any()
        assert np.array_equal(touched, more != base)
        assert (np.abs(more - base)[touched] > np.abs(less - base)[touched]).all()


@each(NUMBERS)
def test_magnitude_is_what_is_added(kind: type[NumberEffect]) -> None:
    """Add the magnitude, or its share of the number; compliances add in their inverse."""
    spec = kind(magnitude=moderate(kind)).on_spec(SPEC)
    base, new = (np.array(world.values(kind.number)) for world in (SPEC, spec))
    base, new = base[new != base], new[new != base]
    if kind is KINDS["series-elasticity"]:
        base, new = 1 / base, 1 / new
    share = kind.relative or kind is KINDS["series-elasticity"]
    assert new - base == pytest.approx(moderate(kind) * (base if share else 1.0))


@each(RELATIVE)
def test_negative_share_lowers(kind: type[NumberEffect]) -> None:
    """Lower the number of a relative effect by the share asked for."""
    spec = kind(magnitude=-0.5).on_spec(SPEC)
    new, base = (np.array(world.values(kind.number)) for world in (spec, SPEC))
    assert new[new != base] == pytest.approx(0.5 * base[new != base])


def test_tilt_turns_gravity_and_keeps_its_size() -> None:
    """Turn gravity by the angle, towards +x where it is positive."""
    x, y, z = applied("gravity-tilt=10deg").gravity_m_s2
    assert math.hypot(x, z) == pytest.approx(9.81)
    assert math.degrees(math.atan2(x, -z)) == pytest.approx(10.0)
    assert y == 0.0


@pytest.mark.parametrize("joint", ["J9", "J2"])
def test_joint_without_drive_is_refused(joint: str) -> None:
    """Raise ValueError where the named joint is unknown or has no drive."""
    effect = KINDS["backlash"](magnitude=0.01, joint=joint)
    with pytest.raises(ValueError, match=joint):
        effect.on_spec(SPEC)


def test_order_does_not_matter() -> None:
    """Give the same world in either order, for every two effects."""
    effects = [kind(magnitude=moderate(kind)) for kind in KINDS.values()]
    for one, other in combinations(effects, 2):
        assert one.on_spec(other.on_spec(SPEC)) == other.on_spec(one.on_spec(SPEC))


@each(OF_JOINTS)
def test_effects_on_one_number_add_up(kind: type[Effect]) -> None:
    """Add amounts, and multiply shares, where one effect is on all joints and again on one."""
    joint = "J3"
    both = applied(f"{written(kind, moderate(kind), joint)},{written(kind, moderate(kind))}")
    once = kind(magnitude=moderate(kind)).on_spec(SPEC)
    twice = kind(magnitude=moderate(kind), joint=joint).on_spec(once)
    assert dict(leaves(both)) == pytest.approx(dict(leaves(twice)))
    assert changes(both, once) == {joint: set(kind.spec_fields())}


@each(KINDS)
def test_every_effect_composes_with_the_built_hand(kind: type[Effect]) -> None:
    """Change the hand as built as well, and leave its other numbers built."""
    built = applied("built")
    spec = kind(magnitude=moderate(kind)).on_spec(built)
    assert changes(spec, built) == dict.fromkeys(where(kind), set(kind.spec_fields()))


def test_built_and_none() -> None:
    """Give the built hand play and lock on its worms alone, and 'none' nothing."""
    assert applied("none") == SPEC
    assert applied("built") == applied(BUILT)
    expected = dict.fromkeys(WORMS, {"drive.play_rad", "drive.lock_nm"})
    assert changes(applied("built")) == expected


@each(KINDS)
def test_effect_that_an_engine_refuses_is_refused(
    kind: type[Effect], engine: type[Engine], backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Name effect, reason and engine on the command line, and number and reason in the library.

    The engine is the real one, told to refuse; its own answers may be that one day.
    """
    number = kind.spec_fields()[0]
    monkeypatch.setattr(engine, "support", {**engine.support, number: "refused: a test says so"})
    text = written(kind, moderate(kind))
    run = RunSpec(backend=backend, task="line", effects=text)
    with pytest.raises(UsageError, match=f"{text.split('=')[0]} is refused.*so.*{backend}"):
        run.make_env([run.world()], 0, workers=1)
    if not any(np.any(SPEC.values(name)) for name in kind.spec_fields()):
        with pytest.raises(ValueError, match=f"{number} is refused: a test says so"):
            engine([run.world()])


def test_engines_answer_as_recorded(engine: type[Engine], backend: str) -> None:
    """Build a world with every effect that the engine does not refuse, and refuse the others."""
    for kind in KINDS.values():
        run = RunSpec(backend=backend, task="line", effects=written(kind, moderate(kind)))
        if any(engine.support[number].startswith("refused") for number in kind.spec_fields()):
            with pytest.raises(UsageError, match=backend):
                run.make_env([run.world()], 0, workers=1)
        else:
            engine([run.world()]).close()


def test_drawn_effects_stay_on_their_gears() -> None:
    """Draw play for worm gears alone, as an effect that names no joint acts on them alone."""
    (spread,) = parse_effects("backlash=0.5deg", SPEC.hand)
    rng = np.random.default_rng(0)
    worlds = [randomize(SPEC, (spread,), rng) for _ in range(20)]
    touched = {joint for world in worlds for joint in changes(world)}
    assert touched == set(WORMS)
