"""Effects as they are written: units, bounds, joints, and what is refused, for every effect."""

from dataclasses import replace

import pytest

from backends import trx
from backends.effect import ON_SLIDES, UNITS, Effect
from backends.spec import Hand
from backends.sticks import STICKS
from benchmark.errors import UsageError
from benchmark.parts import registry
from benchmark.settings.effects import BUILT, effect_name, effect_text, parse_effects
from diagnosis.verdict.result import JointFacts, cause
from diagnosis.verdict.sentences import size as said_size

HAND = trx.HAND
KINDS: dict[str, type[Effect]] = {
    name: registry.load("effect", name) for name in registry.names("effect")
}
OF_NO_JOINT = {name: kind for name, kind in KINDS.items() if not kind.per_joint}


def each(kinds: dict) -> pytest.MarkDecorator:
    """Run a test for each of these effects."""
    return pytest.mark.parametrize("kind", kinds.values(), ids=kinds.keys())


def written(kind: type[Effect], magnitude: float) -> str:
    """An effect as on the command line, in its usual unit."""
    return f"{effect_name(kind(magnitude=0.0))}={magnitude / UNITS[kind.unit][1]!r}{kind.unit}"


def test_names_that_stand_for_effects() -> None:
    """Give no effect for 'none' and nothing, and the built hand's for 'built', among others too."""
    assert parse_effects("none", HAND) == parse_effects("", HAND) == ()
    built = parse_effects(BUILT, HAND)
    assert parse_effects("built", HAND) == built
    assert parse_effects("built, kp-scale=-10%", HAND)[:-1] == built


@each(KINDS)
def test_bounds_are_refused(kind: type[Effect]) -> None:
    """Refuse magnitudes beyond the bounds and numbers that are none, naming what is allowed."""
    low, high = kind.bounds
    name = effect_name(kind(magnitude=0.0))
    for value in (low - 0.01 * (high - low), high + 0.01 * (high - low)):
        with pytest.raises(UsageError, match="out of range"):
            parse_effects(written(kind, value), HAND)
    with pytest.raises(UsageError, match="not a number"):
        parse_effects(f"{name}=1e{kind.unit}", HAND)
    with pytest.raises(UsageError, match="out of range"):
        parse_effects(f"{name}=1e999{kind.unit}", HAND)


@each(KINDS)
def test_bounds_are_allowed(kind: type[Effect]) -> None:
    """Allow both bounds, written in the usual unit, up to rounding inwards."""
    for bound in kind.bounds:
        (effect,) = parse_effects(written(kind, bound * (1 - 1e-12)), HAND)
        assert effect.magnitude == pytest.approx(bound, rel=1e-9)


@each(KINDS)
def test_units_are_converted(kind: type[Effect]) -> None:
    """Read every unit of the effect's dimension to the same SI magnitude, and no other unit."""
    name, magnitude = effect_name(kind(magnitude=0.0)), kind.bounds[1] / 5
    assert UNITS[kind.unit][0] == kind.dimension
    for unit, (dimension, size) in UNITS.items():
        text = f"{name}={magnitude / size!r}{unit}"
        if dimension == kind.dimension:
            (effect,) = parse_effects(text, HAND)
            assert effect.magnitude == pytest.approx(magnitude, rel=1e-12)
        else:
            with pytest.raises(UsageError, match=kind.unit):
                parse_effects(text, HAND)
    with pytest.raises(UsageError, match="no unit"):
        parse_effects(f"{name}=0.1", HAND)


@each(KINDS)
def test_what_is_written_is_read_again(kind: type[Effect]) -> None:
    """Write an effect of all joints, or of one, as a text that gives the same effect."""
    for joint in (None, HAND.ends[0].joint.name)[: 1 + kind.per_joint]:
        wanted = kind(magnitude=kind.bounds[1] / 3, joint=joint)
        (effect,) = parse_effects(effect_text(wanted, trx.spec(STICKS["reference"])), HAND)
        assert (type(effect), effect.joint) == (kind, joint)
        assert effect.magnitude == pytest.approx(wanted.magnitude, rel=1e-11)


