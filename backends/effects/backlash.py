"""Gear play: the joint moves freely by the magnitude to either side of its motor."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Half of the play; on all worm-geared joints unless a joint is named.

    Law: tau_gear = k (m - q -+ play) + c (m' - q') beyond the play, cut at zero so that teeth never
      pull; nothing inside.
    Source: Nordin and Gutman, *Controlling mechanical systems with backlash - a survey*, Automatica
      38 (2002). The cut: Nordin, Galic and Gutman, Int. J. Adaptive Control and Signal Processing
      11 (1997), who show that the plain dead zone with damping gives torques of the wrong sign.
    Hardware: Full play 0.25 deg on Dynamixel XH430 and XH540 (ROBOTIS data sheets: 15 arcmin); 0.87
      to 1 deg measured on Feetech STS3215 against 0.5 deg on its data sheet (Robonine; issue 134 of
      TheRobotStudio/SO-ARM100). `built` has +-1 deg.
    Log: The joint rests while the motor reverses; under a push to and fro it jumps by twice the
      magnitude without the motor moving.
    Confused with: coulomb-friction (both delay a reversal), and nearly invisible where only the
      motor is measured. A known push, or a second encoder on the link, tells them apart. At rest
      also dead-zone.
    """

    group = "gears and joints"
    dimension, unit = "angle", "deg"
    bounds = (0.0, math.radians(10))
    levels = (0.003, 0.009, 0.026)
    number = "drive.play_rad"
    gear = "worm"
    whole = 2.0
    tolerance = 0.0003
    least = 0.001
    most = 0.2
    kinked = True
    family = "lost motion"
    by_column = True
    near = ("series-elasticity",)
