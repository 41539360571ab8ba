"""MuJoCo: many worlds on a thread pool."""

import logging
import math
from collections.abc import Sequence

import mujoco
import numba
import numpy as np

from backends._mujoco_drive import APPLIED, CALLBACK, USER_NUMBERS, CallbackArgs
from backends._mujoco_worlds import HAS_SENSOR, SLOT, Touching, pool
from backends.engine import EXACT, SHARED_SUPPORT, Engine, Team
from backends.spec import Contact, Fingertip, Spec, field_names
from backends.state import Array, InitialState, matrices

IMPRATIO = 100.0
"""impratio: ratio of friction to normal impedance. At 10 the stick creeps by 0.09 mm/s, at 1 it
falls within 2 s."""
ITERATIONS, LINE_SEARCH_ITERATIONS = 20, 50
"""Iteration limits of the Newton solver; 4 and 8 do not converge with this impratio."""
CONTACTS_PER_TIP = 4
"""Contacts that the sensor of one fingertip reports; a square stick makes two or more."""
_FINGER_BIT, _STICK_BIT = 1, 2

# What runs away is told by `first_bad_signal`; else MuJoCo says so in a file where the user is.
mujoco.set_mju_user_warning(logging.getLogger(__name__).info)


def build(spec: Spec) -> mujoco.MjSpec:
    """The world of `spec` as an uncompiled MuJoCo model; fingers touch only the stick."""
    model = mujoco.MjSpec()
    model.compiler.degree = False
    model.nuserdata = USER_NUMBERS
    option = model.option
    option.timestep = spec.timing.drive_s
    option.gravity = spec.gravity_m_s2
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.impratio = IMPRATIO
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    option.iterations = ITERATIONS
    option.ls_iterations = LINE_SEARCH_ITERATIONS
    _add_hand(model, spec)
    _add_stick(model, spec)
    return model


def _add_hand(model: mujoco.MjSpec, spec: Spec) -> None:
    hand = spec.hand
    model.worldbody.add_geom(
        name="palm",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=hand.palm_center_m,
        size=hand.palm_half_size_m,
        contype=0,
        conaffinity=0,
    )
    bodies: dict[str | None, mujoco.MjsBody] = {None: model.worldbody}
    for body in (one.loaded for one in hand.bodies):
        node = bodies[body.parent].add_body(
            name=body.name,
            pos=body.origin_m,
            mass=body.mass_kg,
            ipos=body.com_m,
            iquat=(1, 0, 0, 0),
            inertia=body.inertia_kgm2,
            explicitinertial=True,
        )
        if body.joint.drive is not None:
            node.add_joint(
                name=body.joint.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=body.joint.axis
            )
        bodies[body.name] = node
    for tip in hand.fingertips:
        _add_tip(model, bodies[tip.body], tip, spec)


def _add_tip(model: mujoco.MjSpec, node: mujoco.MjsBody, tip: Fingertip, spec: Spec) -> None:
    center, forward = np.array(tip.center_m), np.array(tip.forward)
    node.add_geom(
        name=tip.finger,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[*(center - tip.length_m * forward), *center],
        size=[tip.radius_m, 0, 0],
        contype=_FINGER_BIT,
        conaffinity=_STICK_BIT,
        **_surface(spec),
    )
    if not HAS_SENSOR:
        return
    data = (
        mujoco.mjtConDataField.mjCONDATA_FOUND,
        mujoco.mjtConDataField.mjCONDATA_FORCE,
        mujoco.mjtConDataField.mjCONDATA_POS,
        mujoco.mjtConDataField.mjCONDATA_NORMAL,
    )
    model.add_sensor(
        name=tip.finger,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_GEOM,
        objname=tip.finger,
        reftype=mujoco.mjtObj.mjOBJ_GEOM,
        refname="stick",
        intprm=[sum(1 << int(d) for d in data), 0, CONTACTS_PER_TIP],
    )


