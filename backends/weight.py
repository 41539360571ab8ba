"""The weight that drives carry beside their laws: gravity compensation, for all engines.

The torque of a link's weight on each hinge that carries the link, at the hinge's own angle:

    tau = -share m axis . ((centre - hinge) x g)
"""

from collections.abc import Sequence

import numba
import numpy as np

from backends.kinematics import common_hand, placed
from backends.spec import Spec
from backends.state import Array


class WeightBank:
    """What is carried in N worlds."""

    def __init__(self, specs: Sequence[Spec]) -> None:
        bodies = specs[0].hand.bodies
        rows = [[b.carried * b.mass_kg for b in spec.hand.bodies] for spec in specs]
        self._carried_kg = np.array(rows).reshape(len(specs), len(bodies))
        self.acts = bool(self._carried_kg.any())
        """Whether anything is carried."""
        if not self.acts:
            return
        common_hand(specs)
        places = {body.name: i for i, body in enumerate(bodies)}
        columns = {name: j for j, name in enumerate(specs[0].hand.joint_names)}
        self._chain = (
            np.array([-1 if b.parent is None else places[b.parent] for b in bodies]),
            np.array([columns.get(b.joint.name, -1) for b in bodies]),
            np.array([b.origin_m for b in bodies], dtype=float),
            np.array([b.joint.axis for b in bodies], dtype=float),
        )
        self._com = np.array([[b.com_m for b in spec.hand.bodies] for spec in specs], dtype=float)
        self._gravity = np.array([spec.gravity_m_s2 for spec in specs], dtype=float)

    def torque_nm(self, joint_rad: Array) -> Array:
        """Torques on the joints (N, J) [Nm] at their angles (N, J)."""
        torque = np.zeros(joint_rad.shape)
        _carry(joint_rad, *self._chain, self._com, self._carried_kg, self._gravity, torque)
        return torque


@numba.njit(cache=True)
def _carry(joint, parent, column, offset, axis, com, carried_kg, gravity, torque):
    at, turn = np.zeros((len(parent) + 1, 3)), np.zeros((len(parent) + 1, 3, 3))
    for n in range(len(joint)):
        placed(joint[n], parent, column, offset, axis, at, turn)
        for b in range(len(parent)):
            if carried_kg[n, b] == 0.0:
                continue
            centre, force = at[b] + turn[b] @ com[n, b], -carried_kg[n, b] * gravity[n]
            carrier = b
            while carrier >= 0:
                if column[carrier] >= 0:
                    moment = np.cross(centre - at[carrier], force)
                    torque[n, column[carrier]] += np.dot(turn[carrier] @ axis[carrier], moment)
                carrier = parent[carrier]
