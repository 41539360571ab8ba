"""Bullet: one physics client (28 MB) per world; hand and stick are generated as URDF.

A solver pass costs 0.08 us in a grasp. The rest of a step, 12 us, is dynamics, collision and calls.
"""

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from backends._bullet_quiet import OUT, muted, p
from backends._calls import DriveCallArgs, chosen
from backends.engine import EXACT, SHARED_SUPPORT, RollingEngine, Team
from backends.spec import Body, Contact, Fingertip, Hand, Spec, Stick, Vec3, field_names
from backends.state import Array, InitialState

calls = chosen("pybullet", ("3.2.7",), "backends._bullet_calls", "backends._bullet_public")
SOLVER, SOLVER_OF_MORE = p.CONSTRAINT_SOLVER_LCP_PGS, p.CONSTRAINT_SOLVER_LCP_SI
"""Gauss-Seidel on the small dense matrix of the contacts. It gives the result of the default solver
after the same number of passes, at 0.08 us instead of 0.19 us each, but it ignores softness and
spin friction of a contact. Dantzig's solver is even cheaper, but bounds friction by a box."""
ITERATIONS = 100
"""Solver passes. In a circle of 6 s under given targets the lower end is 0.2 mm (rms) from its path
with 2000 passes; that is a thirtieth of its distance to the other engines. With 50 passes it is
0.55 mm, with 200 it is 0.05 mm at 1.4 times the cost. A grasp at rest drifts by up to 0.1 mm/s."""
RESIDUAL = 1e-10
"""Residual at which that other solver stops early. It halves the time in motion and is as
exact as all passes; 1e-8 is 0.2 mm off, 1e-6 is 2 mm off and the stick creeps."""
CONE, CONE_IF_SPIN = 0, 1
"""Friction pyramid instead of the round cone: the cone turns friction away from the slip direction
and dropped the stick in 1 of 8 motions at friction 0.5. Without the cone Bullet does not solve spin
friction."""
_LOSSLESS = {
    "linearDamping": 0.0,
    "angularDamping": 0.0,
    "jointDamping": 0.0,
    "maxJointVelocity": 1e3,
    "activationState": p.ACTIVATION_STATE_DISABLE_SLEEPING,
}
"""Bullet's defaults: damping 0.04, speed limit 100 rad/s, and bodies at rest are put to sleep."""
_BARE = {"rollingFriction": 0.0, "restitution": 0.0}
"""Contacts without constraint rows for rolling; these would cost time and have no effect."""
_TIP_GROUP, _STICK_GROUP = 1, 2


def _text(*values: float) -> str:
    return " ".join(repr(float(v)) for v in values)


def _link(name: str, mass_kg: float, com_m: Vec3, inertia_kgm2: Vec3, collision: str = "") -> str:
    """A URDF link; its inertia axes are parallel to its frame."""
    xx, yy, zz = (_text(i) for i in inertia_kgm2)
    return (
        f'<link name="{name}"><inertial><origin xyz="{_text(*com_m)}"/>'
        f'<mass value="{_text(mass_kg)}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f"{collision}</link>"
    )


def _joint(body: Body) -> str:
    kind = "fixed" if body.joint.drive is None else "continuous"
    return (
        f'<joint name="{body.joint.name}" type="{kind}">'
        f'<parent link="{body.parent or "palm"}"/><child link="{body.name}"/>'
        f'<origin xyz="{_text(*body.origin_m)}"/><axis xyz="{_text(*body.joint.axis)}"/></joint>'
    )


def _collision(shape: str, center_m: Vec3 = (0, 0, 0), axis: Vec3 = (0, 0, 1)) -> str:
    """A URDF shape whose z axis lies along the unit vector `axis`."""
    x, y, z = axis
    turn = _text(0, math.atan2(math.hypot(x, y), z), math.atan2(y, x))
    origin = f'<origin xyz="{_text(*center_m)}" rpy="{turn}"/>'
    return f"<collision>{origin}<geometry>{shape}</geometry></collision>"


def _capsule(radius_m: float, length_m: float) -> str:
    """A capsule along z; `length_m` between the centres of its hemispheres."""
    return f'<capsule radius="{_text(radius_m)}" length="{_text(length_m)}"/>'


def _tip(tip: Fingertip) -> str:
    half = tip.length_m / 2
    x, y, z = (c - half * f for c, f in zip(tip.center_m, tip.forward, strict=True))
    return _collision(_capsule(tip.radius_m, tip.length_m), (x, y, z), tip.forward)


def hand_urdf(hand: Hand) -> str:
    """The hand as URDF; only the fingertips can touch anything."""
    tips = {tip.body: _tip(tip) for tip in hand.fingertips}
    parts = [_link("palm", 1.0, (0, 0, 0), (1, 1, 1))]
    for b in (body.loaded for body in hand.bodies):
        parts.append(_link(b.name, b.mass_kg, b.com_m, b.inertia_kgm2, tips.get(b.name, "")))
        parts.append(_joint(b))
    return f'<robot name="{hand.name}">{"".join(parts)}</robot>'


