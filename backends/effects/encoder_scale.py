"""The readings of a position sensor are too large or too small by a constant factor."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative error of the readings.

    Law: The angle is read (1 + error) times.
    Source: Calibration of gain; the first term of non-linearity.
    Hardware: No published range found; non-linearity of off-axis magnets is up to 1 deg over a turn
      (ams AS5046 data sheet).
    Log: A difference in proportion to the angle.
    Confused with: encoder-bias in a narrow range; a stiffer or softer kp under a spring load.
    """

    group = "sensing"
    dimension, unit = "share", "%"
    bounds = (-0.5, 0.5)
    levels, opposite = (0.01, 0.03, 0.1), (-0.01, -0.03, -0.1)
    number = "encoder.scale_error"
    least = 0.004
    most = 0.5
    either_sign = True
    exact = True
