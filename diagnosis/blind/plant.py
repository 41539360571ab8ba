"""A real mechanism of other equations than every engine's and the solver's, and its effects.

It shares no code with them: the equations stand in `_plant_equations`, and what an effect means is
said here once more. On top of the ideal mechanism there is always a little more play, friction,
cogging and stiffening (`Baseline`): that much every real drive has, and the truth of a case is what
dominates it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.spec import Body, Spec
from backends.state import Array
from diagnosis.blind._plant_equations import TICK_S, run

_DRIVE = (
    *("kp", "kd", "limit", "rotor", "coulomb", "viscous", "stiffness", "damping", "play"),
    *("lock", "stiction", "load", "dead", "delay", "slowness", "cogging", "friction"),
)
_OTHER = ("mass", "loss", "bias", "scale", "resolution", "noise", "late")
NUMBERS = (*_DRIVE, *_OTHER)
CHANGES = {
    "backlash": ("play", "add"),
    "self-lock": ("lock", "add"),
    "coulomb-friction": ("coulomb", "add"),
    "stiction": ("stiction", "add"),
    "viscous-friction": ("viscous", "add"),
    "load-friction": ("load", "add"),
    "series-elasticity": ("stiffness", "divide"),
    "rotor-inertia": ("rotor", "add"),
    "link-mass": ("mass", "scale"),
    "kp-scale": ("kp", "scale"),
    "kd-scale": ("kd", "scale"),
    "gear-damping": ("damping", "scale"),
    "torque-limit": ("limit", "scale"),
    "command-delay": ("delay", "add"),
    "command-rate-limit": ("slowness", "add"),
    "command-dropout": ("loss", "add"),
    "dead-zone": ("dead", "add"),
    "encoder-bias": ("bias", "add"),
    "encoder-scale": ("scale", "add"),
    "encoder-resolution": ("resolution", "add"),
    "encoder-noise": ("noise", "add"),
    "sensor-delay": ("late", "add"),
}
"""What an effect does to which of NUMBERS; a tilt of gravity is apart."""
WORMS = ("backlash", "self-lock")
"""Effects that concern worm gears alone, unless a joint is named."""


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """What is always there, on every joint."""

    play_rad: float = 3e-4
    """Half play."""
    corner_rad: float = 1e-4
    """Width of the play's corners."""
    friction_share: float = 1.5e-3
    """Dry friction over the torque limit."""
    cogging_share: float = 1.5e-3
    """Amplitude of the cogging torque over the torque limit."""
    cogging_per_rad: float = 57.0
    """Its angular frequency: nine slots through a gear of some 40."""
    stiffening_rad2: float = 10.0
    """Relative growth of the teeth's stiffness per squared deflection [1/rad^2]."""


