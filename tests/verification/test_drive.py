"""The drive law alone against closed forms; the tests hold its joint or integrate it themselves."""

import dataclasses
import math

import numpy as np
import pytest

from backends import sticks, trx
from backends.drive import COGGING_RAD, STRIBECK_RAD_S, DriveBank, stops
from backends.spec import Body, Drive, Joint, Spec
from backends.state import Array

DT_S = 1e-3
JOINT_KGM2 = 2e-4
"""Inertia of the joint that the tests integrate."""
FREE = Drive(
    kp_nm_rad=6.0,
    kd_nms_rad=0.0,
    torque_limit_nm=1.2,
    rotor_inertia_kgm2=2e-4,
    coulomb_nm=0.0,
    viscous_nms_rad=0.0,
    gear_stiffness_nm_rad=20.0,
    gear_damping_nms_rad=0.04,
    play_rad=100.0,
    lock_nm=0.0,
)
"""A rotor that never meets its teeth."""
GEARED = dataclasses.replace(FREE, kd_nms_rad=0.15, play_rad=math.radians(1))
WORM = dataclasses.replace(GEARED, lock_nm=10.0)


def rig(drive: Drive, dt_s: float = DT_S) -> Spec:
    """A world with one joint."""
    joint = Joint(name="J", axis=(0.0, 0.0, 1.0), range_rad=(-1.0, 1.0), drive=drive)
    body = Body(
        name="arm",
        parent=None,
        origin_m=(0.0, 0.0, 0.0),
        joint=joint,
        mass_kg=0.1,
        com_m=(0.0, 0.0, 0.0),
        inertia_kgm2=(JOINT_KGM2,) * 3,
    )
    spec = trx.spec(sticks.STICKS["reference"])
    hand = dataclasses.replace(spec.hand, bodies=(body,), fingertips=())
    timing = dataclasses.replace(spec.timing, drive_s=dt_s)
    return dataclasses.replace(spec, hand=hand, timing=timing)


def bank(drives: list[Drive], start_rad: float = 0.0, dt_s: float = DT_S) -> DriveBank:
    """One world per drive, its rotor at rest at `start_rad`."""
    made = DriveBank([rig(drive, dt_s) for drive in drives])
    made.reset(np.full((len(drives), 1), start_rad), np.ones(len(drives), dtype=bool))
    return made


def turn(drives: DriveBank, target_rad: float, steps: int) -> Array:
    """Motor angles (steps, N) with the joints held at zero."""
    still = np.zeros_like(drives.motor_rad)
    path = []
    for _ in range(steps):
        drives.step(np.full_like(still, target_rad), still, still)
        path.append(drives.motor_rad[:, 0].copy())
    return np.array(path)


class Swing:
    """Joints (N,) as simple inertias on their drives, by semi-implicit Euler."""

    def __init__(self, drives: list[Drive], start_rad: float) -> None:
        self.bank = bank(drives, start_rad)
        self.joint_rad = np.full((len(drives), 1), start_rad)
        self.joint_rad_s = np.zeros((len(drives), 1))

    def settle(self, target_rad: float, push_nm: Array, steps: int = 1500) -> Array:
        """Joint angles (N,) after holding target and push."""
        target = np.full_like(self.joint_rad, target_rad)
        for _ in range(steps):
            gear = self.bank.step(target, self.joint_rad, self.joint_rad_s)
            self.joint_rad_s += DT_S / JOINT_KGM2 * (gear + push_nm[:, None])
            self.joint_rad += DT_S * self.joint_rad_s
        return self.joint_rad[:, 0].copy()


def step_error(dt_s: float) -> float:
    """Largest distance of a step response to the closed form of J x'' = kp (t - x) - kd x'."""
    inertia, kp, kd, target, time_s = 0.02, 6.0, 0.2, 0.1, 0.6
    drive = dataclasses.replace(FREE, rotor_inertia_kgm2=inertia, kp_nm_rad=kp, kd_nms_rad=kd)
    path = turn(bank([drive], dt_s=dt_s), target, round(time_s / dt_s))[:, 0]
    t = dt_s * np.arange(1, len(path) + 1)
    decay = kd / (2 * inertia)
    omega = math.sqrt(kp / inertia - decay**2)
    wave = np.cos(omega * t) + decay / omega * np.sin(omega * t)
    return float(np.abs(path - target * (1 - np.exp(-decay * t) * wave)).max())


