"""A real side in the engine Exudyn: hands in free air; never used for tuning.

The links are an `ObjectKinematicTree` in minimal coordinates. Every drive period is one step of the
explicit Runge-Kutta rule of fourth order, under constant drive torques. (An implicit step starts
from the acceleration under the previous torques, so it would act half a period late.) The drives
are those of every backend, see `backends.engine`, at 4 kHz.

Exudyn: J. Gerstmayr, Multibody System Dynamics 60, 2024.
"""

import exudyn as exu
import numpy as np
from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree
from scipy.spatial.transform import Rotation

from backends.spec import Body, Spec
from backends.state import Array
from diagnosis.blind.engines._free import FreeHands

EPISODE_S = 1e4
"""Longest episode; the engine divides a total time into steps."""


def _turned(body: Body) -> Array:
    """Rotation (3, 3) from a frame whose z is the joint axis to the body frame."""
    return Rotation.align_vectors([body.joint.axis], [[0.0, 0.0, 1.0]])[0].as_matrix()


def _inertia(body: Body) -> Array:
    """Inertia about the centre of mass (3, 3) [kg m^2] in the body's frame."""
    xy, xz, yz = body.products_kgm2
    return np.diag(body.inertia_kgm2) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])


def _tree(spec: Spec, node: int) -> ObjectKinematicTree:
    """The driven bodies; the links are rotated so that every hinge is about z.

    Raises ValueError for a body that is fixed on another one: its mass would be missing.
    """
    driven = [body.loaded for body in spec.hand.driven]
    fixed = {body.name: body for body in spec.hand.bodies if body.joint.drive is None}
    for body in fixed.values():
        if body.parent is not None:
            raise ValueError(
                f"{body.name} is fixed to {body.parent}; only base bodies can be fixed"
            )
    numbers: dict[str | None, int] = {body.name: n for n, body in enumerate(driven)}
    parents = []
    turns, offsets = exu.Matrix3DList(), exu.Vector3DList()
    inertias, centres = exu.Matrix3DList(), exu.Vector3DList()
    for body in driven:
        own, base, origin = _turned(body), np.eye(3), np.array(body.origin_m)
        if body.parent in numbers:
            base = _turned(driven[numbers[body.parent]])
        elif body.parent is not None:
            origin += fixed[body.parent].origin_m
        parents.append(numbers.get(body.parent, -1))
        turns.Append(base.T @ own)
        offsets.Append(base.T @ origin)
        inertias.Append(own.T @ _inertia(body) @ own)
        centres.Append(own.T @ body.com_m)
    return ObjectKinematicTree(
        nodeNumber=node,
        jointTypes=[exu.JointType.RevoluteZ] * len(driven),
        linkParents=parents,
        jointTransformations=turns,
        jointOffsets=offsets,
        linkInertiasCOM=inertias,
        linkCOMs=centres,
        linkMasses=[body.mass_kg for body in driven],
        gravity=list(spec.gravity_m_s2),
        jointForceVector=[0.0] * len(driven),
    )


def _settings(step_s: float) -> exu.SimulationSettings:
    """Settings: steps of this length, no files."""
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.active = False
    settings.timeIntegration.solverType = exu.DynamicSolverType.RK44
    settings.timeIntegration.endTime = EPISODE_S
    settings.timeIntegration.numberOfSteps = round(EPISODE_S / step_s)
    return settings


class _World:
    """One hand, and the solver that steps it through a drive period."""

    def __init__(self, spec: Spec) -> None:
        count = len(spec.hand.driven)
        self._drive_s = spec.timing.drive_s
        self._container = exu.SystemContainer()
        self._system = self._container.AddSystem()
        still = [0.0] * count
        node = self._system.AddNode(
            NodeGenericODE2(
                referenceCoordinates=still,
                initialCoordinates=still,
                initialCoordinates_t=still,
                numberOfODE2Coordinates=count,
            )
        )
        self._links = self._system.AddObject(_tree(spec, node))
        self._system.Assemble()
        self._settings = _settings(self._drive_s)
        self._solver = exu.MainSolverExplicit()
        self._steps = 0

    def place(self, joint_rad: Array) -> None:
        """Put the hand at rest."""
        data, start = self._system.systemData, exu.ConfigurationType.Initial
        data.SetODE2Coordinates(joint_rad, start)
        data.SetODE2Coordinates_t(np.zeros(len(joint_rad)), start)
        self._solver = exu.MainSolverExplicit()
        self._solver.InitializeSolver(self._system, self._settings)
        self._steps = 0

    def step(self, torque_nm: Array, ticks: int) -> tuple[Array, Array]:
        """Joint angles [rad] and speeds [rad/s] after so many drive periods."""
        self._system.SetObjectParameter(self._links, "jointForceVector", torque_nm.tolist())
        self._steps += ticks
        self._solver.it.endTime = self._steps * self._drive_s
        self._solver.SolveSteps(self._system, self._settings)
        data = self._system.systemData
        return data.GetODE2Coordinates(), data.GetODE2Coordinates_t()


class Backend(FreeHands):
    """N hands in free air, one Exudyn system each."""

    drive_s = 2.5e-4

    def _world(self, spec: Spec) -> _World:
        return _World(spec)
