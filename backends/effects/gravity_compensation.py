"""The feed-forward that carries an arm's weight carries too little of it, or too much."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Share of the links' weight that is carried on top of what the model says.

    Law: On every joint the torque of the weight of the concerned links times the magnitude is added
      beside the drive's law, at the joint's own angle. -100 % is a compensation that is missing,
      +100 % one that is doubled, or one that the model does not say.
    Source: PD control with gravity compensation, Siciliano et al., *Robotics*, 2009, ch. 8.5; the
      `gravcomp` of MuJoCo's bodies.
    Hardware: A switch of the controller, and a model with the mounted tool or without it; no
      published range found.
    Log: At rest a joint stands beside its target by share times load / kp, as its pose says; the
      motion is as quick as before.
    Confused with: link-mass and payload, whose inertia shows in motion; gravity-tilt, which turns
      the pattern over the poses; kp-scale where all poses are alike.
    """

    group = "links and gravity"
    dimension, unit = "share", "%"
    bounds = (-2.0, 2.0)
    levels, opposite = (0.2, 0.5, 1.0), (-0.2, -0.5, -1.0)
    number = "body.carried"
    by_weight = True
    least = 0.1
    most = 2.0
    either_sign = True
    shared = True
    near = ("link-mass", "payload", "gravity-tilt")
