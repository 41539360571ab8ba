"""A corrected model, and beside it what an MJCF cannot hold: late, slow and offset signals.

    robot = Robot(mujoco.MjModel.from_xml_path("corrected.xml"))
    readings = robot.step({"elbow": 0.3})      # targets and readings by joint [rad, m], a time step

This file is written beside a corrected model, with its numbers.
"""

from pathlib import Path

import mujoco
import numpy as np

NUMBERS: dict[str, dict[str, float]] = {}


class Robot:
    """A model whose commands and readings pass as those of the robot do.

    `numbers` by joint: `delay_s` of commands, `slowness_s_rad` and `step` of targets, and `late_s`,
    `scale`, `bias`, `cosine` and `sine` of readings.
    """

    def __init__(
        self, model: mujoco.MjModel, numbers: dict[str, dict[str, float]] = NUMBERS
    ) -> None:
        self.model, self.data, self.numbers = model, mujoco.MjData(model), numbers
        self.signals: dict[str, Signals] = {}

    def step(self, targets: dict[str, float]) -> dict[str, float]:
        """Hold targets for one time step; what the sensors read at its start."""
        read = {}
        for name, target in targets.items():
            if name not in self.signals:
                self.signals[name] = Signals(self.model, name, self.numbers.get(name, {}))
            read[name] = self.signals[name].pass_on(target, self.data)
        mujoco.mj_step(self.model, self.data)
        return read


class Signals:
    """What one joint was asked for and has shown."""

    def __init__(self, model: mujoco.MjModel, name: str, own: dict[str, float]) -> None:
        j, dt = model.joint(name).id, model.opt.timestep
        play = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{name}_play")
        self.places = [int(model.jnt_qposadr[k]) for k in (j, play) if k >= 0]
        self.servos = [
            (int(model.actuator_ctrladr[a]), float(model.actuator_gear[a, 0]))
            for a in range(model.nu)
            if model.actuator_trnid[a, 0] == j
            and model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT
            and model.actuator_biasprm[a, 1] != 0.0
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


def robot_file(numbers: dict[str, dict[str, float]]) -> str:
    """This file with the numbers of a robot, to stand beside its model."""
    own = Path(__file__).read_text(encoding="utf-8").partition("\n\ndef robot_file")[0]
    return own.replace("float]] = {}", f"float]] = {numbers!r}").replace(PATH_LINE, "") + "\n"


PATH_LINE = "from pathlib import Path\n\n"
