"""SAPIEN: one PhysX CPU scene per world, stepped one after the other without a renderer."""

import warnings
from collections.abc import Sequence

import numpy as np

from backends._calls import DriveCallArgs, chosen
from backends.engine import EXACT, SHARED_SUPPORT, RollingEngine, Team
from backends.spec import Body, Fingertip, Spec, Stick, Vec3, field_names
from backends.state import Array, InitialState

with warnings.catch_warnings():
    warnings.filterwarnings("ignore", message="Failed to find system libvulkan")
    import sapien
    from sapien import physx

calls = chosen("sapien", ("3.0.3",), "backends._sapien_calls", "backends._sapien_public")

POSITION_ITERATIONS = 16
"""Iterations of the TGS solver. Under finger motion, 8 and 4 differ from MuJoCo 1.5 and 2 times
more; 32 and 64 do not differ less."""
VELOCITY_ITERATIONS = 1
"""Velocity iterations. 0, 1 and 4 differ equally from MuJoCo; 1 is PhysX's default."""
CONTACT_OFFSET_M = 1e-3
"""Distance at which contacts are created; 0.1 to 10 mm give the same grasp, 10 mm is SAPIEN's
default."""
UNLIMITED = 1e6
"""Speed limit that nothing reaches [m/s or rad/s]; SAPIEN's own limits for links are 10 and 50."""
_FINGER_BIT, _STICK_BIT = 1, 2
_SINGLE = "approximate: 32-bit floats, relative error 6e-8"


def _turn_x_to(axis: Vec3) -> Array:
    """Shortest rotation, w x y z, from the x axis to the unit vector `axis`."""
    if axis[0] < -0.999999:
        return np.array([0.0, 0.0, 0.0, 1.0])
    quat = np.array([1 + axis[0], 0.0, -axis[2], axis[1]])
    return quat / np.linalg.norm(quat)


def _make_rigid(
    body: physx.PhysxRigidBodyComponent, mass_kg: float, com_m: Vec3, inertia_kgm2: Vec3
) -> None:
    """Set the inertia and remove PhysX's damping and speed limits."""
    body.mass = mass_kg
    body.cmass_local_pose = sapien.Pose(com_m)
    body.inertia = inertia_kgm2
    body.linear_damping = body.angular_damping = 0.0
    body.max_linear_velocity = body.max_angular_velocity = UNLIMITED


def _make_joint(joint: physx.PhysxArticulationJoint, body: Body) -> None:
    """A hinge about x of its frames, without friction and limits; fixed if it has no drive."""
    turn = _turn_x_to(body.joint.axis)
    driven = body.joint.drive is not None
    joint.name = body.joint.name
    joint.type = "revolute" if driven else "fixed"
    joint.pose_in_parent = sapien.Pose(body.origin_m, turn)
    joint.pose_in_child = sapien.Pose(q=turn)
    if driven:
        joint.limit = [[-np.inf, np.inf]]
        joint.friction = 0.0
        joint.armature = [0.0]
        joint.max_velocity = UNLIMITED
        joint.set_drive_properties(stiffness=0.0, damping=0.0)


