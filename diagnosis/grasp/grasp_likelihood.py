"""How far a replay with the stick in the hand is from the log: in stick, joints and torques.

Engines differ in how a grasp moves by more than sensors see, so residuals are measured in that.
"""

from collections.abc import Sequence

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.grasp.simulate_grasps import GraspReplay, ends_m
from diagnosis.motion.held import Held
from diagnosis.motion.recordings import white_noise

EPS = (5e-5, 5e-5, 5e-4)
"""Replays on one engine differ by this where they start differently by rounding [m, rad, Nm]."""
ENGINES = (2e-3, 4e-3, 12e-3)
"""Nominal worlds on Bullet and SAPIEN differ by this from their replay on MuJoCo [m, rad, Nm]."""
ALIKE_S = 0.5
"""Time in which residuals tell as much as one."""
SAME = 0.25
"""A gap under this is left where the log is from the nominal engine; others move the stick
otherwise by 0.35 and more."""


def judged(shown: Sequence[GraspReplay], parts: Sequence[Held], world: Spec) -> tuple[Array, float]:
    """Cost by episode (E,) [nats], with every channel's spread profiled out, and the gap."""
    nats, gaps = [], []
    for one, part in zip(shown, parts, strict=True):
        length = world.stick.length_m
        pairs = (
            (ends_m(one.stick, length), ends_m(part.stick, length)),
            (one.joint_rad, part.joint_rad),
            (one.torque_nm, part.torque_nm),
        )
        cost, ratios = 0.0, []
        for (model, real), eps, far in zip(pairs, EPS, ENGINES, strict=True):
            if np.isfinite(real).all():
                square = np.mean(np.nan_to_num(model - real, nan=1e3) ** 2)
                count = real.shape[1] * part.time_s[-1] / ALIKE_S
                noise = float(np.mean(white_noise(real) ** 2))
                cost += count / 2 * np.log(square + eps**2 + noise)
                ratios.append(max(square - noise, 0.0) / far**2)
        nats.append(cost)
        gaps.append(np.mean(ratios))
    return np.array(nats), float(np.sqrt(np.mean(gaps)))
