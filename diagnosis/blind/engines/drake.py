"""A real side in the engine Drake: hands in free air; never used for tuning.

The links are a `MultibodyPlant` in continuous time. Every drive period is integrated to `ACCURACY`
by an error-controlled Runge-Kutta rule of third order, under constant drive torques. The drives are
those of every backend, see `backends.engine`, at 5 kHz.

Drake: R. Tedrake et al., https://drake.mit.edu, 2019.
"""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.analysis import Simulator

from backends.spec import Body, Spec
from backends.state import Array
from diagnosis.blind.engines._free import FreeHands

ACCURACY = 1e-6
"""Relative error of one drive period; with 1e-9 no joint changes by 1e-9 rad after 3 s."""


class _World:
    """One hand, and the simulator that steps it through a drive period."""

    def __init__(self, spec: Spec) -> None:
        self._drive_s = spec.timing.drive_s
        self._plant = MultibodyPlant(time_step=0.0)
        self._plant.mutable_gravity_field().set_gravity_vector(spec.gravity_m_s2)
        for body in spec.hand.bodies:
            self._add(body.loaded)
        self._plant.Finalize()
        self._simulator = Simulator(self._plant)
        self._simulator.get_mutable_integrator().set_target_accuracy(ACCURACY)
        self._context = self._simulator.get_mutable_context()
        self._torque = self._plant.get_applied_generalized_force_input_port()
        # Drake orders joints by depth, not as they were added.
        joints = [self._plant.GetJointByName(name) for name in spec.hand.joint_names]
        self._order = np.array([joint.velocity_start() for joint in joints])

    def _add(self, body: Body) -> None:
        mass_kg, plant = body.mass_kg, self._plant
        inertia = RotationalInertia(*body.inertia_kgm2, *body.products_kgm2)
        link = plant.AddRigidBody(
            body.name, SpatialInertia.MakeFromCentralInertia(mass_kg, np.array(body.com_m), inertia)
        )
        carrier = plant.world_body() if body.parent is None else plant.GetBodyByName(body.parent)
        place = RigidTransform(np.array(body.origin_m))
        if body.joint.drive is None:
            plant.WeldFrames(carrier.body_frame(), link.body_frame(), place)
            return
        start = plant.AddFrame(FixedOffsetFrame(f"{body.name} origin", carrier.body_frame(), place))
        plant.AddJoint(
            RevoluteJoint(body.joint.name, start, link.body_frame(), np.array(body.joint.axis))
        )

    def place(self, joint_rad: Array) -> None:
        """Put the hand at rest."""
        self._context.SetTime(0.0)
        moved = np.zeros(2 * len(joint_rad))
        moved[self._order] = joint_rad
        self._plant.SetPositionsAndVelocities(self._context, moved)
        self._torque.FixValue(self._context, np.zeros(len(joint_rad)))
        self._simulator.Initialize()

    def step(self, torque_nm: Array, ticks: int) -> tuple[Array, Array]:
        """Joint angles [rad] and speeds [rad/s] after so many drive periods."""
        torque = np.empty(len(torque_nm))
        torque[self._order] = torque_nm
        self._torque.FixValue(self._context, torque)
        self._simulator.AdvanceTo(self._context.get_time() + ticks * self._drive_s)
        moved = self._plant.GetPositionsAndVelocities(self._context)
        return moved[self._order], moved[len(torque) + self._order]


class Backend(FreeHands):
    """N hands in free air, one Drake simulator each."""

    drive_s = 2e-4

    def _world(self, spec: Spec) -> _World:
        return _World(spec)