def test_free_rotor_follows_the_closed_form() -> None:
    """Answer a step as the differential equation does, with an error of first order in dt."""
    errors = [step_error(dt_s) for dt_s in (2e-3, 1e-3, 5e-4)]
    natural_rad_s, target_rad = math.sqrt(6.0 / 0.02), 0.1
    assert errors[1] < natural_rad_s * 1e-3 * target_rad
    assert [errors[0] / errors[1], errors[1] / errors[2]] == pytest.approx([2, 2], rel=0.1)


def test_viscous_friction_slows_the_rotor_exponentially() -> None:
    """Decay as (1 - dt b / J)^n, which is exp(-b t / J) to first order."""
    drive = dataclasses.replace(FREE, kp_nm_rad=0.0, viscous_nms_rad=2e-3)
    free = bank([drive])
    free.motor_rad_s[:] = 3.0
    turn(free, 0.0, 100)
    rate = 2e-3 / FREE.rotor_inertia_kgm2
    assert free.motor_rad_s[0, 0] == pytest.approx(3.0 * (1 - DT_S * rate) ** 100, rel=1e-9)
    assert free.motor_rad_s[0, 0] == pytest.approx(
        3.0 * math.exp(-rate * 0.1), rel=rate**2 * DT_S * 0.1
    )


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_torque_saturates(sign: float) -> None:
    """Accelerate at limit / J while the target is far, and never ask for more."""
    far = bank([FREE])
    turn(far, sign * 50.0, 20)
    assert far.pd_nm[0, 0] == sign * FREE.torque_limit_nm
    speed = sign * FREE.torque_limit_nm / FREE.rotor_inertia_kgm2 * 20 * DT_S
    assert far.motor_rad_s[0, 0] == pytest.approx(speed, rel=1e-12)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_limit_falls_with_the_speed_that_it_drives(sign: float) -> None:
    """Approach the no-load speed as 1 - exp(-t fall / J), and brake with the whole limit."""
    fall, inertia = 5e-3, FREE.rotor_inertia_kgm2
    drive = dataclasses.replace(FREE, limit_fall_nms_rad=fall)
    errors = []
    for dt_s in (1e-3, 5e-4, 2.5e-4):
        fast = bank([drive], dt_s=dt_s)
        turn(fast, sign * 1e4, round(0.04 / dt_s))
        speed = FREE.torque_limit_nm / fall * (1 - math.exp(-0.04 * fall / inertia))
        errors.append(abs(sign * fast.motor_rad_s[0, 0] - speed) / speed)
    assert errors[0] < fall / inertia * 1e-3
    assert [errors[0] / errors[1], errors[1] / errors[2]] == pytest.approx([2, 2], rel=0.1)
    turn(fast, -sign * 1e4, 1)
    assert fast.pd_nm[0, 0] == -sign * FREE.torque_limit_nm
    free = bank([drive])
    free.motor_rad_s[:] = sign * 2.0 * FREE.torque_limit_nm / fall
    turn(free, sign * 1e4, 1)
    assert free.pd_nm[0, 0] == 0.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_coulomb_friction_stops_and_never_reverses(sign: float) -> None:
    """Slow at coulomb / J, cover v^2 J / (2 coulomb), stop for good."""
    coulomb, speed = 0.02, 2.0
    rubbing = bank([dataclasses.replace(FREE, kp_nm_rad=0.0, coulomb_nm=coulomb)])
    rubbing.motor_rad_s[:] = sign * speed
    path = sign * turn(rubbing, 0.0, 60)[:, 0]
    assert (np.diff(path) >= 0).all()
    stop_steps = round(speed * FREE.rotor_inertia_kgm2 / coulomb / DT_S)
    assert (path[stop_steps:] == path[-1]).all()
    assert rubbing.motor_rad_s[0, 0] == 0.0
    distance = speed**2 * FREE.rotor_inertia_kgm2 / (2 * coulomb)
    assert path[-1] == pytest.approx(distance, abs=speed * DT_S)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_coulomb_friction_holds_a_small_offset(sign: float) -> None:
    """Stay put while |kp e| is under the Coulomb torque, and leave when it is over."""
    coulomb = 0.02
    drive = dataclasses.replace(FREE, coulomb_nm=coulomb)
    edge = coulomb / drive.kp_nm_rad
    assert (turn(bank([drive]), sign * 0.99 * edge, 200) == 0.0).all()
    assert sign * turn(bank([drive]), sign * 1.01 * edge, 200)[-1, 0] > 0.0


