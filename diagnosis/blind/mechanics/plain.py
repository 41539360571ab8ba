"""A robot of MuJoCo's own joints, position actuators and frictionloss: no drive law of ours.

    (M + armature) q'' + h = clip(kp (target - q) - kd q') - damping q' - frictionloss + push

Links of any number of hinges, rigid drives. Play and a soft gear are a second hinge behind the
motor's, held by a limit or a spring. Friction that depends on speed, load or direction is the
joint's `frictionloss`, set at every step. 0.5 ms, `implicitfast`, no contacts; a friction
constraint is as hard as MuJoCo lets it be without changing the step.

E. Todorov, T. Erez, Y. Tassa, MuJoCo, IROS 2012; https://mujoco.readthedocs.io, "Computation".
"""

import mujoco
import numpy as np
from mujoco import rollout

from backends.spec import Body
from backends.state import Array
from diagnosis.blind import plant
from diagnosis.blind.mechanics import _faults
from diagnosis.blind.plant import Course, Limb

TICK_S = 5e-4
STRIBECK_RAD_S = 0.05
"""Speed at which stiction has faded to a third."""
FEELING = ("stiction", "load", "lock", "dead", "stop", "fade", "cogging", "uneven", "emf")
"""Numbers whose laws act at every step."""
_FRICTION = 'solreffriction="0.002 1" solimpfriction="0.999 0.9999 0.001"'


class Mechanics(plant.Mechanics):
    """Limbs of any number of hinges."""

    tick_s: float = TICK_S

    def __call__(self, limb: Limb, wanted_rad: Array, push_nm: Array) -> Course:
        """See the protocol."""
        world = _World(limb)
        steps = (len(wanted_rad) - 1) // (len(push_nm) - 1)
        push = np.repeat(push_nm[:-1], steps, axis=0)
        if any(np.any(limb.numbers[name]) for name in FEELING):
            motor, link, torque = world.felt(wanted_rad[:-1], push)
        else:
            motor, link, torque = world.rolled(wanted_rad[:-1], push)
        at = np.minimum(np.arange(len(push_nm)) * steps, len(torque) - 1)
        return link, motor[np.arange(len(push_nm)) * steps], torque[at]


class _World:
    """A compiled limb at rest, and where its joints stand in MuJoCo's arrays."""

    def __init__(self, limb: Limb) -> None:
        self._n = limb.numbers
        self._model = mujoco.MjModel.from_xml_string(_mjcf(limb))
        self._model.opt.gravity[:] = limb.gravity_m_s2
        names = [b.joint.name for b in limb.bodies]
        self._at = np.array([self._model.joint(name).qposadr[0] for name in names])
        behind = [f"{name}.link" for name in names]
        known = [self._model.joint(j).name for j in range(self._model.njnt)]
        self._second = np.array(
            [known.index(b) if b in known else -1 for b in behind]
        )  # only hinges: an index of joints is one of positions and speeds

    def _start(self, wanted_rad: Array) -> mujoco.MjData:
        data = mujoco.MjData(self._model)
        data.qpos[self._at] = wanted_rad[0]
        return data

    def _applied(self, torque_nm: Array) -> Array:
        """Torques on links, which turn with both hinges of a joint."""
        applied = np.zeros((*torque_nm.shape[:-1], self._model.nv))
        applied[..., self._at] = torque_nm
        two = self._second >= 0
        applied[..., self._second[two]] = torque_nm[..., two]
        return applied

    def _split(self, qpos: Array) -> tuple[Array, Array]:
        """Angles of motors and links."""
        motor = qpos[..., self._at]
        return motor, motor + np.where(self._second >= 0, qpos[..., self._second], 0.0)

    def rolled(self, wanted_rad: Array, push_nm: Array) -> tuple[Array, Array, Array]:
        """Motors and links before and after every step, and torques, with nothing to decide."""
        data = self._start(wanted_rad)
        kinds = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_QFRC_APPLIED
        whole = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.empty(mujoco.mj_stateSize(self._model, whole))
        mujoco.mj_getState(self._model, data, start, whole)
        acts = np.concatenate([wanted_rad, self._applied(push_nm)], axis=1)
        states, sensed = rollout.rollout(
            self._model, data, start[None], acts[None], control_spec=int(kinds)
        )
        qpos = np.vstack([start[1:], states[0][:, 1:]])[:, : self._model.nq]
        return *self._split(qpos), sensed[0]

    def felt(self, wanted_rad: Array, push_nm: Array) -> tuple[Array, Array, Array]:
        """The same where laws act at every step."""
        model, data, n = self._model, self._start(wanted_rad), self._n
        gain, bias = model.actuator_gainprm[:, 0].copy(), model.actuator_biasprm.copy()
        heat, load = np.zeros(len(self._at)), np.zeros(len(self._at))
        qpos, torque = np.zeros((len(push_nm) + 1, model.nq)), np.zeros(push_nm.shape)
        qpos[0] = data.qpos
        for k in range(len(push_nm)):
            q, w = data.qpos[self._at], data.qvel[self._at]
            link = q + np.where(self._second >= 0, data.qpos[self._second], 0.0)
            error = wanted_rad[k] - q
            data.ctrl[:] = q + error - np.clip(error, -n["dead"], n["dead"])
            fresh = 1 - np.minimum(n["fade"] * heat, 0.9)
            back = np.minimum(n["emf"] * np.abs(w), n["limit"])
            model.actuator_forcerange[:, 0] = back * (w < 0) - n["limit"]
            model.actuator_forcerange[:, 1] = n["limit"] - back * (w > 0)
            model.actuator_gainprm[:, 0] = gain * fresh
            model.actuator_biasprm[:, 1:3] = bias[:, 1:3] * fresh[:, None]
            data.qfrc_applied[:] = 0.0
            ends = (n[name] for name in ("stop", "lower", "upper", "kp", "kd"))
            stopped = [_faults.stopped(*own) for own in zip(link, w, *ends, strict=True)]
            data.qfrc_applied[:] = self._applied(push_nm[k] + stopped)
            data.qfrc_applied[self._at] += n["cogging"] * np.sin(_faults.TEETH * q)
            model.dof_frictionloss[self._at] = self._dry(w, load, torque[max(k - 1, 0)])
            mujoco.mj_step(model, data)
            torque[k] = data.actuator_force
            gear = torque[k] + (data.qfrc_constraint - model.dof_armature * data.qacc)[self._at]
            load = n["viscous"] * w - gear
            heat += TICK_S / _faults.HEAT_S * ((torque[k] / n["limit"]) ** 2 - heat)
            qpos[k + 1] = data.qpos
        return *self._split(qpos), torque

    def _dry(self, w: Array, load: Array, pushed: Array) -> Array:
        """Largest dry friction of every joint [Nm]; `load` acts on the motor from its link."""
        n = self._n
        dry = n["coulomb"] + n["stiction"] * np.exp(-np.abs(w) / STRIBECK_RAD_S)
        dry = dry + n["load"] * np.abs(load) + np.maximum(n["uneven"] * np.sign(w), 0.0)
        outdone = (load * pushed <= 0) & (np.abs(load) > np.abs(pushed))
        return dry + n["lock"] * (outdone & (w * load >= 0))


