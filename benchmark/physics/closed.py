"""Closed forms that engines are compared with: pendulum, response of a drive, rigid dynamics."""

import math

import numpy as np

from backends.spec import Drive, Spec
from backends.state import Array
from diagnosis.replay.dynamics import dynamics


def pendulum_period_s(inertia_kgm2: float, moment_nm: float, amplitude_rad: float) -> float:
    """Period of I a'' = -moment sin a, by the arithmetic-geometric mean of 1 and cos(a0 / 2)."""
    a, b = 1.0, math.cos(amplitude_rad / 2)
    while a - b > 1e-15:
        a, b = (a + b) / 2, math.sqrt(a * b)
    return 2 * math.pi * math.sqrt(inertia_kgm2 / moment_nm) / a


def upward_crossings_s(angle_rad: Array, dt_s: float) -> Array:
    """Times at which an angle, sampled every dt from 0 on, passes zero upwards (interpolated)."""
    k = np.flatnonzero((angle_rad[:-1] < 0) & (angle_rad[1:] >= 0))
    return (k + angle_rad[k] / (angle_rad[k] - angle_rad[k + 1])) * dt_s


def step_response(
    drive: Drive, inertia_kgm2: float, target_rad: float, load_nm: float, time_s: Array
) -> tuple[Array, Array]:
    """Joint angle and speed of a drive without play and friction after a step of target and load.

    The linear equations of `backends.drive`, x' = A x + b with x = (motor, motor', joint, joint'),
    solved by the eigenvectors of A.
    """
    kp, kd = drive.kp_nm_rad, drive.kd_nms_rad
    k, c = drive.gear_stiffness_nm_rad, drive.gear_damping_nms_rad
    motor = np.array([-kp - k, -kd - c, k, c]) / drive.rotor_inertia_kgm2
    joint = np.array([k, c, -k, -c]) / inertia_kgm2
    a = np.array([[0, 1, 0, 0], motor, [0, 0, 0, 1], joint])
    b = np.array([0, kp * target_rad / drive.rotor_inertia_kgm2, 0, load_nm / inertia_kgm2])
    rest = np.linalg.solve(a, -b)
    values, vectors = np.linalg.eig(a)
    weights = np.linalg.solve(vectors, -rest.astype(complex))
    path = np.exp(np.outer(time_s, values)) * weights @ vectors.T
    state = rest + path.real
    return state[:, 2], state[:, 3]


def mass_and_bias(
    spec: Spec, joint_rad: Array, joint_rad_s: Array | None = None
) -> tuple[Array, Array]:
    """Mass matrices (N, J, J) [kg m^2] and bias torques (N, J) [Nm] at angles and speeds (N, J).

    The bias torques keep the joint speeds constant. Without speeds the hand is at rest.
    """
    speed = np.zeros_like(joint_rad) if joint_rad_s is None else joint_rad_s
    return dynamics(spec, joint_rad, speed)


def free_swing(spec: Spec, start_rad: Array, steps: int) -> Array:
    """Joint angles (steps, J) of an undriven hand that starts at rest, by semi-implicit Euler."""
    angle, speed = start_rad.copy(), np.zeros_like(start_rad)
    path = []
    for _ in range(steps):
        mass, bias = mass_and_bias(spec, angle[None], speed[None])
        speed = speed - spec.timing.drive_s * np.linalg.solve(mass[0], bias[0])
        angle = angle + spec.timing.drive_s * speed
        path.append(angle)
    return np.array(path)