@each(KINDS)
def test_units_of_slides_are_read(kind: type[Effect]) -> None:
    """Read and say sizes of slides in their own units: N for Nm, um for degrees."""
    name, slide = effect_name(kind(magnitude=0.0)), rail()
    magnitude = kind.bounds[1] / 5
    unit = kind.unit_of(magnitude, slides=True)
    (effect,) = parse_effects(f"{name}={magnitude / UNITS[unit][1]!r}{unit}", slide)
    assert effect.magnitude == pytest.approx(magnitude, rel=1e-12)
    if kind.per_joint and kind.dimension in ON_SLIDES:
        with pytest.raises(UsageError, match=f"allowed: .*{unit}"):
            parse_effects(f"{name}=1{kind.unit}", slide)


def rail() -> Hand:
    """The hand with slides instead of hinges."""
    spec = trx.spec(STICKS["reference"])
    joints = (replace(b, joint=replace(b.joint, slides=True)) for b in spec.hand.driven)
    return spec.with_driven(joints).hand


@pytest.mark.parametrize(
    ("name", "size", "slides", "count", "words"),
    [
        ("coulomb-friction", 19.4, True, 0.0, "19.4 N (18 to 21)"),
        ("coulomb-friction", 19.4, False, 0.0, "19.4 Nm (18 to 21)"),
        ("coulomb-friction", 0.0194, False, 0.0, "19.4 mNm (18 to 21)"),
        ("viscous-friction", 203.5, True, 1e-7, "204 Ns/m (189 to 220)"),
        ("backlash", 0.01, False, 0.0, "0.573 deg (0.532 to 0.62; whole 1.15 deg, 20 mrad)"),
        ("backlash", 1e-4, True, 1e-5, "100 um (92.8 to 108; whole 200 um, 20 counts)"),
        ("encoder-bias", -0.01, False, 1e-3, "-0.573 deg (-0.532 to -0.62; -10 mrad, -10 counts)"),
        ("payload", 0.5, False, 0.0, "50 % (46.4 to 54.1; 0.4 kg)"),
        (
            "series-elasticity",
            24.0,
            False,
            0.0,
            "24 times (22.3 to 26; stiffness 300 Nm/rad)",
        ),
        ("series-elasticity", 0.5, True, 0.0, "50 % (46.4 to 54.1; stiffness 1.44e+04 N/m)"),
    ],
)
def test_sizes_are_said_in_the_units_of_a_joint(name, size, slides, count, words) -> None:
    """Say N of slides, whole play beside half of it, radians beside degrees, counts, kg, Nm/rad."""
    ends = (size, size * 18 / 19.4, size * 21 / 19.4)
    at = JointFacts(slides=slides, count=count, mass_kg=0.8, stiffness=7200.0, geared=False)
    one = cause(name, ends, KINDS, at=at)
    assert said_size(one, f"{one.low:.3g} to {one.high:.3g}") == words


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
        ("command-rate-limit=0.2s/rad", 0.2),
        ("taxel-drift=0.01mm/s", 1e-5),
        ("contact-softness=0.2mm/N", 2e-4),
        ("taxel-threshold=-0.1mm", -1e-4),
    ],
)
def test_known_texts(text: str, magnitude: float) -> None:
    """Read these texts as these SI magnitudes."""
    (effect,) = parse_effects(text, HAND)
    assert effect.magnitude == pytest.approx(magnitude, rel=1e-12)
    assert effect.joint == ("J0" if "@" in text else None)


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
        ("built,backlash=2deg", "twice.*built is backlash=1deg"),
        ("built,self-lock=5Nm", "twice"),
        ("built,built", "twice"),
        ("none,backlash=1deg", "has 'none' and other effects"),
        ("built,none", "has 'none' and other effects"),
    ],
)
def test_what_cannot_be_is_refused(text: str, message: str) -> None:
    """Refuse unknown names, fixed joints, fragments, repetitions and contradictions."""
    with pytest.raises(UsageError, match=message):
        parse_effects(text, HAND)


@each(OF_NO_JOINT)
def test_joint_on_an_effect_without_joints_is_refused(kind: type[Effect]) -> None:
    """Refuse a joint where none is acted upon, saying what to leave out."""
    with pytest.raises(UsageError, match="leave '@J3' out"):
        parse_effects(written(kind, kind.bounds[1] / 5) + "@J3", HAND)
