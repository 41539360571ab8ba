"""Targets reach the drive late."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Time from the moment a target is sent until the drive follows it.

    Law: The drive follows the target of t - delay, linear between drive periods.
    Source: Transport and bus time; Tan et al., *Sim-to-real: learning agile locomotion for
      quadruped robots*, RSS 2018, arXiv 1804.10332, model latency and show that it matters.
    Hardware: 1 to 5 ms fitted on STS3215 (BAM, m1 and m4, `command_delay`); the USB adapter of
      Dynamixel buses adds up to 16 ms unless its latency timer is lowered (DynamixelSDK, issues 302
      and 330).
    Log: The response to steps starts later, with the same shape.
    Confused with: sensor-delay: their sum is what an open-loop log shows, both delays together
      cannot be split by it; the touch or the stick, which that sensor does not see, can.
    """

    group = "drive"
    dimension, unit = "time", "ms"
    bounds = (0.0, 0.2)
    levels = (0.002, 0.006, 0.02)
    number = "command.delay_s"
    tolerance = 0.0015
    least = 0.003
    most = 0.2
    shared = True
    near = ("sensor-delay", "command-rate-limit")
