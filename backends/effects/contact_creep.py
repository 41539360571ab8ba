"""The contacts creep under a load along their surface."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Speed at which a contact that sticks creeps, per unit of force along its surface.

    Law: A contact that sticks moves along its surface at (own + magnitude) times the force along
      it: a damper, up to Coulomb's limit. MuJoCo's contacts creep by their regularisation, and
      `impratio` sets by how much.
    Source: MuJoCo documentation, "Solver parameters" and `impratio`; Tiezzi and Kao, *Modeling of
      viscoelastic contacts*, IEEE T-RO 23, 2007, for skins that creep, which stop in the end.
    Hardware: No published range found for sticks in fingertips.
    Log: The stick sinks slowly and steadily while the grip holds. No diagnosis looks for it.
    Confused with: contact-friction, whose slip needs a load beyond a limit.
    """

    group = "stick and contact"
    dimension, unit = "mobility", "mm/Ns"
    bounds = (0.0, 5e-3)
    levels = (2e-4, 5e-4, 2e-3)
    number = "contact.creep_m_ns"
    per_joint, drawn = False, False
