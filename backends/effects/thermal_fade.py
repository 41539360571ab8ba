"""A motor that gets warm loses torque: its magnets and its supply give less."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Share of its torque that the motor loses at the heat of lasting torque at its limit.

    Law: torque = tau_pd (1 - magnitude heat), at least a tenth; heat' = ((tau_pd / limit)^2 - heat)
      / T from none on, T = 10 s where `drive.thermal_s` says no other. In short it may be loaded
      beyond what it stands for long, so shares above 100 % mean something.
    Source: Copper losses that go as the torque squared, and one thermal mass with a resistance to
      the air: the winding's part of the model in data sheets of motors (maxon, *Key information*).
    Hardware: No published range of a servo found.
    Log: A joint that has worked hard sags and answers softly; after a rest it is as before.
    Confused with: kp-scale and torque-limit, which are so from the start; command-dropout. Episodes
      that are as hard at their end as at their beginning tell.
    """

    group = "drive"
    dimension, unit = "share", "%"
    bounds = (0.0, 30.0)
    levels = (4.0, 8.0, 15.0)
    number = "drive.thermal_fade"
    least = 0.5
    most = 30.0
    near = ("torque-limit", "kp-scale")
