"""SAPIEN: one PhysX CPU scene per world, without renderer; 32-bit floats inside."""

import warnings
from collections.abc import Sequence

import numpy as np

from backends.engine import EXACT, SHARED_SUPPORT, Engine
from backends.spec import Body, Fingertip, Spec, Vec3, field_names
from backends.state import Array, InitialState

with warnings.catch_warnings():
    warnings.filterwarnings("ignore", message="Failed to find system libvulkan")
    import sapien
    from sapien import physx

POSITION_ITERATIONS, VELOCITY_ITERATIONS = 16, 1
CONTACT_OFFSET_M = 1e-3
NO_LIMIT = 1e6
_FINGER_BIT, _STICK_BIT = 1, 2
_SINGLE = "approximate: 32-bit floats, relative error 6e-8"


def _turn_x(axis: Vec3) -> Array:
    """Shortest rotation, w x y z, that turns x into the unit vector `axis`."""
    if axis[0] < -0.999999:
        return np.array([0.0, 0.0, 0.0, 1.0])
    quat = np.array([1 + axis[0], 0.0, -axis[2], axis[1]])
    return quat / np.linalg.norm(quat)


def _make_rigid(body, mass_kg: float, com_m: Vec3, inertia_kgm2: Vec3) -> None:
    """Set the inertia and take off PhysX's damping and speed limits."""
    body.mass = mass_kg
    body.cmass_local_pose = sapien.Pose(com_m)
    body.inertia = inertia_kgm2
    body.linear_damping = body.angular_damping = 0.0
    body.max_linear_velocity = body.max_angular_velocity = NO_LIMIT


class _World:
    """One scene, built from scratch: its step, hand and stick."""

    def __init__(self, spec: Spec) -> None:
        physx.set_scene_config(gravity=spec.gravity_m_s2, **SCENE)
        physx.set_body_config(POSITION_ITERATIONS, VELOCITY_ITERATIONS, sleep_threshold=0.0)
        self.system = physx.PhysxCpuSystem()
        self.system.timestep = spec.timing.drive_s
        self._scene = sapien.Scene([self.system])
        mu = spec.stick.friction
        self._material = physx.PhysxMaterial(mu, mu, 0.0)
        self._torsion_radius_m = spec.contact.torsion_radius_m
        self.tips: dict = {}
        """Index of the fingertip by its collision shape."""
        self._add_hand(spec)
        self._add_stick(spec)

    def _add(self, component) -> None:
        entity = sapien.Entity()
        entity.add_component(component)
        self._scene.add_entity(entity)

    def _add_hand(self, spec: Spec) -> None:
        palm = physx.PhysxArticulationLinkComponent(None)
        self.links = {None: palm}
        for body in spec.hand.bodies:
            link = physx.PhysxArticulationLinkComponent(self.links[body.parent])
            for tip in spec.hand.fingertips:
                if tip.body == body.name:
                    self._attach_tip(link, tip)
            _make_rigid(link, body.mass_kg, body.com_m, body.inertia_kgm2)
            _make_joint(link.joint, body)
            self.links[body.name] = link
        palm.joint.type = "fixed"
        for link in self.links.values():
            self._add(link)
        self.hand = palm.articulation

    def _attach_tip(self, link, tip: Fingertip) -> None:
        half = tip.length_m / 2
        shape = physx.PhysxCollisionShapeCapsule(tip.radius_m, half, self._material)
        center = np.array(tip.center_m) - half * np.array(tip.forward)
        shape.local_pose = sapien.Pose(center, _turn_x(tip.forward))
        self._set_surface(shape, _FINGER_BIT, _STICK_BIT)
        link.attach(shape)
        self.tips[shape] = len(self.tips)

    def _add_stick(self, spec: Spec) -> None:
        stick = spec.stick
        half, r = stick.length_m / 2, stick.radius_m
        if stick.shape == "capsule":
            shape = physx.PhysxCollisionShapeCapsule(r, half - r, self._material)
            shape.local_pose = sapien.Pose(q=_turn_x((0.0, 0.0, 1.0)))
        else:
            shape = physx.PhysxCollisionShapeBox([r, r, half], self._material)
        self._set_surface(shape, _STICK_BIT, _FINGER_BIT)
        self.stick = physx.PhysxRigidDynamicComponent()
        self.stick.attach(shape)
        _make_rigid(self.stick, stick.mass_kg, (0.0, 0.0, 0.0), stick.inertia_kgm2)
        self._add(self.stick)

    def _set_surface(self, shape, own_bit: int, other_bit: int) -> None:
        """Contact parameters, the same on both sides: PhysX averages the frictions."""
        shape.set_collision_groups([own_bit, other_bit, 0, 0])
        shape.contact_offset = CONTACT_OFFSET_M
        shape.rest_offset = 0.0
        shape.patch_radius = 0.0
        shape.min_patch_radius = self._torsion_radius_m


