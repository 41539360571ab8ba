"""The contacts resist being turned about their normal more or less."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Radius of spin friction on top of the engine's own.

    Law: A contact holds a spin torque up to mu N (r + magnitude), at least none, with the engine's
      own r: 3 mm in MuJoCo and SAPIEN, none in Bullet (`tests/verification/test_spin.py`). MuJoCo
      bounds slip and spin by one ellipsoid; the others bound spin alone.
    Source: Howe and Cutkosky, *Practical force-motion models for sliding manipulation*, 1996:
      r is 3 pi / 16 of the radius of a Hertz contact.
    Hardware: No published range found for fingertips on sticks; a patch of 5 mm radius gives 3 mm.
    Log: The stick turns about the line between two fingertips as its weight pulls, or turns with
      the fingers. No diagnosis looks for it.
    Confused with: contact-friction.
    """

    group = "stick and contact"
    dimension, unit = "length", "mm"
    bounds = (-5e-3, 5e-3)
    levels, opposite = (5e-4, 1e-3, 3e-3), (-5e-4, -1e-3, -2e-3)
    number = "contact.spin_radius_m"
    per_joint, drawn = False, False
