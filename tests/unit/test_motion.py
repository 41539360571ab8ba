"""Replays along a measured motion: against a closed form, MuJoCo, and bad logs."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from arms import HZ, LINKS, Real, log_of
from arms import KD as KD_NMS_RAD
from arms import KP as KP_NM_RAD

from backends.catalogue import catalogue
from backends.effect import with_effects
from backends.effects.sensor_delay import Effect as Late
from diagnosis.evidence.evidence import evidence
from diagnosis.evidence.log_faults import checked
from diagnosis.logs.log import make_log
from diagnosis.models.parameters import parameters
from diagnosis.models.world import World
from diagnosis.motion.columns import FIRM, KD, KP, LIMIT, LINK, LOCK, ONE_WAY, STOP, with_load
from diagnosis.motion.integrate import FROM, THEN, UNTIL
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.agreement import HORIZON_S, begun
from diagnosis.replay.dynamics import dynamics, holding
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs


def limb_of(log):
    """The only limb of an arm's log."""
    (part,) = limbs(mjcf_world(log))
    return Limb(spec=part, recordings=recordings(log, part), rigid=True)


@pytest.mark.parametrize("joints", [1, 2, 3])
def test_replays_are_what_mujoco_does(joints):
    """Stay within 0.3 mrad of plain MuJoCo at half the step, its sensor's noise aside."""
    log = log_of(Real(joints=joints, noise_rad=1e-9))
    limb = limb_of(log)
    apart = limb.measured[:, 0] - limb.simulate(limb.nominal)[:, 0]
    assert np.sqrt(np.mean(apart**2)) < 3e-4


def test_a_joint_that_moves_at_once_starts_where_it_was():
    """Begin at the first reading where the next ones have moved, and at their mean where not."""
    log = log_of(Real())
    steps = log.samples[log.samples["episode"] == 0]
    jump = int(np.flatnonzero(np.diff(steps["command_rad.J0"]))[0]) + 1
    cut = log.samples.drop(index=log.samples.index[:jump]).reset_index(drop=True)
    (part,) = limbs(mjcf_world(log))
    whole, begun = (recordings(one, part)[0] for one in (log, replace(log, samples=cut)))
    read = begun.measured[:3, 0, 0]
    assert np.ptp(read) > 1e-3 and begun.start[0] == read[0]
    assert whole.start[0] != whole.measured[0, 0, 0]


def test_replays_allow_for_readings_that_are_known_to_be_late():
    """Stay as close where a sensor is known to be late, as of motions that were read at once."""
    log, late = log_of(Real(joints=3, noise_rad=1e-9)), 20
    samples = log.samples.copy()
    read = [name for name in samples.columns if name.startswith("position")]
    delayed = samples.groupby("episode")[read].shift(late)
    samples[read] = delayed.fillna(samples.groupby("episode")[read].transform("first"))
    log = make_log(log.meta, samples, log.mjcf_xml)
    (part,) = limbs(with_effects(mjcf_world(log), [Late(magnitude=late / HZ)]))
    limb = Limb(spec=part, recordings=recordings(log, part), rigid=True)
    apart = limb.measured[:, 0] - limb.simulate(limb.nominal)[:, 0]
    assert np.sqrt(np.mean(apart**2)) < 3e-4


def test_a_pendulum_settles_where_its_weight_and_gain_balance():
    """Sag by m g l / kp at rest, to 1e-4 rad: the closed form of the first held target."""
    log = log_of(Real())
    limb = limb_of(log)
    shown = limb.simulate(limb.nominal)[:, 0, 0]
    held = limb.time_s[0] < 0.45
    angle = shown[: len(held)][held][-5:].mean()
    length, mass = LINKS
    weight = mass * 9.81 * length / 2 * np.cos(angle)
    assert angle == pytest.approx(weight / KP_NM_RAD, abs=1e-4)


def test_drives_that_carry_weight_carry_no_payload():
    """Load a joint by what is heavier, whether or not its drive carries the weight of its file."""
    log = log_of(Real(joints=2))
    (part,) = limbs(mjcf_world(log))
    bodies = tuple(replace(body, carried=1.0) for body in part.hand.bodies)
    carrying = replace(part, hand=replace(part.hand, bodies=bodies))
    limbs_ = [
        Limb(spec=spec, recordings=recordings(log, spec), rigid=True) for spec in (part, carrying)
    ]
    plain, carried = (limb.along[0].model for limb in limbs_)
    assert np.abs(plain[1] - carried[1]).max() > 1.0
    for effect in ("link-mass", "payload"):
        (m, h), (same_m, same_h) = (_more(limb, effect) for limb in limbs_)
        assert np.abs(h).max() > 0.1
        assert np.allclose(m, same_m, atol=1e-9) and np.allclose(h, same_h, atol=1e-9)


