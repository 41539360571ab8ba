"""The drive law: from target to joint torque, at the drive rate, the same code for every engine.

It is a two-mass gear model. A PD controller drives a rotor. Rotor and joint are coupled by teeth,
which push once the play between them is taken up:

    tau_pd   = clip(kp dead_zone(target - motor) - kd motor', low, high)     (the paper's PD law)
    high     = limit - fall motor',  -low = limit + fall motor',             within 0 and limit
    tau_gear = k dead_band(motor - joint, play) + c (motor' - joint'),       teeth only push
    J motor'' = tau_pd + tau_cog + tau_mem - tau_gear - viscous motor' - friction
    tau_cog  = cogging sin(2 pi motor / period + phase)
    friction = coulomb + one_way + stiction exp(-|motor'| / v_s) + load_friction |tau_gear|
    tau      = tau_gear - spring (joint - rest)
               - k_s (joint + joint' dt / 2 - stop),                 beyond a stop; it only pushes

    tau_mem  = -(weakness + fade heat) tau_pd - presliding z
    heat'    = ((tau_pd / limit)^2 - heat) / T,    z' = (motor' - |motor'| z) / d,    |z| <= 1

Friction and the worm's self-lock act on the rotor's momentum after the free update. So they can
stop a rotor and never reverse it. The worm resists, up to `lock_nm`, when the load drives the rotor
against the motor. `one_way` is friction in one direction alone. A stop is pressed by the depth in
the middle of the period, which takes energy from a bounce. Joint positions are never overwritten,
so the squeeze of a grasp is kept. Heat takes the torque of the period before.

Sources: the Stribeck curve, Armstrong-Helouvry et al., Automatica 30 (1994); friction that grows
with the load, Duclusaud et al., ICRA 2025 (arXiv 2410.08650); a limit that falls with speed, the DC
motor of Isaac Lab; bristles, Dahl, Aerospace report TOR-0158 (1968).
"""

from collections.abc import Sequence
from dataclasses import fields

import numba
import numpy as np

from backends.spec import Drive, Spec
from backends.state import Array

COLUMNS = tuple(f.name for f in fields(Drive))
"""Names of a drive's numbers, in the order in which compiled code takes them."""
STRIBECK_RAD_S = 0.05
"""v_s: speed at which stiction has fallen to a third. Fits to servos give 0.1 rad/s and more."""
COGGING_RAD = np.radians(20.0)
"""Period of cogging where none is given: of 18 teeth, so coarse that a hand shows it."""
HEAT_S, MOST_FADED = 10.0, 0.9
"""Time constant of a motor's heat where none is given, and the largest share of torque it takes."""
BRISTLE_RAD = 3e-3
"""How far bristles bend where nothing is given."""
MEMORY = ("heat", "bend")
"""What a drive remembers beside its rotor: the rows behind its numbers in a table."""
_HEAT = len(COLUMNS)
_LIMIT, _TEETH = COLUMNS.index("torque_limit_nm"), COLUMNS.index("gear_stiffness_nm_rad")
_DEAD, _WAY = COLUMNS.index("dead_zone_rad"), COLUMNS.index("one_way_friction_nm")
_FALL = COLUMNS.index("limit_fall_nms_rad")
_STICTION, _COGGING = COLUMNS.index("stiction_nm"), COLUMNS.index("cogging_nm")
_PERIOD, _PHASE = COLUMNS.index("cogging_period_rad"), COLUMNS.index("cogging_phase_rad")
_STOP, _FIRM = COLUMNS.index("end_stop_rad"), COLUMNS.index("end_stop_nm_rad")
_FADE, _WARM = COLUMNS.index("thermal_fade"), COLUMNS.index("thermal_s")
_SLIDING, _BRISTLE = COLUMNS.index("presliding_nm"), COLUMNS.index("presliding_rad")
_SPRING, _REST = COLUMNS.index("spring_nm_rad"), COLUMNS.index("spring_rest_rad")
_WEAK = COLUMNS.index("weakness")
EXTRAS = (_STICTION, _DEAD, _WAY, _FALL, _COGGING, _FIRM, _FADE, _SLIDING, _SPRING, _WEAK)
"""Places of the numbers of a drive that few robots have: a step without them is shorter."""


