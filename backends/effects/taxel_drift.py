"""Taxel readings drift away from zero, each with its own rate."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Fastest rate, as pressed depth per time; each taxel has a fixed rate from zero to this.

    Law: Every reading grows by its own rate, evenly spread between none and the fastest, from the
      episode's start on, touched or not.
    Source: Schmitz et al., *Methods and technologies for the implementation of large-scale robot
      tactile sensors*, IEEE Trans. Robotics 27 (2011), describe and compensate drift and
      hysteresis.
    Hardware: No published range found in units of depth.
    Log: Readings without contact that grow with time; in the end taxels are active by themselves.
    Confused with: taxel-threshold (negative) late in an episode; the start tells.
    """

    group = "touch"
    dimension, unit = "drift", "mm/s"
    bounds = (0.0, 1e-3)
    levels = (2e-5, 7e-5, 2.5e-4)
    number = "taxels.drift_m_s"
    per_joint = False