@pytest.mark.parametrize("reads", [False, True])
def test_torques_may_hold_what_drives_carry(reads):
    """Tell whether a log's torques have it: at rest they are the weight then, and else nothing."""
    limb = limb_of(log_of(Real(joints=2, carried=1.0)))
    bearing = limb.spec
    carrying = [replace(body, carried=1.0) for body in bearing.hand.driven]
    limb = replace(limb, spec=bearing.with_driven(carrying))
    shown = replace(limb, reads_carried=reads).simulate(limb.nominal, edges=limb.every_sample)
    ends = np.cumsum([len(r.time_s) for r in limb.recordings])[:-1]
    every = []
    for one, read in zip(limb.recordings, np.split(shown[:, 2], ends), strict=True):
        measured = one.measured.copy()
        measured[:, 2] = read
        every.append(replace(one, measured=measured))
    found, notes = checked(replace(limb, recordings=tuple(every)))
    assert found.reads_carried == reads and not notes
    rests = int(np.flatnonzero(found.time_s[0] < 0.45)[-1])  # before the first step
    weight = holding(bearing, found.measured[rests : rests + 1, 0])[0]
    torque = found.simulate(found.nominal)[rests, 2]
    assert torque == pytest.approx(reads * weight, abs=0.02 * np.abs(weight).max())


@pytest.mark.parametrize("joints", [1, 2, 3])
def test_loads_and_gravity_add_to_the_nominal_model(joints):
    """Give the mass matrices and torques of a world whose links and gravity are others."""
    limb = limb_of(log_of(Real(joints=joints)))
    path, load, gravity = limb.along[0], limb.nominal[:, LINK].copy(), np.array([1.0, 2.0, -9.0])
    load += np.random.default_rng(0).uniform(0.1, 0.4, load.shape)
    pairs = zip(limb.spec.hand.driven, load, strict=True)
    other = limb.spec.with_driven(with_load(*pair) for pair in pairs)
    other = replace(other, gravity_m_s2=tuple(gravity))
    for one, wanted in zip(
        path.of(load, gravity), dynamics(other, path.angle_rad, path.speed_rad_s), strict=False
    ):
        assert one == pytest.approx(wanted, abs=1e-12)


def _more(limb, effect):
    """What M and h gain where each link has an effect."""
    said = evidence(limb)
    every = parameters(catalogue(), said, 0.05, 1.0)
    some = {k: 0.5 for k, one in enumerate(every) if one.effect == effect and one.part_of is None}
    numbers, _ = World(said, every).numbers(some)
    (m, h, *_), path = limb.along[0].model, limb.along[0]
    loaded = path.of(numbers[:, LINK], np.array(limb.spec.gravity_m_s2))
    return loaded[0] - m, loaded[1] - h


def test_numbers_change_what_is_shown_to_first_order():
    """Give slopes that predict a small change of two gains to a hundredth."""
    limb = limb_of(log_of(Real()))
    base = limb.simulate(limb.nominal)

    def moved(kp, kd):
        numbers = limb.nominal.copy()
        numbers[:, KP] *= 1 + kp
        numbers[:, KD] *= 1 + kd
        return limb.simulate(numbers) - base

    both, sum_ = moved(1e-4, 1e-4), moved(1e-4, 0) + moved(0, 1e-4)
    assert np.abs(both - sum_).max() < 0.01 * np.abs(both).max()


