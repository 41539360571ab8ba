"""Stick and contact: found from grasps by geometry on any engine."""

import dataclasses
from functools import cache

import pytest
from diagnosis_logs import ENGINES, with_short_grasps

from backends.effect import NumberEffect
from backends.shard import simulate
from benchmark.parts import registry
from benchmark.settings.run_spec import RunSpec
from diagnosis.grasp.forward_model import RADIUS, SOFTNESS
from diagnosis.grasp.in_hand import in_hand, stick_report
from diagnosis.grasp.shape import Shape, shape
from diagnosis.logs.log import Log
from diagnosis.motion.held import gaps_m, held
from diagnosis.recording.record import Plan, record
from diagnosis.verdict.result import Report

CATALOGUE = {name: registry.load("effect", name) for name in registry.names("effect")}
SHAPES = ("stick-radius", "contact-softness")
MOTIONS = ("contact-friction", "stick-mass")
NOMINAL = RunSpec(backend="mujoco", task="circle", effects="none").world()


def some(*names: str) -> dict:
    return {name: CATALOGUE[name] for name in names}


def on_mujoco(specs):
    return simulate(registry.load("backend", "mujoco"), specs, 1)


@cache
def log(
    effects: str, backend: str = "mujoco", variants: int = 2, channels: str = "stick,torque"
) -> Log:
    """Short grasps of the reference hand with effects."""
    engine = registry.load("backend", backend)
    spec = RunSpec(backend=backend, task="circle", effects=effects).world()
    plan = Plan(
        protocols=("grasp",),
        channels=("command", "position", *channels.split(",")),
        variants=variants,
        seed=7,
    )
    return with_short_grasps(record(lambda specs: simulate(engine, specs, 1), spec, plan, "test"))


@cache
def shape_of(effects: str, backend: str = "mujoco") -> Shape:
    return shape(NOMINAL, held(log(effects, backend), NOMINAL), on_mujoco)


def shapes_of(effects: str, backend: str = "mujoco") -> Report:
    return shape_of(effects, backend).report(NOMINAL, some(*SHAPES))


def test_gaps_are_what_the_radius_says():
    """Move every gap by the extra radius of the stick."""
    part = held(log("none"), NOMINAL)[0]
    thick = CATALOGUE["stick-radius"](magnitude=0.1).on_spec(NOMINAL)
    extra = gaps_m(NOMINAL, part) - gaps_m(thick, part)
    assert extra == pytest.approx(0.1 * NOMINAL.stick.radius_m, abs=1e-12)


def test_a_lost_stick_ends_the_grasp():
    """Use a grasp up to where the stick falls, and not at all where that is at once."""
    whole = log("none")
    dropped = whole.samples.copy()
    dropped.loc[(dropped.episode == 0) & (dropped.t_s >= 2.0), "stick_z_m"] -= 0.3
    dropped.loc[(dropped.episode == 1) & (dropped.t_s >= 0.5), "stick_z_m"] -= 0.3
    (part,) = held(dataclasses.replace(whole, samples=dropped), NOMINAL)
    assert (part.stick == whole.stick(0)[: len(part.stick)]).all()
    assert part.time_s[-1] == pytest.approx(2.0, abs=0.01)


@pytest.mark.slow
def test_a_soft_contact_is_no_light_stick():
    """Name the softness, not a mass that an engine's contacts would yield alike with."""
    few = some(*SHAPES, *MOTIONS)
    report = stick_report(log("contact-softness=0.06mm/N"), NOMINAL, few, on_mujoco)
    (one,) = report.causes
    assert one.effect == "contact-softness"
    assert one.sizes[0] == pytest.approx(0.06e-3, rel=0.05)


@pytest.mark.parametrize("backend", ENGINES)
def test_nominal_grasps_show_no_shape(backend):
    """Find neither radius nor softness in nominal grasps of any engine."""
    report = stick_report(log("none", backend), NOMINAL, some(*SHAPES), on_mujoco)
    assert report.causes == ()


@pytest.mark.parametrize("soft_mm_n", [0.04, pytest.param(0.2, marks=pytest.mark.slow)])
def test_a_softness_is_named_beside_what_soft_contacts_yield(soft_mm_n):
    """Take off what the engine's contacts yield beside a softness, which is more than without."""
    (one,) = shapes_of(f"contact-softness={soft_mm_n}mm/N").causes
    assert one.sizes[0] == pytest.approx(1e-3 * soft_mm_n, abs=4e-6)


