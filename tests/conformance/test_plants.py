"""Every plant of the blind check keeps the contract of `diagnosis.blind.plant.Mechanics`."""

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.blind import faults, motion, rigs, sides, sizing
from diagnosis.blind.draw import Case
from diagnosis.blind.faults import Fault
from diagnosis.blind.make import robot
from diagnosis.blind.plant import MAGNET_SLIP, Plant

FOREIGN = ("presliding", "cascade", "flexgear", "pwm", "filtered")
"""Plants with drive laws of their own that are judged as robots."""
SHORT = ("steps", "push")
RIG = "arm1-7"
every_plant = pytest.mark.parametrize("name", sides.PLANTS)


def case(name: str, rig: str = RIG) -> Case:
    """A case of a robot in which nothing is wrong."""
    return Case(
        number=0,
        mode="none",
        real=name,
        rig=rig,
        channels=("position",),
        protocols=SHORT,
        variants=1,
        faults=(),
        nominal=faults.of_robot(rig, ()),
        excluded=(),
    )


def shown(name: str, faults: tuple[Fault, ...] = (), rig: str = RIG) -> np.ndarray:
    """What a drawn robot's sensors read in two short episodes, position beside motor and torque."""
    spec = rigs.nominal(rig)
    plant = Plant(spec, robot(case(name, rig)))
    for fault in faults:
        plant.add(fault.effect, fault.magnitude, fault.joint)
    rng, rows = np.random.default_rng(1), []
    for k, protocol in enumerate(SHORT):
        one = motion.motion(protocol, spec, np.random.default_rng(k), rigs.rate_hz(rig))
        short = slice(len(one.target_rad) // 4)
        read = plant.run(
            one.target_rad[short], one.push_nm[short], 1 / rigs.rate_hz(rig), rng, slipped=k > 0
        )
        rows.append(np.concatenate([read["position"], read["motor"], read["torque"]], axis=1))
    return np.concatenate(rows)


@every_plant
def test_the_same_robot_shows_the_same(name):
    """Give the same log for the same seed, finite and not constant."""
    first, again = shown(name), shown(name)
    assert np.array_equal(first, again)
    assert np.isfinite(first).all() and (np.ptp(first, axis=0) > 0).all()


@every_plant
def test_robots_of_a_make_differ_as_they_are_drawn(name):
    """Draw one robot from one seed; those of foreign makes are not all alike."""
    make = sides.mechanics(name)
    some = [vars(make.individual(np.random.default_rng(seed))) for seed in (1, 1, 2)]
    assert some[0] == some[1]
    assert (some[0] != some[2]) == (name in FOREIGN)


@every_plant
def test_a_larger_fault_changes_more(name):
    """Move a joint further by a larger fault, of the catalogue and of those outside of it."""
    spec, sound = rigs.nominal(RIG), shown(name)
    for effect in ("kp-scale", "coulomb-friction", "backlash", "end-stop", MAGNET_SLIP):
        most = abs(faults.largest(effect, "j0", spec, np.random.default_rng(0)))
        changes = [
            np.sqrt(np.mean((shown(name, (fault,)) - sound)[:, 0] ** 2))
            for share in (0.15, 0.9)
            for fault in [Fault(effect=effect, joint="j0", magnitude=most * share)]
        ]
        assert changes[0] < changes[1] and changes[1] > sizing.FLOOR_RAD, (effect, changes)


@pytest.mark.parametrize("name", [*FOREIGN, "dart", "bristle", "plain"])
def test_a_healthy_robot_is_near_its_model(name):
    """Leave 0.1 to 5 floors beside the replay of its file; plain MuJoCo leaves nothing."""
    found = sizing._ordinary(case(name), None, 0)[1]
    floors = found.residual_rad / sizing.FLOOR_RAD
    assert floors < 1e-3 if name == "plain" else 0.1 < floors <= sizing.MOST_FLOORS, floors


def test_faults_are_as_large_as_they_are_wanted():
    """Size a fault so that the robot leaves 3 to 30 times what it leaves without."""
    one = replace(
        case("cascade"),
        mode="single",
        faults=(Fault(effect="coulomb-friction", joint="j0", magnitude=0.0),),
    )
    found = sizing.sized(one, (3.0, 30.0), faults.of_arms(), None, 0)
    assert 2.7 < found.times[0] < 33.0
    assert found.left_floors > found.residual_floors > 0.0 and found.faults[0].magnitude > 0.0
    assert found == sizing.sized(one, (3.0, 30.0), faults.of_arms(), None, 0)


@pytest.mark.parametrize("slips", [0.0, 1.0])
@pytest.mark.parametrize("speed", [-0.7, 0.02])
def test_bristles_at_constant_speed_are_coulomb_friction(speed, slips):
    """Reach the sign of the speed, the whole level, once every bristle slides."""
    from diagnosis.blind.mechanics import _two_mass, presliding

    state, own = np.zeros(_two_mass.STATES), np.array([1e-3, slips])
    for _ in range(round(0.05 * 20 / abs(speed) / _two_mass.TICK_S / 50)):
        share = presliding.friction(speed, own, state)
    assert share == pytest.approx(np.sign(speed), abs=1e-3)


def test_bristles_give_way_before_they_slide():
    """Start as a spring: after a small way x a bristle of bend d holds with x / d."""
    from diagnosis.blind.mechanics import _two_mass

    bend = 0.0
    for _ in range(10):
        bend = _two_mass.bristle(1e-3, 1e-3, bend)
    way = 10 * _two_mass.TICK_S * 1e-3
    assert bend == pytest.approx(way / 1e-3, rel=2e-3)


def test_a_cascade_holds_a_few_percent_more_than_kp():
    """Come to rest at (1 + leak) kp times the error, as the integral's gain at rest says."""
    from diagnosis.blind.mechanics import _two_mass, cascade

    own = np.array([4e-4, 0.04, 0.0])
    drive = np.zeros(20)
    drive[0], drive[2] = 10.0, 100.0
    state = np.zeros(_two_mass.STATES)
    for k in range(6000):
        asked = cascade.servo(0.1, 0.0, 0.0, k == 0, drive, own, state)
    assert asked == pytest.approx(1.04 * 10.0 * 0.1, rel=1e-3)


def test_heat_and_stops_have_closed_forms():
    """Warm as 1 - exp(-t / T) under full torque; push as a spring does, and only inwards."""
    from diagnosis.blind.mechanics import _faults

    heat = 0.0
    for _ in range(3000):
        heat = _faults.warmed(heat, 1.0, 1e-3)
    assert heat == pytest.approx(1 - np.exp(-3.0 / _faults.HEAT_S), rel=1e-3)
    for side in (1.0, -1.0):
        own = 0.8 * side, -1.0, 1.0, 10.0, 1.0
        assert _faults.stopped(side * 0.1, side * 5.0, *own) == 0.0
        assert _faults.stopped(side * 0.3, 0.0, *own) == pytest.approx(-side * 30 * 10.0 * 0.1)
        assert _faults.stopped(side * 0.201, side * -50.0, *own) == 0.0


def test_plain_mujoco_falls_as_a_pendulum():
    """Keep the energy of a swing without drive within a thousandth over half a second."""
    rig = next(
        f"arm1-{s}" for s in range(99) if rigs.nominal(f"arm1-{s}").hand.driven[0].joint.axis[1]
    )
    spec = rigs.nominal(rig)
    (body,), (drive,) = spec.hand.driven, spec.drives
    plant = Plant(spec, sides.mechanics("plain")())
    for number in ("kp", "kd", "viscous", "coulomb"):
        plant.numbers[number][:] = 0.0
    plant.numbers["kp"][:] = 1e-9
    target = np.zeros((2001, 1))
    angle = plant.run(target, 0 * target, 5e-4, np.random.default_rng(0))["motor"][:1001, 0]
    speed = np.gradient(angle, 5e-4)
    length = body.com_m[0]
    inertia = body.inertia_kgm2[1] + body.mass_kg * length**2 + drive.rotor_inertia_kgm2
    energy = inertia * speed**2 / 2 - body.mass_kg * 9.81 * length * np.sin(angle)
    swing = np.abs(inertia * speed**2 / 2).max()
    assert np.ptp(energy[2:-2]) < 2e-3 * swing