@pytest.mark.parametrize("way", [-0.03, 0.03])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_one_way_friction_acts_in_its_direction(sign: float, way: float) -> None:
    """Slow a coasting rotor at friction / J, and hold it at rest, by more in one direction."""
    coulomb, speed, steps = 0.02, 2.0, 5
    friction = coulomb + (abs(way) if sign * way > 0.0 else 0.0)
    drive = dataclasses.replace(FREE, coulomb_nm=coulomb, one_way_friction_nm=way)
    coasting = bank([dataclasses.replace(drive, kp_nm_rad=0.0)])
    coasting.motor_rad_s[:] = sign * speed
    turn(coasting, 0.0, steps)
    left = speed - friction / FREE.rotor_inertia_kgm2 * steps * DT_S
    assert sign * coasting.motor_rad_s[0, 0] == pytest.approx(left, rel=1e-12)
    ends = loose(drive, [sign * 0.99 * friction, sign * 1.01 * friction])
    assert ends[0] == 0.0
    assert sign * ends[1] > 0.0


@pytest.mark.parametrize("period", [0.0, 0.05])
def test_cogging_is_a_sine_of_the_motors_angle(period: float) -> None:
    """Swing about the angles where it vanishes at sqrt(2 pi amplitude / (period J)), by its law."""
    amplitude, phase, away = 0.01, 0.7, 1e-4
    own = dataclasses.replace(FREE, kp_nm_rad=0.0, cogging_nm=amplitude, cogging_phase_rad=phase)
    drive = dataclasses.replace(own, cogging_period_rad=period)
    tooth = period or COGGING_RAD
    still = (math.pi - phase) / (2 * math.pi) * tooth
    free = bank([drive], start_rad=still + away * tooth)
    path = (turn(free, 0.0, 400)[:, 0] - still) / tooth
    omega = math.sqrt(2 * math.pi * amplitude / (tooth * FREE.rotor_inertia_kgm2))
    t = DT_S * np.arange(1, 401)
    assert path == pytest.approx(away * np.cos(omega * t), abs=away * omega * DT_S)
    free = bank([drive], start_rad=0.3)
    turn(free, 0.0, 1)
    torque = amplitude * math.sin(2 * math.pi * 0.3 / tooth + phase)
    assert free.motor_rad_s[0, 0] == pytest.approx(DT_S / FREE.rotor_inertia_kgm2 * torque)


def test_a_motor_fades_as_it_gets_warm() -> None:
    """Lose fade (1 - exp(-t / T)) of the torque at its limit, at most 0.9, until a reset."""
    warm_s, limit = 0.5, FREE.torque_limit_nm
    drives = [dataclasses.replace(FREE, thermal_fade=f, thermal_s=warm_s) for f in (0.5, 5.0)]
    warm = bank(drives)
    for k in range(1, 1001):
        warm.motor_rad[:], warm.motor_rad_s[:] = 0.0, 0.0
        turn(warm, 100.0, 1)  # beyond the limit
        if k in (1, 50, 1000):
            heat = 1.0 - math.exp(-(k - 1) * DT_S / warm_s)
            left = [1.0 - min(fade * heat, 0.9) for fade in (0.5, 5.0)]
            speed = DT_S / FREE.rotor_inertia_kgm2 * limit * np.array(left)
            assert warm.motor_rad_s[:, 0] == pytest.approx(speed, rel=2e-3)
    warm.reset(np.zeros((2, 1)), np.array([True, False]))
    turn(warm, 100.0, 1)
    assert warm.motor_rad_s[0, 0] == pytest.approx(DT_S / FREE.rotor_inertia_kgm2 * limit)


