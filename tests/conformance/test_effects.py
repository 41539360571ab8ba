"""Every effect keeps the contract: zero is the identity, more is more, it stays in its place."""

import dataclasses

import pytest

from backends import sticks, trx
from backends.effect import UNITS, Effect, NumberEffect
from backends.spec import Drive, Spec
from benchmark import registry
from benchmark.effects import BUILT, parse_effects
from benchmark.errors import UsageError

SPEC = trx.spec(sticks.STICKS["reference"])
JOINTS = SPEC.hand.joint_names
WORMS = tuple(b.joint.name for b in SPEC.hand.driven if b.joint.gear == "worm")


KINDS: dict[str, type[Effect]] = {
    name: registry.load("effect", name) for name in registry.names("effect")
}
ON_SPEC = {name: kind for name, kind in KINDS.items() if kind.on_spec is not Effect.on_spec}
ON_DRIVE = {name: kind for name, kind in KINDS.items() if issubclass(kind, NumberEffect)}
RELATIVE = {name: kind for name, kind in ON_DRIVE.items() if kind.relative}


def each(kinds: dict) -> pytest.MarkDecorator:
    """Run a test for each of these effects."""
    return pytest.mark.parametrize("kind", kinds.values(), ids=kinds.keys())


def name_of(kind: type[Effect]) -> str:
    """The name of an effect on the command line."""
    return kind.__module__.split(".")[-1].replace("_", "-")


def moderate(kind: type[Effect]) -> float:
    """A magnitude within bounds, of which the double is too."""
    return 0.2 * kind.bounds[1]


def applied(text: str, spec: Spec = SPEC) -> Spec:
    """The world with the effects of a command line."""
    for effect in parse_effects(text, spec.hand):
        spec = effect.on_spec(spec)
    return spec


def changes(spec: Spec) -> dict[str, set[str]]:
    """The drive numbers that differ from the ideal hand, by joint."""
    numbers = [f.name for f in dataclasses.fields(Drive)]
    pairs = zip(JOINTS, spec.drives, SPEC.drives, strict=True)
    found = {
        joint: {n for n in numbers if getattr(new, n) != getattr(old, n)}
        for joint, new, old in pairs
    }
    return {joint: names for joint, names in found.items() if names}


@each(KINDS)
def test_zero_is_the_identity(kind: type[Effect]) -> None:
    """Leave the world equal, digest included, at magnitude zero, on all joints and on one."""
    low, high = kind.bounds
    assert low <= 0.0 <= high
    for joint in (None, "J3") if kind.per_joint else (None,):
        spec = kind(magnitude=0.0, joint=joint).on_spec(SPEC)
        assert spec == SPEC
        assert spec.digest == SPEC.digest


@each(ON_SPEC)
def test_larger_setting_larger_change(kind: type[Effect]) -> None:
    """Change the world differently at two magnitudes, and its number more at the larger one."""
    once, twice = (kind(magnitude=k * moderate(kind)).on_spec(SPEC) for k in (1, 2))
    assert len({SPEC.digest, once.digest, twice.digest}) == 3
    if issubclass(kind, NumberEffect):
        for ideal, small, large in zip(SPEC.drives, once.drives, twice.drives, strict=True):
            value, less, more = (getattr(d, kind.field) for d in (ideal, small, large))
            assert more - value == pytest.approx(2 * (less - value))


@each(RELATIVE)
def test_negative_share_lowers(kind: type[NumberEffect]) -> None:
    """Lower the number of a relative effect by the share asked for."""
    spec = kind(magnitude=-0.5).on_spec(SPEC)
    for ideal, small in zip(SPEC.drives, spec.drives, strict=True):
        assert getattr(small, kind.field) == pytest.approx(0.5 * getattr(ideal, kind.field))


@each(ON_DRIVE)
def test_only_its_own_number_changes(kind: type[NumberEffect]) -> None:
    """Touch one number of the drives it is meant for: worm gears or all."""
    spec = kind(magnitude=moderate(kind)).on_spec(SPEC)
    assert changes(spec) == dict.fromkeys(WORMS if kind.gear == "worm" else JOINTS, {kind.field})
    assert spec.with_drives(SPEC.drives) == SPEC


@each(ON_DRIVE)
@pytest.mark.parametrize("joint", ["J3", "J4"])
def test_named_joint_alone_changes(kind: type[NumberEffect], joint: str) -> None:
    """Touch the drive of the named joint and nothing else, whatever its gear."""
    spec = kind(magnitude=moderate(kind), joint=joint).on_spec(SPEC)
    assert changes(spec) == {joint: {kind.field}}
    assert spec.with_drives(SPEC.drives) == SPEC


@pytest.mark.parametrize("joint", ["J9", "J2"])
def test_joint_without_drive_is_refused(joint: str) -> None:
    """Raise ValueError where the named joint is unknown or has no drive."""
    effect = KINDS["backlash"](magnitude=0.01, joint=joint)
    with pytest.raises(ValueError, match=joint):
        effect.on_spec(SPEC)