class _World:
    """One scene with its hand and stick; fingers touch only the stick."""

    def __init__(self, spec: Spec) -> None:
        soft = spec.contact.compliance_m_n > 0.0
        physx.set_scene_config(gravity=spec.gravity_m_s2, enable_tgs=not soft)
        physx.set_body_config(POSITION_ITERATIONS, VELOCITY_ITERATIONS, sleep_threshold=0.0)
        self.system = physx.PhysxCpuSystem()
        self.system.timestep = spec.timing.drive_s
        self._scene = sapien.Scene([self.system])
        mu = spec.stick.friction
        # PhysX takes a negative restitution for the stiffness of a spring; SAPIEN adds no damper.
        # Under TGS it chatters and a heavy stick creeps 2 mm/s; under PGS it rests.
        spring_n_m = 1 / spec.contact.compliance_m_n if soft else 0.0
        self._material = physx.PhysxMaterial(mu, mu, -spring_n_m)
        self._torsion_radius_m = spec.contact.spin_m
        self.tips: list[physx.PhysxCollisionShape] = []
        self.links = self._add_hand(spec)
        self.hand = self.links[None].articulation
        self.stick = self._add_stick(spec.stick)

    def _add_hand(self, spec: Spec) -> dict[str | None, physx.PhysxArticulationLinkComponent]:
        """Links by body name; the palm is under None, is fixed and touches nothing."""
        palm = physx.PhysxArticulationLinkComponent(None)
        palm.joint.type = "fixed"
        links: dict[str | None, physx.PhysxArticulationLinkComponent] = {None: palm}
        for body in (one.loaded for one in spec.hand.bodies):
            link = physx.PhysxArticulationLinkComponent(links[body.parent])
            for tip in spec.hand.fingertips:
                if tip.body == body.name:
                    link.attach(self._tip_shape(tip))
            _make_rigid(link, body.mass_kg, body.com_m, body.inertia_kgm2)
            _make_joint(link.joint, body)
            links[body.name] = link
        for link in links.values():
            self._add(link)
        return links

    def _tip_shape(self, tip: Fingertip) -> physx.PhysxCollisionShape:
        half_m = tip.length_m / 2
        shape = physx.PhysxCollisionShapeCapsule(tip.radius_m, half_m, self._material)
        center = np.array(tip.center_m) - half_m * np.array(tip.forward)
        shape.local_pose = sapien.Pose(center, _turn_x_to(tip.forward))
        self._make_surface(shape, _FINGER_BIT, _STICK_BIT)
        self.tips.append(shape)
        return shape

    def _add_stick(self, stick: Stick) -> physx.PhysxRigidDynamicComponent:
        half_m, r_m = stick.length_m / 2, stick.radius_m
        shape: physx.PhysxCollisionShape
        if stick.shape == "box":
            shape = physx.PhysxCollisionShapeBox([r_m, r_m, half_m], self._material)
        elif stick.shape != "capsule":
            raise ValueError(f"no stick shape '{stick.shape}'; known: capsule, box")
        else:
            shape = physx.PhysxCollisionShapeCapsule(r_m, half_m - r_m, self._material)
            shape.local_pose = sapien.Pose(q=_turn_x_to((0.0, 0.0, 1.0)))
        self._make_surface(shape, _STICK_BIT, _FINGER_BIT)
        body = physx.PhysxRigidDynamicComponent()
        body.attach(shape)
        _make_rigid(body, stick.mass_kg, (0.0, 0.0, 0.0), stick.inertia_kgm2)
        self._add(body)
        return body

    def _make_surface(self, shape: physx.PhysxCollisionShape, own: int, other: int) -> None:
        """Contact parameters, set alike on both shapes: PhysX averages the frictions.

        The spin radius is set as the smallest patch radius; the other patch radius grows with
        penetration.
        """
        shape.set_collision_groups([own, other, 0, 0])
        shape.contact_offset = CONTACT_OFFSET_M
        shape.rest_offset = 0.0
        shape.patch_radius = 0.0
        shape.min_patch_radius = self._torsion_radius_m

    def _add(self, component: physx.PhysxRigidBodyComponent) -> None:
        entity = sapien.Entity()
        entity.add_component(component)
        self._scene.add_entity(entity)