def _add_stick(model: mujoco.MjSpec, spec: Spec) -> None:
    stick = spec.stick
    body = model.worldbody.add_body(name="stick")
    body.add_freejoint(name="stick")
    half, r = stick.length_m / 2, stick.radius_m
    shapes = {
        "capsule": (mujoco.mjtGeom.mjGEOM_CAPSULE, [r, half - r, 0]),
        "box": (mujoco.mjtGeom.mjGEOM_BOX, [r, r, half]),
    }
    kind, size = shapes[stick.shape]
    body.mass = stick.mass_kg
    body.ipos = (0, 0, 0)
    body.iquat = (1, 0, 0, 0)
    body.inertia = stick.inertia_kgm2
    body.explicitinertial = True
    body.add_geom(
        name="stick",
        type=kind,
        size=size,
        contype=_STICK_BIT,
        conaffinity=_FINGER_BIT,
        **_surface(spec),
    )


def _surface(spec: Spec) -> dict:
    """Contact parameters, set alike on both geoms: MuJoCo takes the larger of the two.

    MuJoCo's torsional coefficient multiplies only the normal force, so it contains the friction
    coefficient too.
    """
    friction = spec.stick.friction
    return {
        "condim": 4,
        "friction": [friction, friction * spec.contact.spin_m, 1e-4],
        "solref": [spec.contact.time_constant_s, 1.0],
    }


def compiled(spec: Spec) -> mujoco.MjModel:
    """The world of `spec` as a compiled model with contacts as soft as the spec says."""
    model = build(spec).compile()
    if spec.contact.compliance_m_n > 0.0:
        for tip in spec.hand.fingertips:
            _soften(model, tip.finger, spec.contact)
    if spec.contact.creep_m_ns > 0.0:
        own_m_ns = _creep_m_ns(model, spec.hand.fingertips[0].finger)
        model.opt.impratio *= own_m_ns / (own_m_ns + spec.contact.creep_m_ns)
    return model


def _inverse_kg(model: mujoco.MjModel, finger: str) -> float:
    """MuJoCo's estimate of a contact's inverse mass, from the invweight0 of the two bodies."""
    bodies = [model.geom(finger).bodyid[0], model.body("stick").id]
    return float(model.body_invweight0[bodies, 0].sum())


def _creep_m_ns(model: mujoco.MjModel, finger: str) -> float:
    """Speed of a light contact per force along its surface.

    A contact of impedance d, time constant t and inverse mass a resists slip by b v = R f at rest,
    b = 2 / (d_max t) and R = (1 - d) / d a / impratio: "Solver parameters" in MuJoCo's
    documentation.
    """
    tip = model.geom(finger)
    light, deep = tip.solimp[:2]
    inverse_kg = (1 - light) / light * _inverse_kg(model, finger) / model.opt.impratio
    return float(inverse_kg * deep * tip.solref[0] / 2)


def _soften(model: mujoco.MjModel, finger: str, contact: Contact) -> None:
    """Let a fingertip yield in proportion to its load, on top of its own yield at light load.

    A contact of impedance d, time constant t and inverse mass a yields at rest by
    (1 - d) (d_max t / d)^2 a per unit of force: "Solver parameters" in MuJoCo's documentation. A
    constant impedance makes this linear.
    """
    tip, inverse_kg = model.geom(finger), _inverse_kg(model, finger)
    light, deep = tip.solimp[:2]
    own_m_n = (1 - light) * (deep * contact.time_constant_s / light) ** 2 * inverse_kg
    time_s = math.sqrt((own_m_n + contact.compliance_m_n) / ((1 - light) * inverse_kg))
    tip.solref[:] = time_s, 1.0
    tip.solimp[:2] = light
    tip.priority[:] = 1  # else MuJoCo takes the mean with the stick's


@numba.njit(cache=True)
def _apply(torque, force, joint_at, stick_at, applied):
    for n in range(torque.shape[0]):
        for j in range(torque.shape[1]):
            applied[n, joint_at[j]] = torque[n, j]
        for i in range(3):
            applied[n, stick_at + i] = force[n, i]


