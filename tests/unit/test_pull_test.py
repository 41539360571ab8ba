"""Friction and mass from sticks that are pulled out of the grip, on engines of all kinds."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from diagnosis_logs import ENGINES

from backends.shard import simulate
from benchmark.parts import registry
from benchmark.settings.run_spec import RunSpec
from diagnosis.grasp import pull_test, slip_model
from diagnosis.grasp.in_hand import stick_report
from diagnosis.logs.log import Log
from diagnosis.motion.held import held
from diagnosis.recording.record import Plan, record

CATALOGUE = {
    name: registry.load("effect", name)
    for name in ("contact-friction", "stick-mass", "stick-radius", "contact-softness")
}
NOMINAL = RunSpec(backend="mujoco", task="circle", effects="none").world()
DT_S = 0.005


def on_mujoco(specs):
    return simulate(registry.load("backend", "mujoco"), specs, 1)


@cache
def log(effects: str, backend: str = "mujoco") -> Log:
    engine = registry.load("backend", backend)
    spec = RunSpec(backend=backend, task="circle", effects=effects).world()
    plan = Plan(
        protocols=("grasp", "pull"),
        channels=("command", "position", "stick", "pull"),
        variants=2,
        seed=7,
    )
    return record(lambda specs: simulate(engine, specs, 1), spec, plan, "test")


@cache
def findings(effects: str, backend: str = "mujoco"):
    report = stick_report(log(effects, backend), NOMINAL, CATALOGUE, on_mujoco)
    return {one.effect: one for one in report.causes}


def fall(mass_kg: float, friction_n: float) -> slip_model.Slip:
    """A slip by Newton's law in small steps, read as a log would be."""
    fine = DT_S / 100
    time = np.arange(0.0, 0.4, fine)
    pull = 100.0 * np.floor(time / DT_S + 1e-9) * DT_S
    travel, speed = np.zeros(len(time)), 0.0
    for k in range(len(time) - 1):
        push = (pull[k] - friction_n) / mass_kg + 9.81
        speed = max(speed + push * fine, 0.0)
        travel[k + 1] = travel[k] + speed * fine
    return slip_model.Slip(
        time_s=time[::100],
        pull_n=pull[::100],
        travel_m=travel[::100],
        weight=9.81,
        noise_m=1e-5,
        pressed_n=np.full(len(time[::100]), np.nan),
    )


@pytest.mark.parametrize("mass_kg", [0.015, 0.03, 0.09])
def test_newton_tells_mass_and_friction(mass_kg):
    """Recover both numbers of a slip that obeys Newton's law."""
    slips = [fall(mass_kg, 12.0), fall(mass_kg, 15.0)]
    log_mass, _, friction_n, left = slip_model.newton(slips, 0.03)
    assert log_mass == pytest.approx(np.log(mass_kg / 0.03), abs=0.05)
    assert friction_n == pytest.approx([12.0, 15.0], rel=0.005)
    assert left < 1.0


@pytest.mark.parametrize("backend", ENGINES)
@pytest.mark.parametrize(
    "effects",
    [
        pytest.param("none", marks=pytest.mark.slow),
        "contact-friction=-30%",
        pytest.param("contact-friction=40%", marks=pytest.mark.slow),
    ],
)
def test_friction_is_named_on_every_engine(backend, effects):
    """Name friction, and nothing else, whatever engine the log is from."""
    found = findings(effects, backend)
    if effects == "none":
        assert not found
        return
    true = float(effects.split("=")[1].strip("%")) / 100
    assert set(found) == {"contact-friction"}
    _, low, high = found["contact-friction"].sizes
    assert low <= true <= high
    assert 1 + found["contact-friction"].sizes[0] == pytest.approx(1 + true, rel=0.05)


@pytest.mark.slow
def test_a_slippery_stick_is_named():
    """Tell a friction so small that the nominal stick would not have slipped yet."""
    found = findings("contact-friction=-80%", "bullet")
    assert found["contact-friction"].sizes[0] < -0.6


@pytest.mark.slow
@pytest.mark.parametrize("backend", ENGINES)
def test_a_heavy_stick_is_named_on_every_engine(backend):
    """Name a stick of thrice the mass, and nothing else."""
    found = findings("stick-mass=200%", backend)
    assert set(found) == {"stick-mass"}
    assert 1 + found["stick-mass"].sizes[0] == pytest.approx(3.0, rel=0.4)


@pytest.mark.slow
def test_a_thick_stick_is_not_rough():
    """Blame a radius, which squeezes more, for a later slip, and not the friction."""
    assert set(findings("stick-radius=15%", "bullet")) == {"stick-radius"}