def stick_urdf(stick: Stick) -> str:
    """The stick as URDF, its long axis along z."""
    side = 2 * stick.radius_m
    shapes = {
        "capsule": _capsule(stick.radius_m, stick.length_m - side),
        "box": f'<box size="{_text(side, side, stick.length_m)}"/>',
    }
    shape = _collision(shapes[stick.shape])
    link = _link("stick", stick.mass_kg, (0, 0, 0), stick.inertia_kgm2, shape)
    return f'<robot name="stick">{link}</robot>'


def _soft(contact: Contact) -> dict[str, float]:
    """A spring and a damper with the time constant of rigid contacts; the stick stays rigid."""
    stiffness_n_m = 1.0 / contact.compliance_m_n
    damping_ns_m = contact.time_constant_s * stiffness_n_m
    return {"contactStiffness": stiffness_n_m, "contactDamping": damping_ns_m}


def _surface(spec: Spec) -> dict[str, float]:
    """Friction of every link and of the stick alike.

    Bullet multiplies the two frictions. Its spin friction per normal force is one's friction times
    the other's spin friction, and the same the other way round. A zero has no constraint row.
    """
    root = math.sqrt(spec.stick.friction)
    return {"lateralFriction": root, "spinningFriction": root * _spin_m(spec) / 2, **_BARE}


def _spin_m(spec: Spec) -> float:
    """Radius of spin friction [m]."""
    return max(spec.contact.spin_radius_m, 0.0)


class _World:
    """A physics client and the ids of hand, stick, joints and fingertips in it."""

    def __init__(self, spec: Spec) -> None:
        self.client = p.connect(p.DIRECT)
        self._set_solver(spec)
        self.hand = self._load(hand_urdf(spec.hand), fixed=True)
        self.stick = self._load(stick_urdf(spec.stick), fixed=False)
        links = range(p.getNumJoints(self.hand, self.client))
        info = [p.getJointInfo(self.hand, i, self.client) for i in links]
        at = {row[1].decode(): i for i, row in enumerate(info)}
        self.joints = [at[name] for name in spec.hand.joint_names]
        self.places = [(*info[joint][3:5], joint) for joint in self.joints]
        """Index of each joint in Bullet's coordinates and speeds, and among its joints."""
        link_at = {row[12].decode(): i for i, row in enumerate(info)}
        self.tips = {link_at[tip.body]: f for f, tip in enumerate(spec.hand.fingertips)}
        """Fingertip number by link number."""
        for body, link in [(self.stick, -1), *((self.hand, i) for i in (-1, *links))]:
            self._set_dynamics(body, link, spec)
        for joint in self.joints:
            p.setJointMotorControl2(
                self.hand, joint, p.VELOCITY_CONTROL, force=0.0, physicsClientId=self.client
            )

    def _set_solver(self, spec: Spec) -> None:
        dt_s = spec.timing.drive_s
        p.setGravity(*spec.gravity_m_s2, physicsClientId=self.client)
        p.setPhysicsEngineParameter(
            fixedTimeStep=dt_s,
            numSolverIterations=ITERATIONS,
            solverResidualThreshold=RESIDUAL,
            enableConeFriction=CONE_IF_SPIN if _spin_m(spec) > 0.0 else CONE,
            contactERP=1 - math.exp(-dt_s / spec.contact.time_constant_s),
            deterministicOverlappingPairs=1,
            enableFileCaching=0,  # else Bullet knows a URDF by its path
            physicsClientId=self.client,
        )
        more = spec.contact.compliance_m_n > 0.0 or _spin_m(spec) > 0.0
        solver = SOLVER_OF_MORE if more else SOLVER
        with muted(OUT):  # "switched solver"
            p.setPhysicsEngineParameter(constraintSolverType=solver, physicsClientId=self.client)

    def _load(self, urdf: str, fixed: bool) -> int:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "body.urdf"
            path.write_text(urdf)
            return p.loadURDF(
                str(path),
                useFixedBase=fixed,
                flags=p.URDF_USE_INERTIA_FROM_FILE | p.URDF_MAINTAIN_LINK_ORDER,
                physicsClientId=self.client,
            )

    def _set_dynamics(self, body: int, link: int, spec: Spec) -> None:
        """Set damping and friction in two calls: in one call Bullet would drop the friction."""
        for numbers in (_LOSSLESS, _surface(spec)):
            p.changeDynamics(body, link, physicsClientId=self.client, **numbers)
        if spec.contact.compliance_m_n > 0.0 and body == self.hand and link in self.tips:
            p.changeDynamics(body, link, physicsClientId=self.client, **_soft(spec.contact))

    def _reset_pairs(self) -> None:
        """Let fingertips collide only with the stick, and drop all cached contacts."""
        for tip in self.tips:
            p.setCollisionFilterGroupMask(self.hand, tip, _TIP_GROUP, _STICK_GROUP, self.client)
        p.setCollisionFilterGroupMask(self.stick, -1, _STICK_GROUP, _TIP_GROUP, self.client)

    def place(self, joint_rad: list[float], pos_m: list[float], quat_wxyz: list[float]) -> None:
        """Place hand and stick at rest, as in a new world."""
        for joint, angle in zip(self.joints, joint_rad, strict=True):
            p.resetJointState(self.hand, joint, angle, 0.0, self.client)
        w, x, y, z = quat_wxyz
        p.resetBasePositionAndOrientation(self.stick, pos_m, (x, y, z, w), self.client)
        p.resetBaseVelocity(self.stick, (0, 0, 0), (0, 0, 0), self.client)
        self._reset_pairs()