@numba.njit(cache=True)
def _controls(torque, force, lifted, joint_at, stick_at, applied):
    for n in range(torque.shape[0]):
        for t in range(torque.shape[1]):
            for j in range(torque.shape[2]):
                applied[n, t, joint_at[j]] = torque[n, t, j]
            for i in range(3):
                applied[n, t, stick_at + i] = force[n, i] if t < lifted[n] else 0.0


@numba.njit(cache=True)
def _joints(qpos, qvel, qpos_at, qvel_at, angle, rate):
    for n in range(angle.shape[0]):
        for j in range(angle.shape[1]):
            angle[n, j], rate[n, j] = qpos[n, qpos_at[j]], qvel[n, qvel_at[j]]


@numba.njit(cache=True)
def _observed(qpos, qvel, sensors, places, joints, pos, quat, vel, omega, point, force):
    """Read the joints, stick and twist, and each tip's mean contact point by load, and its force.

    `places` are those of joints and stick in `qpos` and `qvel`.
    """
    qpos_at, qvel_at, stick, twist = places
    _joints(qpos, qvel, qpos_at, qvel_at, *joints)
    turn = np.empty((1, 3, 3))
    for n in range(len(pos)):
        for i in range(3):
            pos[n, i], vel[n, i] = qpos[n, stick + i], qvel[n, twist + i]
        for i in range(4):
            quat[n, i] = qpos[n, stick + 3 + i]
        matrices(quat[n : n + 1], turn)
        for i in range(3):
            omega[n, i] = 0.0
            for j in range(3):
                omega[n, i] += turn[0, i, j] * qvel[n, twist + 3 + j]
        for tip in range(point.shape[1]):
            total = 0.0
            point[n, tip], force[n, tip] = 0.0, 0.0
            for k in range(CONTACTS_PER_TIP):
                at = (tip * CONTACTS_PER_TIP + k) * SLOT
                press = max(sensors[n, at + 1], 0.0) if sensors[n, at] > 0 else 0.0
                total += press
                for i in range(3):
                    point[n, tip, i] += press * sensors[n, at + 4 + i]
                    force[n, tip, i] -= press * sensors[n, at + 7 + i]
            for i in range(3):
                point[n, tip, i] /= max(total, 1e-12)


