"""Targets are lost on the bus; the drive keeps the last one."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Probability that a policy period's target is lost.

    Law: In each policy period the target is lost with this probability, and the last one kept. One
      draw decides for all joints (a packet holds them all): joints of one share lose the same
      packets. The first target of an episode is never lost. A larger share loses the same packets
      and more.
    Source: Zero-order hold under Bernoulli losses: Schenato et al., *Foundations of control and
      estimation over lossy networks*, Proc. IEEE 95 (2007).
    Hardware: Lost status packets are reported on Dynamixel buses (DynamixelSDK, issues 228 and
      302); EtherCAT masters count late ones (PR2, wiki.ros.org/pr2_etherCAT). No published range
      found.
    Log: Now and then a response is one or more periods late, then catches up in a jump.
    Confused with: Unexplained noise of every kind: a fit must pay for each loss it claims.
    """

    group = "drive"
    dimension, unit = "share", "%"
    bounds = (0.0, 0.95)
    levels = (0.05, 0.15, 0.4)
    number = "command.loss_share"
