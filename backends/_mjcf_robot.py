"""A corrected model, and beside it what an MJCF cannot hold: late signals, warm motors, friction.

    robot = Robot(mujoco.MjModel.from_xml_path("corrected.xml"))
    readings = robot.step({"elbow": 0.3})      # targets and readings by joint [rad, m], a time step

This file is written beside a corrected model, with its numbers.
"""

from collections.abc import Mapping
from math import exp, pi, sin
from pathlib import Path

import mujoco
import numpy as np

NUMBERS: dict[str, dict[str, float]] = {}
DRIVES: dict[str, dict[str, float]] = {}


class Robot:
    """A model whose commands and readings pass as those of the robot do, with its drives.

    `numbers` by joint: `open`, 1 where its target is a torque; `delay_s` of commands,
    `slowness_s_rad` and `step` of targets, and `late_s`,
    `scale`, `bias`, `cosine` and `sine` of readings. `drives`: those of `Drive`.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        numbers: Mapping[str, dict[str, float]] = NUMBERS,
        drives: Mapping[str, dict[str, float]] = DRIVES,
    ) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        names = [model.joint(j).name for j in range(model.njnt)]
        self.signals = {name: Signals(model, name, numbers.get(name, {})) for name in names}
        self.drives = [Drive(model, name, own) for name, own in drives.items()]

    def step(
        self, targets: dict[str, float], push: dict[str, float] | None = None
    ) -> dict[str, float]:
        """Hold targets, and pushes from outside, for one step; what sensors read at its start."""
        self.data.qfrc_applied[:] = 0.0
        for name, torque in (push or {}).items():
            self.data.qfrc_applied[self.signals[name].dofs] = torque
        read = {name: self.signals[name].pass_on(x, self.data) for name, x in targets.items()}
        for drive in self.drives:
            drive.act(self.data)
        mujoco.mj_step(self.model, self.data)
        return read


class Drive:
    """What a joint's drive does beside its servo.

    `cogging_nm` over `cogging_period_rad`; `thermal_fade` of the servo's torque at the heat of
    `torque_limit_nm`; `presliding_nm` of bristles that bend by `presliding_rad`; dry friction:
    `stiction_nm`, `load_friction` of the torque on the gear, `one_way_friction_nm`.
    """

    def __init__(self, model: mujoco.MjModel, name: str, own: dict[str, float]) -> None:
        self.model, self.own = model, own
        joint = model.joint(name)
        self.at, self.dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        self.armature = float(model.dof_armature[self.dof])
        self.friction = float(model.dof_frictionloss[self.dof])
        self.heat = self.bend = self.torque = 0.0
        if not own["creeps"]:  # friction that holds, where MuJoCo's creeps
            model.dof_solref[self.dof] = 2.0 * model.opt.timestep, 1.0
            model.dof_solimp[self.dof, :2] = 0.999, 0.9999

    def act(self, data: mujoco.MjData) -> None:
        """Set its torque and its dry friction for the next step."""
        own, dt, dof = self.own, self.model.opt.timestep, self.dof
        speed, servo = float(data.qvel[dof]), float(data.qfrc_actuator[dof])
        held = float(data.qfrc_damper[dof]) + float(data.qfrc_constraint[dof])
        gear = abs(servo + self.torque + held - self.armature * float(data.qacc[dof]))
        way = own["one_way_friction_nm"] / 2.0  # half of it is a torque, half friction both ways
        rub = own["stiction_nm"] * exp(-abs(speed) / own["stribeck_rad_s"])
        loss = self.friction + rub + own["load_friction"] * gear + abs(way)
        self.model.dof_frictionloss[dof] = loss
        turn = 2.0 * pi * float(data.qpos[self.at]) / own["cogging_period_rad"]
        load = servo / own["torque_limit_nm"]
        self.heat += dt / own["thermal_s"] * (load**2 - self.heat)
        slid = dt * speed / own["presliding_rad"]
        self.bend = (self.bend + slid) / (1.0 + abs(slid))
        self.torque = own["cogging_nm"] * sin(turn + own["cogging_phase_rad"]) - way
        self.torque -= min(own["thermal_fade"] * self.heat, 0.9) * servo
        self.torque -= own["presliding_nm"] * self.bend
        data.qfrc_applied[dof] += self.torque


class Signals:
    """What one joint was asked for and has shown."""

    def __init__(self, model: mujoco.MjModel, name: str, own: dict[str, float]) -> None:
        j, dt = model.joint(name).id, model.opt.timestep
        play = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{name}_play")
        both = [k for k in (j, play) if k >= 0]
        self.places = [int(model.jnt_qposadr[k]) for k in both]
        self.dofs = [int(model.jnt_dofadr[k]) for k in both]
        self.servos = [
            (int(model.actuator_ctrladr[a]), float(model.actuator_gear[a, 0]))
            for a in range(model.nu)
            if model.actuator_trnid[a, 0] == j
            and model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT
            and (model.actuator_biasprm[a, 1] != 0.0 or own.get("open"))
        ]
        self.late, self.read_late = own.get("delay_s", 0.0) / dt, own.get("late_s", 0.0) / dt
        slowness = own.get("slowness_s_rad", 0.0)
        self.most = dt / slowness if slowness else np.inf
        self.step = own.get("step", 0.0)
        self.scale, self.bias = 1.0 + own.get("scale", 0.0), own.get("bias", 0.0)
        self.cosine, self.sine = own.get("cosine", 0.0), own.get("sine", 0.0)
        self.sent: list[float] = []
        self.seen: list[float] = []
        self.target: float | None = None

    def pass_on(self, target: float, data: mujoco.MjData) -> float:
        """Give a target to the servos, as late and slow as it is; the reading."""
        self.sent.append(self.step * round(target / self.step) if self.step else target)
        wanted = late(self.sent, self.late)
        last = wanted if self.target is None else self.target
        self.target = last + min(max(wanted - last, -self.most), self.most)
        for place, gear in self.servos:
            data.ctrl[place] = gear * self.target
        self.seen.append(sum(float(data.qpos[place]) for place in self.places))
        return float(self.shown(np.asarray(late(self.seen, self.read_late))))

    def shown(self, angle: np.ndarray) -> np.ndarray:
        """What the sensor reads of an angle."""
        once = self.cosine * np.cos(angle) + self.sine * np.sin(angle)
        return np.asarray(self.scale * angle + self.bias + once)


def late(values: list[float], ticks: float) -> float:
    """The value so many steps ago, between steps linearly; the first one before it."""
    whole = int(ticks)
    now, before = (values[max(len(values) - 1 - whole - k, 0)] for k in (0, 1))
    return now + (ticks - whole) * (before - now)


def robot_file(numbers: dict[str, dict[str, float]], drives: dict[str, dict[str, float]]) -> str:
    """This file with the numbers of a robot, to stand beside its model."""
    own = Path(__file__).read_text(encoding="utf-8").partition("\n\ndef robot_file")[0]
    for name, value in (("NUMBERS", numbers), ("DRIVES", drives)):
        empty = f"{name}: dict[str, dict[str, float]] = "
        plain = {one: {k: float(v) for k, v in of.items()} for one, of in value.items()}
        own = own.replace(f"{empty}{{}}", f"{empty}{plain!r}")
    return own.replace(PATH_LINE, "") + "\n"


PATH_LINE = "from pathlib import Path\n"