def test_a_self_locking_gear_holds_its_load():
    """Let gravity turn no worm that was raised by 5 mrad; without the lock it sags back."""
    limb = limb_of(log_of(Real()))
    locked = limb.nominal.copy()
    locked[:, LOCK] = 50.0
    held = limb.time_s[0] < 0.45
    lifted = (
        (limb.simulate(numbers, shift=-5e-3) - limb.simulate(numbers))[: len(held)][held][-1, 0, 0]
        for numbers in (locked, limb.nominal)
    )
    assert next(lifted) == pytest.approx(-5e-3, abs=2e-4)
    assert next(lifted) == pytest.approx(0.0, abs=2e-4)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_friction_in_one_direction_holds_from_one_side(sign):
    """Stay 5 mrad on the side that the friction would have to leave; come back from the other."""
    limb = limb_of(log_of(Real()))
    rough = limb.nominal.copy()
    rough[:, ONE_WAY] = 50.0 * sign
    held = limb.time_s[0] < 0.45
    sag = limb.simulate(limb.nominal)[: len(held)][held][-1, 0, 0]
    ends = [limb.simulate(rough, shift=s)[: len(held)][held][-1, 0, 0] for s in (-5e-3, 5e-3)]
    stays, returns = ends if sign > 0.0 else ends[::-1]
    start = limb.measured[0, 0, 0]
    assert stays == pytest.approx(start - sign * 5e-3, abs=2e-4)
    assert sign * (returns - sag) == pytest.approx(0.0, abs=2e-4)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_end_stop_holds_a_rigid_drive(side):
    """Rest where the stop's spring and the servo balance, and nowhere beyond the stop otherwise."""
    limb = limb_of(log_of(Real()))
    blocks, command = limb.simulate(limb.nominal)[:, 0, 0], limb.recordings[0].command[:, 0]
    k = int(np.argmax(side * command[: len(limb.time_s[0])])) + 1
    rest = np.flatnonzero(command == command[k])[-1]
    block = int(np.searchsorted(limb.time_s[0], limb.recordings[0].time_s[rest])) - 1
    numbers, firm = limb.nominal.copy(), 9.0 * KP_NM_RAD
    at = 0.2 * side
    numbers[0, STOP], numbers[0, FIRM] = side * (np.pi - 0.2), firm
    stopped = limb.simulate(numbers)[:, 0, 0]
    wanted = at + (blocks[block] - at) * KP_NM_RAD / (KP_NM_RAD + firm)
    assert stopped[block] == pytest.approx(wanted, abs=2e-3)
    assert (side * stopped).max() < 0.2 + 0.05


@pytest.mark.parametrize("coulomb_nm", [0.0, 1.0])
@pytest.mark.parametrize(("late", "ago", "read"), [(0, 0, FROM), (1, 0, THEN), (1, 1, UNTIL)])
def test_when_torques_were_read_is_seen(late, ago, read, coulomb_nm):
    """At a step torques differ by all that a drive asks for, in motion by what a tick changes."""
    log = log_of(Real(coulomb_nm={0: coulomb_nm}))
    samples, before_s = log.samples.copy(), ago * limb_of(log).dt
    command = samples.groupby("episode")["command_rad.J0"].shift(late).bfill()
    angle = samples["position_rad.J0"]
    speed = np.gradient(angle, 1.0 / HZ)
    moved = KP_NM_RAD * speed + KD_NMS_RAD * np.gradient(speed, 1.0 / HZ)
    asked = KP_NM_RAD * (command - angle) - KD_NMS_RAD * speed + before_s * moved
    samples["torque_nm.J0"] = np.clip(asked, -60, 60)
    limb, notes = checked(limb_of(make_log(log.meta, samples, log.mjcf_xml)))
    assert limb.torque_read == read and not notes
    exact = replace(limb_of(make_log(log.meta, samples, log.mjcf_xml)), exact=True)
    assert checked(exact)[0].torque_read == UNTIL  # our simulators' are of the period until then


def test_what_a_replay_needed_goes_with_its_limb():
    """Free a limb and all that was expanded along its motion at once, with no cycle to be found."""
    limb = limb_of(log_of(Real()))
    gone = weakref.ref(limb)
    gc.disable()
    limb.simulate(limb.nominal)
    del limb
    held = gone()
    gc.enable()
    assert held is None


def test_the_beginning_of_a_log_lasts_long_enough():
    """Take all of the horizon of one long episode whose rows come at no even times."""
    log = log_of(Real())
    one = log.samples[log.samples["episode"] == 0]
    late_s = np.where(one["t_s"] > 0.0, 0.3 / HZ, 0.0)
    samples = one.assign(t_s=one["t_s"] + late_s).reset_index(drop=True)
    meta = log.meta.model_copy(update={"episodes": [e for e in log.episodes if e.episode == 0]})
    log = make_log(meta, samples, log.mjcf_xml)
    (begin,) = begun(log, limbs(mjcf_world(log))[0])
    assert HORIZON_S <= begin.time_s[-1] < samples["t_s"].max()


def test_a_diverging_replay_is_nan_and_no_crash():
    """Show NaN where a gain is beyond what the step holds."""
    limb = limb_of(log_of(Real()))
    numbers = limb.nominal.copy()
    numbers[:, KP] *= 1e6
    numbers[:, LIMIT] = 1e12
    assert np.isnan(limb.simulate(numbers)).any()


def test_slow_samples_are_replayed():
    """Take 10 Hz without a crash."""
    log = log_of(Real())
    meta = log.meta.model_copy(update={"channels": {}})
    limb = limb_of(make_log(meta, log.samples.iloc[::20].copy(), log.mjcf_xml))
    assert np.isfinite(limb.simulate(limb.nominal)).all()