@pytest.mark.slow
@pytest.mark.parametrize("soft_mm_n", [0.05, 0.12])
def test_a_soft_contact_is_not_a_light_stick(soft_mm_n):
    """Blame softness alone for a slip that begins slowly, and measure it beside the stick."""
    found = findings(f"contact-softness={soft_mm_n}mm/N")
    assert set(found) == {"contact-softness"}
    softness = found["contact-softness"]
    assert softness.sizes[0] == pytest.approx(soft_mm_n / 1e3, rel=0.2)
    assert softness.sizes[1] <= soft_mm_n / 1e3 <= softness.sizes[2]


@pytest.mark.slow
def test_friction_outside_of_the_catalogue_is_unknown():
    """Call a slip `unknown` that only friction could explain, which nobody may name."""
    kinds = {n: k for n, k in CATALOGUE.items() if n != "contact-friction"}
    report = stick_report(log("contact-friction=-30%", "bullet"), NOMINAL, kinds, on_mujoco)
    assert [one.effect for one in report.causes] == ["unknown"]


def test_a_stick_that_does_not_slip_says_nothing():
    """Tell nothing of a pull that was too weak, nor of one that began at once."""
    parts = held(log("none"), NOMINAL, ("pull",))
    weak = [part.every(np.arange(len(part.time_s)) < 210) for part in parts]
    assert pull_test.pull_fit(NOMINAL, weak, on_mujoco, rigid=True, soft=False) is None
    early = dataclasses.replace(parts[0], pull_n=parts[0].pull_n + 1.0)
    assert slip_model.slip(early, NOMINAL.gravity_m_s2) is None


@pytest.mark.slow
def test_a_vague_mass_says_what_would_tell():
    """Say how near the nominal mass is known to be, and what would tell more."""
    report = stick_report(log("none", "bullet"), NOMINAL, CATALOGUE, on_mujoco)
    (said,) = report.missing
    assert not report.causes
    assert "stick-mass" in said and "weigh the stick" in said


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["bullet", pytest.param("sapien", marks=pytest.mark.slow)])
def test_newton_tells_a_mass_where_contacts_are_soft(backend):
    """Name mass and softness together where sticks slip by Newton's law, which holds anywhere."""
    found = findings("stick-mass=180%,contact-softness=0.2mm/N", backend)
    assert set(found) == {"stick-mass", "contact-softness"}
    _, low, high = found["stick-mass"].sizes
    assert low <= 1.8 <= high


@pytest.mark.slow
@pytest.mark.parametrize("backend", ENGINES)
def test_friction_is_named_where_contacts_are_soft(backend):
    """Measure friction by the forces of a replay, which need not creep as the log does."""
    found = findings("contact-friction=16%,contact-softness=0.27mm/N", backend)
    assert set(found) == {"contact-friction", "contact-softness"}
    assert found["contact-friction"].sizes[0] == pytest.approx(0.16, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("backend", ENGINES)
def test_sticks_that_slip_by_newton_have_contacts_that_yield_by_nothing(backend):
    """Name a softness as small as what the nominal engine's own contacts yield, and a radius."""
    found = findings("contact-softness=0.042mm/N,stick-radius=-3.5%", backend)
    assert set(found) == {"contact-softness", "stick-radius"}
    assert found["contact-softness"].sizes[0] == pytest.approx(4.2e-5, rel=0.3)


def pulled(friction: float = 0.0, mass: float = -0.02) -> pull_test.PullFit:
    """What two pulls tell, as logarithms."""
    logs, std = np.array([friction, mass]), np.array([0.03, 0.15])
    return pull_test.PullFit(logs=logs, std=std, left=1.0, episodes=2, gives_way=True)


SEEN = pulled()


def test_a_mass_is_as_sure_in_the_world_that_has_it():
    """Doubt a light stick, not a heavy one of which a world has more already."""
    heavy, light = pulled(mass=0.6), pulled(mass=-0.6)
    again = dataclasses.replace(SEEN, logs=SEEN.logs + heavy.surely)
    assert heavy.sure.tolist() == again.sure.tolist() == [False, True]
    assert light.sure.tolist() == [False, False] and light.spread[1] > heavy.spread[1]


def test_what_pulls_tell_is_named_by_the_catalogue():
    """Name a heavy stick with its size; call `unknown` what nobody may name; say what is vague."""
    (heavy,) = pulled(mass=np.log(3.0)).report(CATALOGUE).causes
    assert (heavy.effect, heavy.sizes[0]) == ("stick-mass", pytest.approx(2.0))
    slippery = pulled(friction=np.log(0.7))
    for kinds, name in ((CATALOGUE, "contact-friction"), ({}, "unknown")):
        assert [one.effect for one in slippery.report(kinds).causes] == [name]
    vague = SEEN.report(CATALOGUE)
    assert not vague.causes and "weigh the stick" in vague.missing[0]