def _make_joint(joint, body: Body) -> None:
    """Hinge about x of its frames, without friction, drive or limits; without drive, fixed."""
    turn = _turn_x(body.joint.axis)
    joint.name = body.joint.name
    joint.type = "fixed" if body.joint.drive is None else "revolute"
    joint.pose_in_parent = sapien.Pose(body.origin_m, turn)
    joint.pose_in_child = sapien.Pose(q=turn)
    if body.joint.drive is not None:
        joint.limit = [[-np.inf, np.inf]]
        joint.friction = 0.0
        joint.armature = [0.0]
        joint.max_velocity = NO_LIMIT
        joint.set_drive_properties(0.0, 0.0)

SCENE = dict(enable_tgs=True, enable_pcm=True, enable_friction_every_iteration=True)
REBUILD = True

class Backend(Engine):
    """N SAPIEN scenes, stepped one after the other."""

    support = {
        **SHARED_SUPPORT,
        **{name: _SINGLE for name in field_names() if name.split(".")[0] in {"body", "fingertip"}},
    }

    def __init__(self, specs: Sequence[Spec]) -> None:
        super().__init__(specs)
        self._worlds = [_World(spec) for spec in specs]
        names = [joint.name for joint in self._worlds[0].hand.active_joints]
        self._to_active = np.array([specs[0].hand.joint_names.index(n) for n in names])
        self._bind()

    def _bind(self):
        self._hot = [
            (w.hand.set_qf, w.stick.add_force_torque, w.system.step, w.hand.get_qpos, w.hand.get_qvel)
            for w in self._worlds
        ]

    def _place(self, ids: Array, initial: InitialState) -> None:
        for n in ids:
            if REBUILD:
                self._worlds[n] = _World(self.specs[n])
            world = self._worlds[n]
            world.hand.set_qpos(initial.joint_rad[n, self._to_active])
            if not REBUILD:
                world.hand.set_qvel(np.zeros(len(self._to_active)))
                world.hand.set_qf(np.zeros(len(self._to_active)))
                if READD:
                    entity = world.stick.entity
                    world._scene.remove_entity(entity)
                    world._scene.add_entity(entity)
                world.stick.set_linear_velocity([0,0,0])
                world.stick.set_angular_velocity([0,0,0])
            world.stick.entity_pose = sapien.Pose(initial.stick_pos_m[n], initial.stick_quat_wxyz[n])
        self._bind()

    def _tick(self, torque_nm: Array, stick_force_n: Array) -> None:
        q, qd = self.state.joint_rad, self.state.joint_rad_s
        torque = torque_nm[:, self._to_active]
        pushed = stick_force_n.any(axis=1)
        for n, (set_qf, push, step, get_qpos, get_qvel) in enumerate(self._hot):
            set_qf(torque[n])
            if pushed[n]:
                push(stick_force_n[n], (0, 0, 0))
            step()
            q[n, self._to_active] = get_qpos()
            qd[n, self._to_active] = get_qvel()

    def _observe(self) -> None:
        state = self.state
        state.contact_point_m[:] = 0.0
        state.contact_force_n[:] = 0.0
        for n, world in enumerate(self._worlds):
            pose = world.stick.entity_pose
            state.stick_pos_m[n] = pose.p
            state.stick_quat_wxyz[n] = pose.q
            state.stick_vel_m_s[n] = world.stick.linear_velocity
            state.stick_omega_rad_s[n] = world.stick.angular_velocity
            self._observe_contacts(n, world)

    def _observe_contacts(self, n: int, world: _World) -> None:
        """Sum the normal impulses of the last step per fingertip."""
        state = self.state
        weight = np.zeros(len(world.tips))
        for contact in world.system.get_contacts():
            first = contact.shapes[0] in world.tips
            tip = world.tips[contact.shapes[0 if first else 1]]
            for point in contact.points:
                force = point.impulse / self._timing.drive_s
                size = np.linalg.norm(force)
                if size == 0: continue
                state.contact_force_n[n, tip] += force if first else -force
                state.contact_point_m[n, tip] += size * point.position
                weight[tip] += size
        state.contact_point_m[n] /= np.maximum(weight, 1e-12)[:, None]