class Backend(RollingEngine):
    """N SAPIEN scenes; a reset builds new scenes, see `_place`."""

    package = "sapien"
    # Slip takes nothing from spin friction: with 1 mm less, policies turn the stick as in MuJoCo.
    own = {"contact.spin_radius_m": 1e-3}
    worlds_in_cache = 8
    support = {
        **{name: _SINGLE for name in field_names() if name.split(".")[0] in {"body", "fingertip"}},
        **SHARED_SUPPORT,
        "joint.axis": _SINGLE,
        "joint.slides": "refused: only hinge joints are built",
        "body.products_kgm2": "refused: only moments of inertia are passed on",
        "stick.shape": EXACT,
        "stick.length_m": _SINGLE,
        "stick.radius_m": _SINGLE,
        "stick.mass_kg": _SINGLE,
        "stick.friction": "approximate: iterative (TGS), which shifts load between contacts",
        "stick.grip_to_lower_end_m": EXACT,
        "contact.torsion_radius_m": "approximate: only at one-point contacts, whatever slides",
        "contact.time_constant_s": "approximate: contacts are rigid, no penetration to relax",
        "contact.creep_m_ns": "refused: contacts stick without creep",
        "contact.spin_radius_m": "approximate: only at one-point contacts that are not soft",
        "contact.compliance_m_n": "approximate: undamped springs, solved by PGS: a fifth more grip "
        "and no spin friction",
        "spec.gravity_m_s2": _SINGLE,
    }

    def __init__(self, specs: Sequence[Spec]) -> None:
        super().__init__(specs)
        self._worlds = [_World(spec) for spec in specs]
        names = specs[0].hand.joint_names
        # Active joints are ordered breadth-first, whatever the order of building.
        active = [joint.name for joint in self._worlds[0].hand.active_joints]
        self._to_active = np.array([names.index(name) for name in active])
        self._to_spec = np.argsort(self._to_active)
        self._pointers = np.empty((3, len(specs)), dtype=calls.POINTER)
        self._tips = np.empty((len(specs), len(self._worlds[0].tips)), dtype=calls.POINTER)
        self._drive_s = np.float32(self._timing.drive_s)
        for n, world in enumerate(self._worlds):
            self._locate(n, world)
        self._args = {team: DriveCallArgs(team.drives, team.applied_nm) for team in self._teams}

    def _locate(self, n: int, world: _World) -> None:
        """Store where the step, the hand, the stick and the fingertips of a world are."""
        self._pointers[0, n] = calls.pointer(world.system)
        self._pointers[1, n] = calls.pointer(world.hand)
        self._pointers[2, n] = calls.pointer(world.stick)
        self._tips[n] = [calls.pointer(tip) for tip in world.tips]

    def close(self) -> None:
        """Free the scenes."""
        self._worlds, self._pointers = [], self._pointers[:, :0]

    def _place(self, ids: Array, initial: InitialState) -> None:
        """Build the worlds from scratch: about 1 ms each, less than one policy period of stepping.

        Setting the state of an existing scene leaves traces, even if the stick is removed and added
        again: a contact force is then 0.3 N off after 20 ms.
        """
        for n in ids:
            self._worlds[n] = world = _World(self.specs[n])
            self._locate(n, world)
            world.hand.set_qpos(initial.joint_rad[n, self._to_active])
            world.stick.entity_pose = sapien.Pose(
                initial.stick_pos_m[n], initial.stick_quat_wxyz[n]
            )

    def _period(
        self, team: Team, target_rad: Array, load_nm: Array | None, pull_n: Array | None
    ) -> None:
        rows, args = team.rows, self._args[team]
        age = self._age_steps[rows]
        if load_nm is not None or pull_n is not None or not team.plain:
            super()._period(team, target_rad, load_nm, pull_n)
            return
        args.target_rad[:] = target_rad
        angle, speed = self.state.joint_rad[rows], self.state.joint_rad_s[rows]
        (systems, hands, sticks), ticks = self._pointers[:, rows], self._timing.substeps
        carry = sticks, team.lifted_ticks(age), team.carry_n
        calls.drive(systems, hands, self._to_spec, args.address, ticks, angle, speed, *carry)
        age += ticks

    def _step(self, rows: slice, torque_nm: Array, carried: Array, force_n: Array) -> None:
        angle, speed = self.state.joint_rad[rows], self.state.joint_rad_s[rows]
        (systems, hands, sticks), place = self._pointers[:, rows], self._to_spec
        calls.rollout(systems, hands, place, torque_nm, angle, speed, sticks, carried, force_n)

    def _observe(self, rows: slice) -> None:
        state, (systems, _, sticks) = self.state, self._pointers[:, rows]
        pose = state.stick_pos_m[rows], state.stick_quat_wxyz[rows]
        calls.read_sticks(sticks, *pose, state.stick_vel_m_s[rows], state.stick_omega_rad_s[rows])
        self._pool_contacts(rows, calls.read_contacts(systems, self._tips[rows], self._drive_s))