@numba.njit(cache=True)
def _shrink(speed, loss):
    """Reduce `speed` by `loss` towards zero, but not beyond zero; NaN stays NaN."""
    rest = 0.0 if speed == speed else speed
    return speed - loss if speed > loss else (speed + loss if speed < -loss else rest)


@numba.njit(cache=True)
def rubbing(speed, stiction):
    """The stiction at a given rotor speed [Nm]."""
    return stiction * np.exp(-abs(speed) / STRIBECK_RAD_S) if stiction > 0.0 else 0.0


@numba.njit(cache=True)
def cogged(motor, amplitude, period, phase):
    """The torque of cogging at a given motor angle [Nm]."""
    if amplitude == 0.0:
        return 0.0
    return amplitude * np.sin(
        2.0 * np.pi * motor / (period if period > 0.0 else COGGING_RAD) + phase
    )


@numba.njit(cache=True)
def remembered(speed, pd, dt, limit, fade, warm_s, sliding, bristle, heat, bend):
    """The torque on a motor of its heat and its bristles [Nm], and both after a period.

    `pd` is its torque in the period before.
    """
    torque = 0.0
    if fade > 0.0:
        load = pd / limit if limit > 0.0 else 0.0
        heat += dt / (warm_s if warm_s > 0.0 else HEAT_S) * (load * load - heat)
        torque -= min(fade * heat, MOST_FADED) * pd
    if sliding > 0.0:
        slid = dt * speed / (bristle if bristle > 0.0 else BRISTLE_RAD)
        bend = (bend + slid) / (1.0 + abs(slid))
        torque -= sliding * bend
    return torque, heat, bend


@numba.njit(cache=True)
def _extra(motor, speed, pd, p, dt):
    """Stiction of a drive with the numbers `p` (30,), and its torques of cogging and memory [Nm].

    Its memory is written.
    """
    cog = cogged(motor, p[_COGGING], p[_PERIOD], p[_PHASE])
    if p[_FADE] > 0.0 or p[_SLIDING] > 0.0:
        law = p[_LIMIT], p[_FADE], p[_WARM], p[_SLIDING], p[_BRISTLE]
        torque, p[_HEAT], p[_HEAT + 1] = remembered(speed, pd, dt, *law, p[_HEAT], p[_HEAT + 1])
        cog += torque
    return rubbing(speed, p[_STICTION]), cog


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def motor_tick(target, joint, joint_speed, motor, speed, pd, p, dt, extra=True):
    """Step one joint's drive by one period `dt`, with its numbers `p` (30,) of a `drive_table`.

    `pd` is the last PD torque; `extra`: whether it may have one of the `EXTRAS`. Returns the
    motor's new angle and speed, its PD torque and the torque on the joint.
    """
    kp, kd, limit, inertia, coulomb, viscous = p[0], p[1], p[2], p[3], p[4], p[5]
    k, c, play, lock, load = p[6], p[7], p[8], p[9], p[11]
    rub, cog = _extra(motor, speed, pd, p, dt) if extra else (0.0, 0.0)
    gap = motor - joint
    touches = (gap > play) | (gap < -play) | (play == 0.0)
    press = gap - play if gap > 0.0 else gap + play
    gear = k * press + c * (speed - joint_speed)
    pulls = (play > 0.0) & (gear * press < 0.0)
    gear = 0.0 if pulls | (not touches) else gear
    lead, high, low = target - motor, limit, -limit
    if extra:
        lost, lead = p[_FALL] * speed, _shrink(lead, p[_DEAD])
        high, low = limit - min(max(lost, 0.0), limit), min(max(-lost, 0.0), limit) - limit
    pd = min(max(kp * lead - kd * speed, low), high)
    if extra:
        cog -= p[_WEAK] * pd
    friction = coulomb + load * abs(gear) + rub
    speed += dt / inertia * (pd + cog - gear - viscous * speed)
    if extra:
        friction += max(p[_WAY] if speed > 0.0 else -p[_WAY], 0.0)
    speed = _shrink(speed, dt / inertia * friction)
    locked = _shrink(speed, dt / inertia * lock)
    speed = locked if (speed * pd <= 0.0) & (speed * gear < 0.0) else speed
    motor += dt * speed
    if extra:
        firm, past = p[_FIRM], joint + 0.5 * dt * joint_speed - p[_STOP]
        gear -= abs(firm) * past if firm * past > 0.0 else 0.0
        gear -= p[_SPRING] * (joint - p[_REST])
    return motor, speed, pd, gear


