"""The drive law: from target to joint torque, at the drive rate, the same code for every engine.

It is a two-mass gear model. A PD controller drives a rotor. Rotor and joint are coupled by teeth,
which push once the play between them is taken up:

    tau_pd   = clip(kp dead_zone(target - motor) - kd motor', low, high)     (the paper's PD law)
    high     = limit - fall motor',  -low = limit + fall motor',             within 0 and limit
    tau_gear = k dead_band(motor - joint, play) + c (motor' - joint'),       teeth only push
    J motor'' = tau_pd + tau_cog + tau_mem - tau_gear - viscous motor' - friction
    tau_cog  = cogging sin(2 pi motor / period + phase)
    friction = coulomb + one_way + stiction exp(-|motor'| / v_s) + load_friction |tau_gear|
    tau      = tau_gear - k_s (joint + joint' dt / 2 - stop),        beyond a stop; it only pushes

    tau_mem  = -fade heat tau_pd - presliding z
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
_LIMIT, _FADE = COLUMNS.index("torque_limit_nm"), COLUMNS.index("thermal_fade")
_SLIDING, _HEAT = COLUMNS.index("presliding_nm"), len(COLUMNS)
_STICTION, _COGGING = COLUMNS.index("stiction_nm"), COLUMNS.index("cogging_nm")
_PERIOD, _PHASE = COLUMNS.index("cogging_period_rad"), COLUMNS.index("cogging_phase_rad")
_STOP, _FIRM = COLUMNS.index("end_stop_rad"), COLUMNS.index("end_stop_nm_rad")
_TEETH = COLUMNS.index("gear_stiffness_nm_rad")


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


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def turn_motor(target, joint, joint_speed, motor, speed, rub, cog, dt, p):
    """`motor_tick` with given stiction `rub`, and `cog`: cogging and what is remembered.

    Without branches and inline: so it vectorises.
    """
    (
        kp,
        kd,
        limit,
        inertia,
        coulomb,
        viscous,
        k,
        c,
        play,
        lock,
        _,
        load,
        dead,
        way,
        fall,
        _,
        _,
        _,
        stop,
        firm,
    ) = p
    gap = motor - joint
    touches = (gap > play) | (gap < -play) | (play == 0.0)
    press = gap - play if gap > 0.0 else gap + play
    gear = k * press + c * (speed - joint_speed)
    pulls = (play > 0.0) & (gear * press < 0.0)
    gear = 0.0 if pulls | (not touches) else gear
    pd = kp * _shrink(target - motor, dead) - kd * speed
    lost = fall * speed
    high, low = limit - min(max(lost, 0.0), limit), min(max(-lost, 0.0), limit) - limit
    pd = min(max(pd, low), high)
    friction = coulomb + load * abs(gear) + rub
    speed += dt / inertia * (pd + cog - gear - viscous * speed)
    friction += max(way if speed > 0.0 else -way, 0.0)
    speed = _shrink(speed, dt / inertia * friction)
    locked = _shrink(speed, dt / inertia * lock)
    speed = locked if (speed * pd <= 0.0) & (speed * gear < 0.0) else speed
    past = joint + 0.5 * dt * joint_speed - stop
    return motor + dt * speed, speed, pd, gear - (abs(firm) * past if firm * past > 0.0 else 0.0)


@numba.njit(cache=True, forceinline=True)
def numbers_at(p, i):
    """What `turn_motor` takes of column `i` of `p`; as an array it would keep SIMD away."""
    return (
        *(p[0, i], p[1, i], p[2, i], p[3, i], p[4, i], p[5, i], p[6, i]),
        *(p[7, i], p[8, i], p[9, i], p[10, i], p[11, i], p[12, i], p[13, i], p[14, i]),
        *(p[15, i], p[16, i], p[17, i], p[18, i], p[19, i]),
    )


@numba.njit(cache=True)
def _recalled(speed, pd, p, i, dt):
    """`remembered` by the numbers in column `i` of `p`, where its memory is written."""
    if p[_FADE, i] <= 0.0 and p[_SLIDING, i] <= 0.0:
        return 0.0
    law = p[_LIMIT, i], p[_FADE, i], p[_FADE + 1, i], p[_SLIDING, i], p[_SLIDING + 1, i]
    torque, heat, bend = remembered(speed, pd, dt, *law, p[_HEAT, i], p[_HEAT + 1, i])
    p[_HEAT, i], p[_HEAT + 1, i] = heat, bend
    return torque


@numba.njit(cache=True)
def _recall(speed, pd, p, dt, cog):
    """Add what drives (M,) remember to torques `cog`; apart, for writing `p` keeps SIMD away."""
    for i in range(len(cog)):
        cog[i] += _recalled(speed[i], pd[i], p, i, dt)


@numba.njit(cache=True)
def motor_tick(target, joint, joint_speed, motor, speed, pd, p, i, dt):
    """Step one joint's drive by one period `dt`, with the numbers in column `i` of `p`.

    They are as in `drive_table`, and their memory is written; `pd` is the last PD torque. Returns
    the motor's new angle and speed, its PD torque and the torque on the joint.
    """
    rub, cog = (
        rubbing(speed, p[_STICTION, i]),
        cogged(motor, p[_COGGING, i], p[_PERIOD, i], p[_PHASE, i]),
    )
    cog += _recalled(speed, pd, p, i, dt)
    return turn_motor(target, joint, joint_speed, motor, speed, rub, cog, dt, numbers_at(p, i))


@numba.njit(cache=True, error_model="numpy")
def drive_step(target, joint, joint_speed, motor, motor_speed, p, dt, pd, gear, remembers=True):
    """`motor_tick` for contiguous arrays (N, J); `p` (26, N, J) holds the numbers of all drives.

    `remembers`: whether any of them has a memory.
    """
    target, joint, joint_speed = target.ravel(), joint.ravel(), joint_speed.ravel()
    motor, motor_speed, pd, gear = motor.ravel(), motor_speed.ravel(), pd.ravel(), gear.ravel()
    p, rub, cog = p.reshape(p.shape[0], -1), np.zeros(len(motor)), np.zeros(len(motor))
    for i in range(len(motor)):
        rub[i] = rubbing(motor_speed[i], p[_STICTION, i])
        cog[i] = cogged(motor[i], p[_COGGING, i], p[_PERIOD, i], p[_PHASE, i])
    if remembers:
        _recall(motor_speed, pd, p, dt, cog)
    for i in range(len(motor)):
        own = target[i], joint[i], joint_speed[i], motor[i], motor_speed[i], rub[i], cog[i]
        motor[i], motor_speed[i], pd[i], gear[i] = turn_motor(*own, dt, numbers_at(p, i))


def drive_table(spec: Spec) -> Array:
    """The numbers of all drives in the order of their fields, then an empty `MEMORY`, (J, 26).

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
        self._dt_s = specs[0].timing.drive_s
        tables = np.array([drive_table(spec) for spec in specs])
        self._parameters = np.moveaxis(tables, -1, 0).copy()
        shape = tables.shape[:2]
        self.motor_rad = np.zeros(shape)
        """Motor angles reflected through the gear [rad], shape (N, J)."""
        self.motor_rad_s = np.zeros(shape)
        """Motor speeds [rad/s], shape (N, J)."""
        self.pd_nm = np.zeros(shape)
        """PD torques of the last step [Nm], shape (N, J)."""
        self.gear_nm = np.zeros(shape)
        """Torques on the joints of the last step [Nm], shape (N, J)."""
        self.rotors = (
            self.motor_rad,
            self.motor_rad_s,
            self._parameters,
            self._dt_s,
            self.pd_nm,
            self.gear_nm,
            bool(self._parameters[[_FADE, _SLIDING]].any()),
        )
        """The arguments of `drive_step` after target, joint angle and joint speed."""

    def reset(self, joint_rad: Array, mask: Array) -> None:
        """Set the rotors of the masked worlds to rest in the middle of their play."""
        self.motor_rad[mask] = joint_rad[mask]
        for rate in (self.motor_rad_s, self.pd_nm, self.gear_nm):
            rate[mask] = 0.0
        self._parameters[_HEAT:, mask] = 0.0

    def step(self, target_rad: Array, joint_rad: Array, joint_rad_s: Array) -> Array:
        """Advance the rotors by one drive period; returns the joint torques [Nm], (N, J)."""
        drive_step(target_rad, joint_rad, joint_rad_s, *self.rotors)
        return self.gear_nm