@pytest.mark.parametrize(
    ("effects", "backend", "number", "rigid"),
    [
        ("contact-softness=0.04mm/N", "mujoco", SOFTNESS, False),
        ("stick-radius=-10%", "bullet", RADIUS, True),
    ],
)
def test_contacts_are_of_the_engine_that_a_log_is_from(effects, backend, number, rigid):
    """Choose the nominal engine's contacts for its own log alone, and leave no gap beside them."""
    found = shape_of(effects, backend)
    assert found.chosen.numbers == (number,) and found.chosen.rigid is rigid
    assert found.chosen.worst < 1.0 < found.nominal.worst


def test_unequal_loads_distinguish_radius_from_softness():
    """Name both of a thin stick that is soft, each with its size."""
    both = {
        one.effect: one for one in shapes_of("stick-radius=-8%,contact-softness=0.1mm/N").causes
    }
    assert both["stick-radius"].sizes[0] == pytest.approx(-0.08, abs=0.01)
    assert both["contact-softness"].sizes[0] == pytest.approx(1e-4, rel=0.1)


@pytest.mark.parametrize("backend", ENGINES)
def test_radius_on_any_engine(backend):
    """Measure the stick's radius on an engine that is not the nominal one."""
    (one,) = shapes_of("stick-radius=-10%", backend).causes
    assert one.effect == "stick-radius"
    assert one.sizes[1] <= -0.1 <= one.sizes[2]
    assert one.share > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("backend", registry.names("backend"))
@pytest.mark.parametrize("soft_mm_n", [0.08, 0.2])
def test_softness_on_any_engine(backend, soft_mm_n):
    """Measure a contact's softness beside what the engine's own contacts yield, whichever it is."""
    (one,) = shapes_of(f"contact-softness={soft_mm_n}mm/N", backend).causes
    assert one.effect == "contact-softness"
    assert one.sizes[1] <= soft_mm_n / 1e3 <= one.sizes[2]
    assert one.sizes[0] == pytest.approx(soft_mm_n / 1e3, rel=0.12)


def test_a_wrong_joint_zero_is_no_radius():
    """Say that fingers disagree where one joint's zero is wrong."""
    wrong = log("encoder-bias=1deg@J3")
    report = stick_report(wrong, NOMINAL, some(*SHAPES), on_mujoco)
    assert report.causes == ()
    assert "fingers and stick disagree" in report.missing[0]
    assert "joint zeros" in report.missing[0]


@pytest.mark.slow
@pytest.mark.parametrize("effects", ["stick-mass=100%", "contact-friction=-40%"])
def test_only_pulls_show_friction_and_mass(effects):
    """Take neither mass nor friction for the shape of the stick, and ask for pulls."""
    report = stick_report(log(effects), NOMINAL, some(*SHAPES, *MOTIONS), on_mujoco)
    assert report.causes == ()
    assert report.missing[-1].startswith("contact-friction, stick-mass: not identifiable")
    assert "record --protocol grasp,pull" in report.missing[-1]


def test_no_stick_no_grip():
    """Ask for the stick's pose where it was not logged."""
    blind = log("stick-radius=20%", channels="torque")
    report = stick_report(blind, NOMINAL, CATALOGUE, on_mujoco)
    assert report.causes == ()
    assert any("with the channel stick" in text for text in report.missing)


@pytest.mark.slow
def test_a_radius_that_nobody_may_name_is_no_threshold():
    """Judge taxels on the stick that is there, though its radius is out of the catalogue."""
    thin = log("stick-radius=-10%", "bullet", channels="stick,contact")
    report = in_hand(thin, NOMINAL, some("contact-softness", "taxel-threshold"), on_mujoco)
    assert {one.effect for one in report.causes} == {"unknown"}


def test_an_effect_that_no_test_shows_is_not_ignored():
    """Say of an effect on the stick that no test of a grasp shows that it is not looked for."""

    class Longer(NumberEffect):
        group, dimension, unit = "stick and contact", "length", "mm"
        bounds, number, per_joint = (0.0, 0.1), "stick.length_m", False

    report = stick_report(log("none"), NOMINAL, {"stick-length": Longer}, on_mujoco)
    assert report.causes == () and report.missing[0].startswith("stick-length: not looked for")
