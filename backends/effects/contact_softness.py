"""The fingertips yield under load."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Depth by which a contact yields per unit of force, on top of the engine's own softness.

    Law: A contact point yields own + compliance times force: a spring in series with the engine's
      own contact. Within 0.1 % of it from 0.02 to 1 mm/N and 0.3 to 4.7 N in the held grasp of the
      TRX hand (`tests/verification/test_softness.py`). It holds while a contact yields less than
      the stick's radius.
    Source: MuJoCo documentation, "Solver parameters"; PhysX, `PxMaterial::setRestitution`; Johnson,
      *Contact Mechanics*, 1985, for why real pads stiffen with load where this does not.
    Hardware: Human finger pads stiffen exponentially over 0 to 2 N and relax with 4 ms, 70 ms and
      1.4 s (Pawluk and Howe, J. Biomech. Eng. 121, 1999); fluid-filled robot tips yield 3.7 to 5 mm
      at the first newton (regression in *Human Inspired Dexterity in Robotic Manipulation*, table
      7.1: beyond the bounds here). The paper's skin yields 1 mm in all.
    Log: Less squeeze for the same targets, larger patches of active taxels, deeper readings.
    Confused with: series-elasticity and kp-scale of all fingers, stick-radius.
    """

    group = "stick and contact"
    dimension, unit = "compliance", "mm/N"
    bounds = (0.0, 1e-3)
    levels = (4e-5, 1e-4, 2.5e-4)
    number = "contact.compliance_m_n"
    per_joint = False
