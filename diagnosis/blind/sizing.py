"""The size of a drawn robot's faults: a multiple of its gap while it is healthy.

What a log *leaves* is the root mean square over all samples of its positions less those of the
file's model, once tolerances have taken what they can: nominal numbers within three of their
standard deviations, a little delay, twist and dry friction. Even a healthy robot leaves something,
its *residual*, for its drive law is another. A fault is drawn by what it leaves over the residual,
noise and floor of its log.

The model is plain MuJoCo, expanded about the robot's true nominal numbers; what tolerances take is
a bounded linear problem. So the maker needs nothing of a solver to know what is there to be seen.

A robot that leaves more than `MOST_FLOORS` is another robot than its file: another one is drawn. A
fault that cannot leave what is wanted is as large as it may be, and if that is too little, another
one is drawn.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from scipy.optimize import lsq_linear

from backends.catalogue import catalogue
from backends.effect import Effect
from backends.spec import Body
from backends.state import Array
from diagnosis.blind import arms, rigs, sides
from diagnosis.blind import faults as drawn
from diagnosis.blind.draw import Case
from diagnosis.blind.faults import Fault
from diagnosis.blind.make import Simulate, case_rng, motions, readings
from diagnosis.blind.mechanics import plain
from diagnosis.blind.plant import MAGNET_SLIP, Plant

FLOOR_RAD = 2.5e-4
"""What positions of a log can tell at best: one floor (`floor_position_rad` of the diagnosis)."""
MOST_FLOORS = 5.0
"""Largest gap of a healthy robot."""
TRIES = 40
"""Largest number of robots, or faults, that are drawn."""
SPAN, HALVINGS, CLOSE = 100.0, 8, 0.08
"""Least magnitude, under the largest; trials at most; what is close enough, as a logarithm."""
STDS = 3.0
"""Tolerances end at this many standard deviations."""


class Robot:
    """A drawn robot in the motions of its case: its gaps with and without faults."""

    def __init__(self, case: Case, simulate: Simulate, seed: int) -> None:
        self._case, self._simulate = case, simulate
        spec = rigs.nominal(case.rig)
        self.spec = arms.with_noise(spec, 0.0)
        self._moved = motions(case, self.spec, self.spec, case_rng(case, seed))
        noise = max(b.joint.encoder.noise_rad for b in spec.hand.driven)
        self._readable_rad = float(np.hypot(noise, FLOOR_RAD))

    @cached_property
    def residual_rad(self) -> float:
        """Its gap while it is healthy."""
        return self.left_rad(())

    @property
    def scale_rad(self) -> float:
        """The scale of its faults: residual, noise and floor together."""
        return float(np.hypot(self.residual_rad, self._readable_rad))

    def left_rad(self, faults: Sequence[Fault]) -> float:
        """Its gap with faults, root mean square over samples and joints."""
        case = dataclasses.replace(
            self._case, faults=tuple(faults), nominal=drawn.of_robot(self._case.rig, faults)
        )
        rng = np.random.default_rng(0)
        read = readings(case, self.spec, self._moved, self._simulate, rng)
        gap = np.concatenate([one["position"] for one in read]) - self._model[0]
        return self._untaken(gap.ravel())

    @cached_property
    def _model(self) -> tuple[Array, Array]:
        return self._replay(())

    def _replay(self, more: Sequence[Fault]) -> tuple[Array, Array]:
        """Positions and torques of the file's model with this robot's nominal numbers and more."""
        plant = Plant(self.spec, plain.Mechanics())
        for fault in (*drawn.of_robot(self._case.rig, ()), *more):
            plant.add(fault.effect, fault.magnitude, fault.joint)
        rng, sample_s = np.random.default_rng(0), 1 / rigs.rate_hz(self._case.rig)
        read = [plant.run(m.target_rad, m.push_nm, sample_s, rng) for m in self._moved]
        position, torque = (np.concatenate([r[k] for r in read]) for k in ("position", "torque"))
        return position, torque

    @cached_property
    def _tolerances(self) -> tuple[Array, Array, Array, Array]:
        """Q and R of the positions per standard deviation, and how far each tolerance reaches."""
        still, torque = self._model
        errors = {(f.effect, f.joint): f.magnitude for f in drawn.of_robot(self._case.rig, ())}
        columns, taken, least = [], [], []
        for j, body in enumerate(self.spec.hand.driven):
            for name, kind in catalogue().items():
                std = _tolerance(kind, body)
                moved = np.zeros_like(still)
                if kind.coordinate == "compliance":
                    moved[:, j] = -std * torque[:, j]
                elif std > 0.0:
                    off = Fault(effect=name, joint=body.joint.name, magnitude=std)
                    moved = self._replay([off])[0] - still
                if moved.any():
                    columns.append(moved.ravel())
                    taken.append(errors.get((name, body.joint.name), 0.0) / std)
                    least.append(-STDS if kind.nominal and kind.coordinate != "compliance" else 0.0)
        q, r = np.linalg.qr(np.stack(columns, axis=1))
        return q, r, np.array(least) - taken, STDS - np.array(taken)

    def _untaken(self, gap: Array) -> float:
        q, r, low, high = self._tolerances
        seen = q.T @ gap
        found = lsq_linear(r, seen, (np.minimum(low, -1e-9), np.maximum(high, 1e-9)))
        rest = gap @ gap - seen @ seen + 2 * found.cost
        return float(np.sqrt(max(rest, 0.0) / len(gap)))


def sized(
    case: Case, times: tuple[float, float], effects: Sequence[str], simulate: Simulate, seed: int
) -> Case:
    """The case of a drawn robot with the magnitudes of its faults, and its gaps.

    `times` are the ends between which faults leave more than the robot does, `effects` those that
    may stand in for what cannot. Raises ValueError if no robot or no fault is found.
    """
    rng = np.random.default_rng([seed, 5, case.number])
    case, robot = _ordinary(case, simulate, seed)
    chosen: list[Fault] = []
    found: list[float] = []
    for first in case.faults:
        wanted = float(np.exp(rng.uniform(*np.log(times))))
        for fault in _candidates(case, first, chosen, effects, rng):
            magnitude, moved = _solved(robot, fault, wanted * robot.scale_rad)
            over = moved / robot.scale_rad
            if times[0] * np.exp(-CLOSE) <= over <= times[1] * np.exp(CLOSE):
                chosen.append(dataclasses.replace(fault, magnitude=magnitude))
                found.append(over)
                break
        else:
            raise ValueError(f"no fault of {TRIES} shows on {case.rig} as {case.real}")
    return dataclasses.replace(
        case,
        faults=tuple(chosen),
        nominal=drawn.of_robot(case.rig, chosen),
        excluded=_excluded(case, chosen),
        times=tuple(found),
        residual_floors=robot.residual_rad / FLOOR_RAD,
        left_floors=robot.left_rad(chosen) / FLOOR_RAD,
    )


def _ordinary(case: Case, simulate: Simulate, seed: int) -> tuple[Case, Robot]:
    """The case with the first robot that leaves what healthy ones do, itself or another one."""
    for _ in range(TRIES):
        robot = Robot(case, simulate, seed)
        if robot.residual_rad <= MOST_FLOORS * FLOOR_RAD:
            return case, robot
        anew = np.random.default_rng([rigs.robot(case.rig) or 0, 4])
        case = dataclasses.replace(case, rig=rigs.individual(rigs.family(case.rig), anew))
    raise ValueError(f"{TRIES} robots of {case.real} leave more than {MOST_FLOORS:g} floors each")


def _candidates(
    case: Case,
    first: Fault,
    chosen: Sequence[Fault],
    effects: Sequence[str],
    rng: np.random.Generator,
) -> Iterator[Fault]:
    """The fault that was dealt, then the same or others elsewhere; magnitudes are the largest."""
    spec, taken = rigs.nominal(case.rig), [f.effect for f in chosen]
    known = [name for name in effects if sides.has(case.real, name)]
    names = known if first.effect in catalogue() else [MAGNET_SLIP]
    for turn in range(TRIES):
        name, joint = first.effect, first.joint
        if turn > 0:
            name = first.effect if turn % 2 else names[rng.integers(len(names))]
            joint = drawn.arm_joint(name, spec, rng)
        if name not in taken and not any(_are_kin(name, other) for other in taken):
            most = drawn.largest(name, joint, spec, rng)
            yield Fault(effect=name, joint=joint, magnitude=most)


def _are_kin(one: str, other: str) -> bool:
    """Whether two faults are one cause and its shape."""
    kinds = catalogue()
    families = {kinds[name].family for name in (one, other) if name in kinds}
    return len(families) == 1 and None not in families and {one, other} <= set(kinds)


def _solved(robot: Robot, most: Fault, wanted_rad: float) -> tuple[float, float]:
    """The magnitude that leaves what is wanted, or the largest, and what it leaves [rad]."""

    def left(scale: float) -> float:
        size = most.magnitude * scale
        return robot.left_rad([dataclasses.replace(most, magnitude=size)])

    scale, reached = 1.0, left(1.0)
    if reached <= wanted_rad:
        return most.magnitude, reached
    low, high = -np.log(SPAN), 0.0
    for _ in range(HALVINGS):
        scale = float(np.exp((low + high) / 2))
        reached = left(scale)
        off = np.log(reached / wanted_rad)
        if abs(off) < CLOSE:
            break
        low, high = (low, np.log(scale)) if off > 0 else (np.log(scale), high)
    return most.magnitude * scale, reached


def _excluded(case: Case, faults: Sequence[Fault]) -> tuple[str, ...]:
    """What the solver's catalogue lacks: in `unknown` the fault that it was drawn to be."""
    if not case.excluded or case.mode != "unknown":
        return tuple(e for e in case.excluded if e not in [f.effect for f in faults])
    return (faults[0].effect,)


def _tolerance(kind: type[Effect], body: Body) -> float:
    """By how much any arm may be off on a joint, one standard deviation; 0: by no smooth amount."""
    drive = body.joint.drive
    assert drive is not None
    if kind.coordinate == "compliance":
        return kind.tolerance / drive.kp_nm_rad
    if drawn.is_of_gear(kind):
        return 0.0
    if kind.coordinate == "logarithm":
        whole = 1.0 if kind.dimension == "share" else drawn.number_of(kind, body)
        return drawn.NOMINAL_STD * whole * kind.nominal
    return 0.0 if kind.kinked else kind.tolerance * kind.natural(drive)