@numba.njit(cache=True, error_model="numpy")
def drive_step(target, joint, joint_speed, motor, motor_speed, p, dt, extra, pd, gear):
    """`motor_tick` for arrays (N, J); `p` (N, 30, J) holds the numbers of all drives."""
    for n in range(target.shape[0]):
        for j in range(target.shape[1]):
            rotor = motor[n, j], motor_speed[n, j], pd[n, j]
            motor[n, j], motor_speed[n, j], pd[n, j], gear[n, j] = motor_tick(
                target[n, j], joint[n, j], joint_speed[n, j], *rotor, p[n, :, j], dt, extra
            )


def drive_table(spec: Spec) -> Array:
    """The numbers of all drives in the order of their fields, then an empty `MEMORY`, (J, 30).

    Of end stops not how far inside they stand, but where; and the stiffness as `stops` says.
    """
    table = np.array([[getattr(drive, name) for name in COLUMNS] for drive in spec.drives])
    ranges = np.array([body.joint.range_rad for body in spec.hand.driven])
    table[:, [_STOP, _FIRM]] = stops(table[:, [_STOP, _FIRM, _TEETH]], ranges)
    return np.pad(table, ((0, 0), (0, len(MEMORY))))


def stops(numbers: Array, ranges: Array) -> Array:
    """Where the end stops of J joints stand [rad], and how stiff they are [Nm/rad], shape (J, 2).

    Stiffness has the sign of its side; 0: no stop. From `end_stop_rad`, `end_stop_nm_rad` and
    `gear_stiffness_nm_rad` of their drives (J, 3), and the joints' ranges (J, 2).
    """
    inside, firm, teeth = numbers.T
    ends = np.where(inside > 0.0, ranges[:, 1], ranges[:, 0])
    stiffness = np.sign(inside) * np.where(firm > 0.0, firm, teeth)
    return np.stack([ends - inside, stiffness], axis=1)


class DriveBank:
    """The drives of N worlds and their rotor states."""

    def __init__(self, specs: Sequence[Spec]) -> None:
        self._numbers = np.array([drive_table(spec) for spec in specs]).swapaxes(1, 2).copy()
        shape = len(specs), self._numbers.shape[2]
        self.motor_rad = np.zeros(shape)
        """Motor angles reflected through the gear [rad], shape (N, J)."""
        self.motor_rad_s = np.zeros(shape)
        """Motor speeds [rad/s], shape (N, J)."""
        self.pd_nm = np.zeros(shape)
        """PD torques of the last step [Nm], shape (N, J)."""
        self._gear_nm = np.zeros(shape)
        self.is_long = bool(self._numbers[:, EXTRAS].any())
        """Whether a drive has one of the numbers that few have."""
        self.rotors = (
            self.motor_rad,
            self.motor_rad_s,
            self._numbers,
            specs[0].timing.drive_s,
            self.is_long,
            self.pd_nm,
            self._gear_nm,
        )
        """The arguments of `drive_step` after target, joint angle and joint speed."""

    def reset(self, joint_rad: Array, mask: Array) -> None:
        """Set the rotors of the masked worlds to rest in the middle of their play."""
        self.motor_rad[mask] = joint_rad[mask]
        for rate in (self.motor_rad_s, self.pd_nm):
            rate[mask] = 0.0
        self._numbers[mask, _HEAT:] = 0.0

    def step(self, target_rad: Array, joint_rad: Array, joint_rad_s: Array) -> Array:
        """Advance the rotors by one drive period; returns the joint torques [Nm], (N, J)."""
        drive_step(target_rad, joint_rad, joint_rad_s, *self.rotors)
        return self._gear_nm