def test_bristles_bend_before_they_slide() -> None:
    """Hold as a spring of level / bend at first, and by the level in the direction of a slide."""
    level, bend = 0.05, 2e-3
    drive = dataclasses.replace(FREE, kp_nm_rad=0.0, presliding_nm=level, presliding_rad=bend)
    free, slow = bank([drive]), 1e-3
    for speed, steps, share in ((slow, 10, slow * 10 * DT_S / bend), (-2.0, 50, -1.0)):
        for _ in range(steps):
            free.motor_rad_s[:] = speed
            turn(free, 0.0, 1)
        torque = FREE.rotor_inertia_kgm2 / DT_S * (free.motor_rad_s[0, 0] - speed)
        assert torque == pytest.approx(-level * share, rel=0.01)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_end_stop_only_pushes_and_takes_energy(side: float) -> None:
    """Push back by k (depth in the middle of the period) beyond its angle; let a swing come off."""
    inside, firm = 0.4, 30.0
    drive = dataclasses.replace(FREE, end_stop_rad=side * inside, end_stop_nm_rad=firm)
    at = side * (1.0 - inside)  # of a range of 1 rad to either side
    for depth, speed in ((0.1, 2.0), (-0.1, 20.0), (1e-3, -5.0)):
        free = bank([drive], start_rad=0.0)
        joint, rate = np.array([[at + side * depth]]), np.array([[side * speed]])
        pressed = firm * (depth + speed * DT_S / 2)
        torque = free.step(joint, joint, rate)
        assert torque[0, 0] == pytest.approx(-side * max(pressed, 0.0))
    loose = bank([drive])
    q, v, top = np.array([[at]]), np.array([[side * 1.0]]), 0.0
    for _ in range(200):
        v = v + DT_S / JOINT_KGM2 * loose.step(q, q, v)
        q = q + DT_S * v
        top = max(top, float(side * (q[0, 0] - at)))
    omega = math.sqrt(firm / JOINT_KGM2)
    assert top == pytest.approx(1.0 / omega, rel=0.25)
    assert -1.0 <= side * v[0, 0] < -0.5


def test_a_weak_motor_gives_a_share_and_reads_the_whole() -> None:
    """Speed a rotor up by its share of the torque that is asked, which is what is read."""
    drive = dataclasses.replace(FREE, weakness=0.4)
    still, weak = np.zeros((1, 1)), bank([drive])
    weak.step(np.array([[0.1]]), still, still)
    assert weak.pd_nm[0, 0] == pytest.approx(drive.kp_nm_rad * 0.1)
    assert weak.motor_rad_s[0, 0] == pytest.approx(0.6 * weak.pd_nm[0, 0] * DT_S / 2e-4)


def test_a_spring_pulls_to_where_it_rests() -> None:
    """Hold a joint where kp (target - q) = k (q - rest), by the torque of neither gear nor stop."""
    stiffness, rest, target = 2.0, -0.4, 0.1
    drive = dataclasses.replace(FREE, spring_nm_rad=stiffness, spring_rest_rad=rest)
    for q in (-0.9, rest, 0.3):
        joint = np.array([[q]])
        torque = bank([drive], start_rad=q).step(joint, joint, np.zeros((1, 1)))
        assert torque[0, 0] == pytest.approx(stiffness * (rest - q))
    held = dataclasses.replace(GEARED, play_rad=0.0, spring_nm_rad=stiffness, spring_rest_rad=rest)
    q = Swing([held], 0.0).settle(target, np.zeros(1), steps=4000)
    by = 1 / (1 / held.kp_nm_rad + 1 / held.gear_stiffness_nm_rad)  # servo and teeth in series
    assert q == pytest.approx((by * target + stiffness * rest) / (by + stiffness), abs=1e-6)


@pytest.mark.parametrize(("inside", "sign"), [(0.3, 1.0), (-0.2, -1.0), (0.0, 0.0)])
def test_end_stops_stand_inside_of_the_range(inside: float, sign: float) -> None:
    """Give the angle, and the stiffness of the teeth unless another is said; none without one."""
    numbers = np.array([[inside, 0.0, 20.0], [inside, 7.0, 20.0]])
    table = stops(numbers, np.array([[-1.0, 2.0]] * 2))
    assert table[:, 1] == pytest.approx([sign * 20.0, sign * 7.0])
    if inside:
        assert table[:, 0] == pytest.approx(1.7 if inside > 0.0 else -0.8)


def test_teeth_only_push() -> None:
    """Follow k dead_band + c slip outside the play, cut at zero; be nothing inside."""
    rng = np.random.default_rng(0)
    n, play = 500, GEARED.play_rad
    teeth = bank([GEARED] * n)
    gap, joint_rad_s = rng.uniform(-3 * play, 3 * play, (n, 1)), rng.uniform(-5, 5, (n, 1))
    motor_rad_s = rng.uniform(-5, 5, (n, 1))
    teeth.motor_rad[:], teeth.motor_rad_s[:] = gap, motor_rad_s
    still = np.zeros((n, 1))
    gear = teeth.step(still, still, joint_rad_s).copy()
    press = np.sign(gap) * np.maximum(np.abs(gap) - play, 0.0)
    free = GEARED.gear_stiffness_nm_rad * press
    free = free + GEARED.gear_damping_nms_rad * (motor_rad_s - joint_rad_s)
    outside = np.abs(gap) > play
    expected = np.where(outside & (free * press > 0), free, 0.0)
    assert gear == pytest.approx(expected, abs=1e-12)
    assert (outside & (gear == 0.0)).any()
    assert (~outside).any()