class Backend(Engine):
    """N MuJoCo worlds that share one model; fields in which they differ are kept per world."""

    package = "mujoco"
    steps_in_threads = True
    # Light contacts: (1 - d) (d_max t / d)^2 / m with t = 4 ms and 1 / m = 40.2 / kg.
    # A tip that slides bounces: it is off in 93 of 100 steps, held with 0.1 N or less.
    own = {"contact.compliance_m_n": 7.161e-5, "contact.touch_n": 0.1}
    support = {
        **{name: EXACT for name in field_names() if name.split(".")[0] in {"body", "fingertip"}},
        **SHARED_SUPPORT,
        "joint.axis": EXACT,
        "joint.slides": "refused: only hinge joints are built",
        "body.products_kgm2": "refused: only moments of inertia are passed on",
        "stick.shape": EXACT,
        "stick.length_m": EXACT,
        "stick.radius_m": EXACT,
        "stick.mass_kg": EXACT,
        "stick.friction": "approximate: elliptic cone with impratio 100; creeps by 0.01 mm/s",
        "stick.grip_to_lower_end_m": EXACT,
        "contact.torsion_radius_m": EXACT,
        "contact.time_constant_s": EXACT,
        "contact.creep_m_ns": "approximate: added to 0.085 mm/(N s); less where a tip is deep",
        "contact.spin_radius_m": "approximate: slip and spin share one ellipsoid",
        "contact.compliance_m_n": "approximate: added to the engine's own yield of about 0.07 mm/N",
        "spec.gravity_m_s2": EXACT,
    }

    def __init__(self, specs: Sequence[Spec], threads: int = 1) -> None:
        super().__init__(specs)
        distinct = {spec.digest: spec for spec in specs}
        order = list(distinct)
        models = [compiled(spec) for spec in distinct.values()]
        self._model = models[0]
        rows = [order.index(spec.digest) for spec in specs]
        tips = tuple(tip.finger for tip in specs[0].hand.fingertips)
        touching = Touching(tips=tips, stick="stick", slots=CONTACTS_PER_TIP)
        self._batch = pool(models, rows, threads, touching)
        joints = [self._model.joint(name) for name in specs[0].hand.joint_names]
        self._qpos_at = np.array([j.qposadr[0] for j in joints])
        self._qvel_at = np.array([j.dofadr[0] for j in joints])
        free = self._model.joint("stick")
        self._stick_qpos = slice(free.qposadr[0], free.qposadr[0] + 7)
        self._stick_qvel = slice(free.dofadr[0], free.dofadr[0] + 6)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._applied = self._batch.bind("qfrc_applied")
        self._sensors = self._batch.bind("sensordata")
        self._no_force = np.zeros((len(specs), 3))
        self._args = CallbackArgs(
            self._teams[0],
            self._age_steps,
            (self._model.nq, self._model.nv),
            (self._qpos_at, self._qvel_at),
            self._stick_qvel.start,
        )
        self._batch.bind("userdata")[:] = self._args.user_data()
        self._start = self._batch.state.copy()

    def close(self) -> None:
        """Stop the thread pool."""
        self._batch = None

    def _place(self, ids: Array, initial: InitialState) -> None:
        self._batch.state[ids] = self._start[ids]
        self._qpos[ids[:, None], self._qpos_at] = initial.joint_rad[ids]
        center = self._stick_qpos.start
        self._qpos[ids, center : center + 3] = initial.stick_pos_m[ids]
        self._qpos[ids, center + 3 : center + 7] = initial.stick_quat_wxyz[ids]

    def _tick(self, rows: slice, torque_nm: Array, stick_force_n: Array | None) -> None:
        force = self._no_force if stick_force_n is None else stick_force_n
        _apply(torque_nm, force, self._qvel_at, self._stick_qvel.start, self._applied)
        self._batch.step(nstep=1)
        self._read_joints()

    def _rollout(self, team: Team, torque_nm: Array) -> None:
        worlds, ticks, _ = torque_nm.shape
        applied = np.zeros((worlds, ticks, self._model.nv))
        acting = team.carry_n, team.lifted_ticks(self._age_steps)
        _controls(torque_nm, *acting, self._qvel_at, self._stick_qvel.start, applied)
        self._batch.rollout(ticks, applied, APPLIED, record=())
        self._age_steps += ticks
        self._read_joints()

    def _period(
        self, team: Team, target_rad: Array, load_nm: Array | None, pull_n: Array | None
    ) -> None:
        if load_nm is not None or pull_n is not None or not team.plain:
            super()._period(team, target_rad, load_nm, pull_n)
            return
        self._args.drive_args.target_rad[:] = target_rad
        mujoco.set_mjcb_control(CALLBACK)
        try:
            self._batch.step(nstep=self._timing.substeps)
        finally:
            mujoco.set_mjcb_control(None)

    def _read_joints(self) -> None:
        joints = self._qpos_at, self._qvel_at, self.state.joint_rad, self.state.joint_rad_s
        _joints(self._qpos, self._qvel, *joints)

    def _observe(self, rows: slice) -> None:
        state, stick, twist = self.state, self._stick_qpos.start, self._stick_qvel.start
        places = self._qpos_at, self._qvel_at, stick, twist
        joints = state.joint_rad, state.joint_rad_s
        pose = state.stick_pos_m, state.stick_quat_wxyz
        moves = state.stick_vel_m_s, state.stick_omega_rad_s
        contacts = state.contact_point_m, state.contact_force_n
        read = self._qpos, self._qvel, self._sensors
        _observed(*read, places, joints, *pose, *moves, *contacts)
