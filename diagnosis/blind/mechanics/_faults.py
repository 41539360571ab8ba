"""Laws of faults that equations of motion share."""

import numba
import numpy as np

HEAT_S = 3.0
"""Time constant of a motor's heat [s]."""
TEETH = 18.0
"""Periods of cogging per 2 pi rad."""
STOP_STIFFNESS = 30.0
"""Stiffness of an end stop over the servo's kp."""


@numba.njit(cache=True)
def warmed(heat, load, tick_s):
    """Heat of a motor after a tick at a share of its torque limit; 1 for lasting full torque."""
    return heat + tick_s / HEAT_S * (load * load - heat)


@numba.njit(cache=True)
def faded(fade, heat):
    """Share of its torque that a motor of some heat still gives."""
    return 1 - min(fade * heat, 0.9)


@numba.njit(cache=True)
def one_way(uneven, speed):
    """Dry friction in one direction alone."""
    return max(uneven * np.sign(speed), 0.0)


@numba.njit(cache=True)
def reached(torque, speed, limit, emf):
    """What is left of a torque as a motor's back-EMF takes the voltage that drives it."""
    if emf == 0.0 or torque * speed <= 0.0:
        return torque
    left = max(limit - emf * abs(speed), 0.0)
    return min(max(torque, -left), left)


@numba.njit(cache=True)
def cogged(cogging, motor):
    """Torque of a motor with cogging."""
    return cogging * np.sin(TEETH * motor)


@numba.njit(cache=True)
def stopped(angle, speed, stop, lower, upper, kp, kd):
    """Torque of an end stop on a link: a spring with a damper that only pushes.

    It stands `stop` inside of the upper end of the range, or of the lower one where negative.
    """
    side = np.sign(stop)
    depth = side * (angle - (upper if stop > 0.0 else lower) + stop)
    if stop == 0.0 or depth <= 0.0:
        return 0.0
    return -side * max(STOP_STIFFNESS * kp * depth + kd * side * speed, 0.0)
