"""A spring beside the drive: a counterbalance, a return spring, a hose or a cable."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Stiffness of a linear spring from the joint's link to the one before it.

    Law: tau = -magnitude (q - rest), with `drive.spring_rest_rad` of the world as its rest: 0 where
      nothing sets it. A diagnosis finds the rest as well.
    Source: Hooke's law, as joints of MuJoCo have it (`stiffness` and `springref`).
    Hardware: No published range found at the joint of a hand.
    Log: The joint stops short of its targets to both sides of an angle, by more the further it is
      from there, alike in both directions and at any speed; torque as much as that.
    Confused with: kp-scale and encoder-scale, of which the torque shows nothing; payload and
      gravity-compensation, whose torque turns with gravity.
    """

    group = "links and gravity"
    dimension, unit = "stiffness", "Nm/rad"
    bounds = (0.0, 50.0)
    levels = (0.03, 0.1, 0.3)
    number = "drive.spring_nm_rad"
    spot = ("drive.spring_rest_rad",)
    nominal = True
    breaks = True
    least = 0.02
    most = 3.0
    near = ("kp-scale", "payload")
