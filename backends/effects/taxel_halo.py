"""The neighbours of a pressed taxel respond too."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Distance up to which the neighbours of a pressed taxel respond.

    Law: Taxels nearer than this to an active one count too; their readings stay. The grid is 2.4 x
      2.9 mm: a halo under 2.4 mm does nothing.
    Source: Skin that carries strain sideways; crosstalk of row-and-column readout.
    Hardware: None measurable on the iCub fingertip (Jamali et al., IROS 2015), whose taxels have
      overlapping fields all the same. No published range found.
    Log: Larger patches of active taxels, their centre nearly the same.
    Confused with: contact-softness (which enlarges the patch by pressing deeper, in the readings
      too).
    """

    group = "touch"
    dimension, unit = "length", "mm"
    bounds = (0.0, 0.02)
    levels = (0.003, 0.005, 0.008)
    number = "taxels.halo_m"
    per_joint = False