class Plant:
    """One real mechanism: the numbers of a rig, which effects change."""

    def __init__(self, spec: Spec, baseline: Baseline | None = None) -> None:
        self._baseline = baseline or Baseline()
        self._driven = spec.hand.driven
        self._limbs = _limbs(spec)
        self._gravity = np.array(spec.gravity_m_s2)
        self.numbers = {name: np.zeros(len(self._driven)) for name in NUMBERS}
        for j, body in enumerate(self._driven):
            drive = body.joint.drive
            assert drive is not None
            known = {
                "kp": drive.kp_nm_rad,
                "kd": drive.kd_nms_rad,
                "limit": drive.torque_limit_nm,
                "rotor": drive.rotor_inertia_kgm2,
                "coulomb": drive.coulomb_nm,
                "viscous": drive.viscous_nms_rad,
                "stiffness": drive.gear_stiffness_nm_rad,
                "damping": drive.gear_damping_nms_rad,
                "play": drive.play_rad + self._baseline.play_rad,
                "cogging": self._baseline.cogging_share * drive.torque_limit_nm,
                "friction": self._baseline.friction_share * drive.torque_limit_nm,
                "mass": body.mass_kg,
                "noise": body.joint.encoder.noise_rad,
            }
            for name, value in known.items():
                self.numbers[name][j] = value

    def add(self, effect: str, magnitude: float, joint: str | None) -> None:
        """Add an effect by name: its magnitude in SI units, on one joint or on all it concerns."""
        if effect == "gravity-tilt":
            size, (c, s) = self._gravity[2], (np.cos(magnitude), np.sin(magnitude))
            self._gravity = np.array([-s * size, 0.0, c * size])
            return
        number, how = CHANGES[effect]
        for j, body in enumerate(self._driven):
            wanted = body.joint.gear == "worm" if effect in WORMS else True
            if joint == body.joint.name or (joint is None and wanted):
                value = self.numbers[number][j]
                self.numbers[number][j] = {
                    "add": value + magnitude,
                    "scale": value * (1 + magnitude),
                    "divide": value / (1 + magnitude),
                }[how]

    def run(
        self, target_rad: Array, push_nm: Array, sample_s: float, rng: np.random.Generator
    ) -> dict[str, Array]:
        """What is read in one episode of T samples from rest: position, motor, torque, (T, J)."""
        commanded = self._kept(target_rad, rng)
        steps = round(sample_s / TICK_S)
        shape = target_rad.shape
        angle = np.zeros(((shape[0] - 1) * steps + 1, shape[1]))
        motor, torque = np.zeros(shape), np.zeros(shape)
        table = np.array([self.numbers[name] for name in _DRIVE]).T
        for columns in self._limbs:
            links, pull = self._geometry(columns)
            angle[:, columns], motor[:, columns], torque[:, columns] = run(
                np.ascontiguousarray(commanded[:, columns]),
                np.ascontiguousarray(push_nm[:, columns]),
                np.ascontiguousarray(table[columns]),
                links,
                pull,
                np.array(list(vars(self._baseline).values())),
                sample_s,
                steps,
            )
        position = self._read(angle, sample_s * np.arange(shape[0]), rng)
        return {"position": position, "motor": motor, "torque": torque}

    def _kept(self, target_rad: Array, rng: np.random.Generator) -> Array:
        """Targets with packets lost: all joints share one packet per sample."""
        kept, draws = target_rad.copy(), rng.uniform(size=len(target_rad))
        for k in range(1, len(kept)):
            lost = draws[k] < self.numbers["loss"]
            kept[k, lost] = kept[k - 1, lost]
        return kept

    def _read(self, angle: Array, times_s: Array, rng: np.random.Generator) -> Array:
        """Readings of the position sensors at the samples from the angles at every tick."""
        ticks_s = TICK_S * np.arange(len(angle))
        numbers = self.numbers
        columns = []
        for j in range(angle.shape[1]):
            then = np.interp(times_s - numbers["late"][j], ticks_s, angle[:, j])
            read = then + numbers["scale"][j] * then + numbers["bias"][j]
            read += numbers["noise"][j] * rng.normal(size=len(read))
            step = numbers["resolution"][j]
            columns.append(np.floor(read / step + 0.5) * step if step > 0 else read)
        return np.stack(columns, axis=1)

    def _geometry(self, columns: list[int]) -> tuple[Array, Array]:
        """Links (2, 6) of a limb in its plane (mass, centre, length, inertia), and gravity (2,)."""
        axis = np.array(self._driven[columns[0]].joint.axis)
        u = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.5 else np.array([0.0, 1.0, 0.0])
        u = u - (u @ axis) * axis
        plane = np.stack([u / np.linalg.norm(u), np.cross(axis, u / np.linalg.norm(u))])
        links = np.zeros((2, 6))
        for i, j in enumerate(columns):
            body = self._driven[j]
            inertia = float(axis**2 @ np.array(body.inertia_kgm2))
            links[i, 0], links[i, 5] = self.numbers["mass"][j], inertia
            links[i, 1:3] = plane @ np.array(body.com_m)
            if i > 0:
                links[0, 3:5] = plane @ np.array(body.origin_m)
        return links, plane @ self._gravity


def _limbs(spec: Spec) -> list[list[int]]:
    """Columns of the joints of each limb; ValueError for what is no plane chain of one or two."""
    driven: Sequence[Body] = spec.hand.driven
    at = {body.name: j for j, body in enumerate(driven)}
    limbs: list[list[int]] = []
    for j, body in enumerate(driven):
        if body.parent in at:
            limb = next(m for m in limbs if m[-1] == at[body.parent])
            first = driven[limb[0]].joint
            if len(limb) == 2 or body.joint.axis != first.axis:
                raise ValueError("the plant knows limbs of one or two parallel hinges only")
            limb.append(j)
        else:
            limbs.append([j])
    return limbs
