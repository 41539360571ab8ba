"""Targets reach the drive late by a random time: a control loop without a real-time clock."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Longest lateness of a policy period's target.

    Law: Each period's target is sent late by a time that is uniform between 0 and the magnitude,
      the same for all joints, and never if the next one is due before: a missed deadline.
    Source: Gutierrez et al., *Towards a distributed and real-time framework for robots: Evaluation
      of ROS 2.0 communications for real-time robotic applications*, 2018, arXiv 1809.02595, count
      late and missed deadlines.
    Hardware: Milliseconds on a computer that does other work, tens of microseconds with a real-time
      kernel; no published range of one robot found.
    Log: Steps answer now earlier, now later; fast motion is rough. Stamps at the drive show it
      directly.
    Confused with: command-delay, whose lateness is constant, and command-dropout, whose is a whole
      number of periods. A diagnosis here does not look for it: where the drive's law is not
      exact, what it leaves at every jump looks alike.
    """

    group = "drive"
    dimension, unit = "time", "ms"
    bounds = (0.0, 0.2)
    levels, drawn = (0.002, 0.006, 0.02), False
    number = "command.jitter_s"
    near = ("command-delay", "command-dropout")