def test_effects_compose() -> None:
    """Change each number by its own effect, in either order, and add up on one number."""
    texts = ("backlash=1deg", "kp-scale=-10%@J3")
    forth, back = applied(",".join(texts)), applied(",".join(reversed(texts)))
    assert forth == back
    expected = {joint: {"play_rad"} for joint in WORMS}
    expected["J3"] = {"play_rad", "kp_nm_rad"}
    assert changes(forth) == expected
    both = applied("backlash=1deg,backlash=0.5deg@J3")
    plays = {j: d.play_rad for j, d in zip(JOINTS, both.drives, strict=True)}
    assert plays["J0"] == pytest.approx(0.017453292519943295)
    assert plays["J3"] == pytest.approx(1.5 * 0.017453292519943295)


@each(ON_SPEC)
def test_every_effect_composes_with_the_built_hand(kind: type[Effect]) -> None:
    """Change the hand as built as well, and leave its other numbers built."""
    built = applied("built")
    spec = kind(magnitude=moderate(kind)).on_spec(built)
    assert spec.digest != built.digest
    if issubclass(kind, NumberEffect) and kind.gear is None:
        play = [d.play_rad for d in built.drives]
        assert [d.play_rad for d in spec.drives] == play


@each(KINDS)
def test_bounds_are_refused(kind: type[Effect]) -> None:
    """Refuse magnitudes beyond the bounds and numbers that are none, naming what is allowed."""
    name, size = name_of(kind), UNITS[kind.unit][1]
    low, high = (bound / size for bound in kind.bounds)
    for value in (low - 0.01 * (high - low), high + 0.01 * (high - low)):
        with pytest.raises(UsageError, match="out of range"):
            parse_effects(f"{name}={value!r}{kind.unit}", SPEC.hand)
    with pytest.raises(UsageError):
        parse_effects(f"{name}=1e{kind.unit}", SPEC.hand)
    with pytest.raises(UsageError, match="out of range"):
        parse_effects(f"{name}=1e999{kind.unit}", SPEC.hand)


@each(KINDS)
def test_bounds_are_allowed(kind: type[Effect]) -> None:
    """Allow both bounds, written in the usual unit, up to rounding inwards."""
    name, size = name_of(kind), UNITS[kind.unit][1]
    for bound in kind.bounds:
        (effect,) = parse_effects(f"{name}={bound / size * (1 - 1e-12)!r}{kind.unit}", SPEC.hand)
        assert effect.magnitude == pytest.approx(bound, rel=1e-9)


@each(KINDS)
def test_units_are_converted(kind: type[Effect]) -> None:
    """Read every unit of the effect's dimension to the same SI magnitude, and no other unit."""
    name, magnitude = name_of(kind), moderate(kind)
    assert UNITS[kind.unit][0] == kind.dimension
    for unit, (dimension, size) in UNITS.items():
        text = f"{name}={magnitude / size!r}{unit}"
        if dimension == kind.dimension:
            (effect,) = parse_effects(text, SPEC.hand)
            assert effect.magnitude == pytest.approx(magnitude, rel=1e-12)
        else:
            with pytest.raises(UsageError, match=kind.unit):
                parse_effects(text, SPEC.hand)
    with pytest.raises(UsageError, match="no unit"):
        parse_effects(f"{name}=0.1", SPEC.hand)


@pytest.mark.parametrize(
    ("text", "magnitude"),
    [
        ("backlash=1.2deg", 0.020943951023931953),
        ("backlash=20mrad", 0.02),
        ("coulomb-friction=20mNm", 0.02),
        ("viscous-friction=3mNms", 0.003),
        ("rotor-inertia=1000gcm2", 1e-4),
        ("kp-scale=-10%", -0.1),
        ("self-lock=10Nm@J0", 10.0),
    ],
)
def test_known_texts(text: str, magnitude: float) -> None:
    """Read these texts as these SI magnitudes."""
    (effect,) = parse_effects(text, SPEC.hand)
    assert effect.magnitude == pytest.approx(magnitude, rel=1e-12)
    assert effect.joint == ("J0" if "@" in text else None)


def test_built_and_none() -> None:
    """Give the built hand play and lock on its worms alone, and 'none' nothing."""
    assert parse_effects("none", SPEC.hand) == ()
    assert parse_effects("built", SPEC.hand) == parse_effects(BUILT, SPEC.hand)
    assert changes(applied("built")) == dict.fromkeys(WORMS, {"play_rad", "lock_nm"})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("backlsh=1deg", "Did you mean 'backlash'"),
        ("backlash=1deg@J9", "no driven joint named 'J9'"),
        ("backlash=1deg@J2", "no driven joint named 'J2'"),
        ("backlash", "cannot read"),
        ("backlash=1deg,", "no effect named ''"),
        ("backlash=1deg,backlash=2deg", "twice"),
        ("backlash=1deg@J3,backlash=2deg@J3", "twice"),
    ],
)
def test_what_cannot_be_is_refused(text: str, message: str) -> None:
    """Refuse unknown names, fixed joints, fragments and repetitions, saying which."""
    with pytest.raises(UsageError, match=message):
        parse_effects(text, SPEC.hand)