def test_gear_keeps_momentum() -> None:
    """Conserve the momentum of rotor and joint when nothing else acts on them."""
    swing = Swing([dataclasses.replace(GEARED, kp_nm_rad=0.0, kd_nms_rad=0.0)], 0.0)
    swing.bank.motor_rad_s[:] = 2.0
    swing.settle(0.0, np.zeros(1), 500)
    momentum = GEARED.rotor_inertia_kgm2 * swing.bank.motor_rad_s + JOINT_KGM2 * swing.joint_rad_s
    assert momentum[0, 0] == pytest.approx(2.0 * GEARED.rotor_inertia_kgm2, rel=1e-12)
    assert swing.joint_rad_s[0, 0] > 0.1


def test_push_test_reads_the_play() -> None:
    """Move by play + torque / stiffness to either side when a held worm joint is pushed."""
    plays, push = np.radians([0.0, 0.2, 1.0, 3.0]), np.full(4, 0.2)
    swing = Swing([dataclasses.replace(WORM, play_rad=float(p)) for p in plays], 0.3)
    q_a = swing.settle(0.3, 0 * push)
    q_b = swing.settle(0.3, push)
    q_c = swing.settle(0.3, -push)
    give = plays + push / WORM.gear_stiffness_nm_rad
    assert q_a == pytest.approx(0.3, abs=1e-12)
    assert q_b - q_a == pytest.approx(give, abs=1e-9)
    assert q_c - q_a == pytest.approx(-give, abs=1e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_pushed_worm_stands_still(sign: float) -> None:
    """Not move the motor at all with the lock; yield torque / kp without it."""
    push = sign * np.full(2, 0.2)
    swing = Swing([WORM, GEARED], 0.3)
    swing.settle(0.3, push)
    locked, free = swing.bank.motor_rad[:, 0] - 0.3
    assert locked == 0.0
    assert free == pytest.approx(sign * 0.2 / GEARED.kp_nm_rad, abs=1e-9)


def test_lock_yields_beyond_its_torque() -> None:
    """Hold under `lock_nm` and be driven back over it."""
    drives = [dataclasses.replace(WORM, lock_nm=lock) for lock in (0.21, 0.15)]
    swing = Swing(drives, 0.0)
    # The push grows slowly: teeth that ring would load the worm more than the push does.
    for push in np.linspace(0.0, 0.2, 40):
        swing.settle(0.0, np.full(2, push), 50)
    assert swing.bank.motor_rad[0, 0] == 0.0
    assert swing.bank.motor_rad[1, 0] > 0.0


@pytest.mark.parametrize("load_nm", [-0.3, 0.3])
@pytest.mark.parametrize("target_rad", [-0.3, 0.3])
def test_driven_worm_reaches_its_target_under_load(target_rad: float, load_nm: float) -> None:
    """Come within load / kp of the target, lifting or lowering; the joint hangs on its teeth."""
    swing = Swing([WORM], 0.0)
    joint = swing.settle(target_rad, np.array([load_nm]), 3000)[0]
    motor = swing.bank.motor_rad[0, 0]
    assert abs(motor - target_rad) < abs(load_nm) / WORM.kp_nm_rad * 1.001
    hang = math.copysign(WORM.play_rad, load_nm) + load_nm / WORM.gear_stiffness_nm_rad
    assert joint - motor == pytest.approx(hang, abs=1e-4)


def loose(drive: Drive, torques_nm: list[float]) -> Array:
    """Where the rotors end that such PD torques at the start pull on; joints held at zero."""
    free = bank([drive] * len(torques_nm))
    target = np.array(torques_nm)[:, None] / drive.kp_nm_rad
    still = np.zeros_like(free.motor_rad)
    for _ in range(300):
        free.step(target, still, still)
    return free.motor_rad[:, 0]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_stiction_breaks_away(sign: float) -> None:
    """Stay put under Coulomb friction and stiction together, and leave above both."""
    drive = dataclasses.replace(FREE, coulomb_nm=0.02, stiction_nm=0.03)
    ends = loose(drive, [sign * 0.021, sign * 0.0499, sign * 0.0501])
    assert (ends[:2] == 0.0).all()
    assert sign * ends[2] > 0.0


@pytest.mark.parametrize("speed", [0.0, 0.02, 0.05, 0.3, 5.0])
def test_friction_falls_with_speed_as_stribeck_says(speed: float) -> None:
    """Take coulomb + stiction exp(-speed / v_s) from a rotor in one step."""
    drive = dataclasses.replace(FREE, kp_nm_rad=0.0, coulomb_nm=1e-3, stiction_nm=2e-3)
    free = bank([drive])
    free.motor_rad_s[:] = speed
    turn(free, 0.0, 1)
    friction = 1e-3 + 2e-3 * math.exp(-speed / STRIBECK_RAD_S)
    lost = DT_S / FREE.rotor_inertia_kgm2 * friction
    assert free.motor_rad_s[0, 0] == pytest.approx(max(speed - lost, 0.0), abs=1e-15)


def test_stiction_stops_a_rotor_as_the_closed_form_says() -> None:
    """Slow down as J v' = -stiction exp(-v / v_s): v = v_s ln(exp(v0 / v_s) - stiction t / J v_s).

    The error is of first order in dt.
    """
    stiction, start, time_s = 1e-3, 0.12, 0.05
    drive = dataclasses.replace(FREE, kp_nm_rad=0.0, stiction_nm=stiction)
    rate = stiction / FREE.rotor_inertia_kgm2 / STRIBECK_RAD_S
    exact = STRIBECK_RAD_S * math.log(math.exp(start / STRIBECK_RAD_S) - rate * time_s)
    errors = []
    for dt_s in (1e-3, 5e-4, 2.5e-4):
        free = bank([drive], dt_s=dt_s)
        free.motor_rad_s[:] = start
        turn(free, 0.0, round(time_s / dt_s))
        errors.append(abs(free.motor_rad_s[0, 0] - exact))
    assert 0.0 < exact < start
    assert [errors[0] / errors[1], errors[1] / errors[2]] == pytest.approx([2, 2], rel=0.1)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_load_friction_widens_the_lag_under_load(sign: float) -> None:
    """Lag by load (1 - mu) / kp where the load pushed, by load (1 + mu) / kp where it was lifted.

    Load and target creep, in steps that bound the error, so that the rotor stops where the
    friction lets it and no swing carries it farther.
    """
    load, steps, move, kp = 0.2, 100, 0.02, GEARED.kp_nm_rad
    drives = [dataclasses.replace(GEARED, load_friction=mu) for mu in (0.0, 0.1, 0.3)]
    mu = np.array([d.load_friction for d in drives])
    swing = Swing(drives, 0.0)
    for share in np.linspace(0.0, 1.0, steps + 1):
        swing.settle(0.0, np.full(3, sign * share * load), 60)
    pushed = sign * swing.bank.motor_rad[:, 0]
    assert pushed == pytest.approx(load * (1 - mu) / kp, abs=load / steps / kp)
    for target in np.linspace(0.0, -sign * move, steps + 1):
        swing.settle(target, np.full(3, sign * load), 60)
    lifted = sign * swing.bank.motor_rad[:, 0] + move
    # A creeping target leaves the rotor no more than a step behind the edge of the friction.
    assert lifted == pytest.approx(load * (1 + mu) / kp, abs=move / steps)


def test_load_friction_needs_a_load() -> None:
    """Move a rotor that transmits nothing as without it, to the bit."""
    rubbing = bank([FREE, dataclasses.replace(FREE, load_friction=0.5)])
    path = turn(rubbing, 0.3, 200)
    assert np.array_equal(path[:, 0], path[:, 1])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_dead_zone_leaves_an_error(sign: float) -> None:
    """Ignore errors up to the zone; come to rest a zone short of a farther target."""
    zone = math.radians(0.5)
    drive = dataclasses.replace(FREE, kd_nms_rad=0.15, dead_zone_rad=zone)
    assert (turn(bank([drive]), sign * 0.999 * zone, 500) == 0.0).all()
    end = turn(bank([drive]), sign * 0.1, 3000)[-1, 0]
    assert end == pytest.approx(sign * (0.1 - zone), abs=1e-9)


def test_dead_zone_adds_to_the_lag_under_load() -> None:
    """Yield to a load by the zone and by load / kp."""
    zone, load = math.radians(0.5), np.full(2, 0.12)
    swing = Swing([GEARED, dataclasses.replace(GEARED, dead_zone_rad=zone)], 0.0)
    swing.settle(0.0, load, 3000)
    lag = 0.12 / GEARED.kp_nm_rad + np.array([0.0, zone])
    assert swing.bank.motor_rad[:, 0] == pytest.approx(lag, abs=1e-6)