def _mjcf(limb: Limb) -> str:
    """The limb in MJCF, as its numbers say."""
    opened, closed, acts, sensors = "", "", "", ""
    for j, body in enumerate(limb.bodies):
        n = {name: float(values[j]) for name, values in limb.numbers.items()}
        opened += _link(body, n)
        closed += "</body></body>" if _two(body, n) else "</body>"
        name, most = body.joint.name, n["limit"]
        acts += f'<position joint="{name}" kp="{n["kp"]}" kv="{n["kd"]}" '
        acts += f'forcerange="{-most} {most}"/>'
        sensors += f'<jointactuatorfrc joint="{name}"/>'
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{TICK_S}" integrator="implicitfast">'
        f'<flag contact="disable"/></option><worldbody>{opened}{closed}</worldbody>'
        f"<actuator>{acts}</actuator><sensor>{sensors}</sensor></mujoco>"
    )


def _two(body: Body, n: dict[str, float]) -> bool:
    """Whether a joint needs a second hinge."""
    assert body.joint.drive is not None
    return n["play"] > 0 or n["stiffness"] < body.joint.drive.gear_stiffness_nm_rad * (1 - 1e-9)


def _link(body: Body, n: dict[str, float]) -> str:
    """Opens a body on its hinge, and on a second one where the gear has play or is soft."""
    joint, drive = body.joint, body.joint.drive
    assert drive is not None
    (x, y, z), (xy, xz, yz) = body.inertia_kgm2, body.products_kgm2
    axis = " ".join(map(str, joint.axis))
    place, carried = f'pos="{" ".join(map(str, body.origin_m))}"', f'gravcomp="{body.carried}"'
    mass = (
        f'<inertial mass="{body.mass_kg}" pos="{" ".join(map(str, body.com_m))}" '
        f'fullinertia="{x} {y} {z} {xy} {xz} {yz}"/>'
    )
    motor = f'<joint name="{joint.name}" axis="{axis}" armature="{n["rotor"]}" '
    motor += f'damping="{n["viscous"]}" frictionloss="{n["coulomb"]}" {_FRICTION}/>'
    if not _two(body, n):
        return f"<body {place} {carried}>{mass}{motor}"
    if n["play"] > 0:
        held = f'range="{-n["play"]} {n["play"]}" limited="true" '
        held += 'solreflimit="0.003 1" solimplimit="0.98 0.999 0.0001"'
    else:
        held = f'stiffness="{1 / (1 / n["stiffness"] - 1 / drive.gear_stiffness_nm_rad)}"'
    second = f'<joint name="{joint.name}.link" axis="{axis}" armature="{2e-3 * n["rotor"]}" '
    second += f'damping="{0.02 * n["kd"]}" {held}/>'
    empty = '<inertial mass="1e-4" pos="0 0 0" diaginertia="1e-7 1e-7 1e-7"/>'
    return f"<body {place}>{empty}{motor}<body {carried}>{mass}{second}"