class Backend(RollingEngine):
    """N Bullet worlds in one process; threads do not help: pybullet keeps the interpreter lock."""

    package = "pybullet"
    own = {"contact.spin_radius_m": -3e-3}  # it takes the nominal radius as 0
    slop_m = 1e-5
    worlds_in_cache = 8
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
        "stick.friction": "approximate: friction pyramid, a third more grip on its diagonals",
        "stick.grip_to_lower_end_m": EXACT,
        "contact.torsion_radius_m": "approximate: taken as 0; spin friction needs the round cone",
        "contact.time_constant_s": "approximate: rigid contacts, penetration decays in this time",
        "contact.creep_m_ns": "refused: contacts stick without creep",
        "contact.spin_radius_m": "approximate: from 0 on; with it the friction cone is round",
        "contact.compliance_m_n": "approximate: a spring that starts 0.01 mm under the surface",
        "spec.gravity_m_s2": EXACT,
    }

    def __init__(self, specs: Sequence[Spec]) -> None:
        super().__init__(specs)
        self._worlds = worlds = [_World(spec) for spec in specs]
        pointers = np.array([calls.pointer(world.client) for world in worlds], dtype=np.uintp)
        hands = np.array([world.hand for world in worlds], dtype=np.int32)
        self._sticks = np.array([world.stick for world in worlds], dtype=np.int32)
        places = np.array([world.places for world in worlds]).swapaxes(1, 2).copy()
        self._addresses = pointers, hands, places
        tips = worlds[0].tips
        links = range(max(tips, default=-1) + 1)
        self._tip_of_link = np.array([tips.get(link, -1) for link in links], dtype=np.int64)
        self._args = {team: DriveCallArgs(team.drives, team.applied_nm) for team in self._teams}

    def close(self) -> None:
        """Disconnect the clients."""
        for world in self._worlds:
            p.disconnect(world.client)
        pointers, hands, places = self._addresses
        self._worlds, self._addresses = [], (pointers[:0], hands[:0], places[:0])

    def _place(self, ids: Array, initial: InitialState) -> None:
        for n in ids:
            self._worlds[n].place(
                initial.joint_rad[n].tolist(),
                initial.stick_pos_m[n].tolist(),
                initial.stick_quat_wxyz[n].tolist(),
            )

    def _step(self, rows: slice, torque_nm: Array, carried: Array, force_n: Array) -> None:
        angle, speed = self.state.joint_rad[rows], self.state.joint_rad_s[rows]
        worlds = (numbers[rows] for numbers in self._addresses)
        calls.rollout(*worlds, torque_nm, angle, speed, self._sticks[rows], carried, force_n)

    def _period(
        self, team: Team, target_rad: Array, load_nm: Array | None, pull_n: Array | None
    ) -> None:
        rows, ticks, args = team.rows, self._timing.substeps, self._args[team]
        age = self._age_steps[rows]
        if load_nm is not None or pull_n is not None or not team.plain:
            super()._period(team, target_rad, load_nm, pull_n)
            return
        angle, speed = self.state.joint_rad[rows], self.state.joint_rad_s[rows]
        args.target_rad[:] = target_rad
        worlds = (numbers[rows] for numbers in self._addresses)
        carry = self._sticks[rows], team.lifted_ticks(age), team.carry_n
        calls.drive(*worlds, args.address, ticks, angle, speed, *carry)
        age += ticks

    def _observe(self, rows: slice) -> None:
        state = self.state
        clients, hands, sticks = *(a[rows] for a in self._addresses[:2]), self._sticks[rows]
        calls.read_sticks(
            clients,
            sticks,
            state.stick_pos_m[rows],
            state.stick_quat_wxyz[rows],
            state.stick_vel_m_s[rows],
            state.stick_omega_rad_s[rows],
        )
        self._pool_contacts(rows, calls.read_contacts(clients, hands, sticks, self._tip_of_link))
