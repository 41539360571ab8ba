"""Domain randomisation as in the paper: another world for every episode's draw.

Gains, gear stiffness and gear damping come from normal distributions (the spread of a
calibration); the stick's mass, radius and friction from uniform ones.
"""

import dataclasses

import numpy as np

from backends.spec import Drive, Spec

GAIN_STD = 0.05
"""Relative standard deviation of kp and kd."""
GEAR_STD = 0.10
"""Relative standard deviation of gear stiffness and damping."""
MASS_SHARE, RADIUS_SHARE, FRICTION_SHARE = 0.3, 0.1, 0.2
"""Half widths of the uniform distributions, relative to nominal."""


def randomize(spec: Spec, rng: np.random.Generator) -> Spec:
    """A world drawn around `spec`."""
    drives = tuple(_drive(drive, rng) for drive in spec.drives)
    mass, radius, friction = 1 + rng.uniform(-1, 1, 3) * (MASS_SHARE, RADIUS_SHARE, FRICTION_SHARE)
    stick = dataclasses.replace(
        spec.stick,
        mass_kg=float(spec.stick.mass_kg * mass),
        radius_m=float(spec.stick.radius_m * radius),
        friction=float(spec.stick.friction * friction),
    )
    return dataclasses.replace(spec.with_drives(drives), stick=stick)


def _drive(drive: Drive, rng: np.random.Generator) -> Drive:
    kp, kd, stiffness, damping = 1 + np.clip(rng.normal(size=4), -2, 2) * (
        GAIN_STD,
        GAIN_STD,
        GEAR_STD,
        GEAR_STD,
    )
    return dataclasses.replace(
        drive,
        kp_nm_rad=float(drive.kp_nm_rad * kp),
        kd_nms_rad=float(drive.kd_nms_rad * kd),
        gear_stiffness_nm_rad=float(drive.gear_stiffness_nm_rad * stiffness),
        gear_damping_nms_rad=float(drive.gear_damping_nms_rad * damping),
    )
