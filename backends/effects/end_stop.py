"""A joint meets an elastic end stop inside of its range: a chip, a cable, a misplaced pin."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """How far inside of the upper end of the range it stands; of the lower end where negative.

    Law: Beyond the stop the joint is pushed back by k (q - stop), from its own side alone; k is the
      stiffness of the teeth where `drive.end_stop_nm_rad` says no other. A joint whose file gives
      no range has half a turn to either side, a slide 1 m, or twice as far as its log goes.
    Source: The penalty law of joint limits in engines; as a one-sided spring, Brogliato, *Nonsmooth
      Mechanics*, 3rd ed., 2016, ch. 2.
    Hardware: No published range found; it is wherever something is in the way.
    Log: The joint does not pass an angle, whatever is commanded beyond it, with a torque that grows
      as the command does. Nothing where it stays short of the stop.
    Confused with: torque-limit, which ends the torque and not the angle; an encoder that saturates,
      which the torque tells apart. A diagnosis looks at the side where a joint falls short more.
    """

    group = "links and gravity"
    dimension, unit = "angle", "deg"
    bounds = (-math.pi / 2, math.pi / 2)
    levels, opposite = (0.7, 0.78, 0.86), (-0.7, -0.78, -0.86)
    number = "drive.end_stop_rad"
    spot = ("drive.end_stop_nm_rad",)
    coordinate = "reach"
    least = 0.004
    most = 1.5
    kinked = True
