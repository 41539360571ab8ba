"""What all engines share: the drive loop at 1 kHz, episode ages, and the protocol itself.

An engine file builds worlds, places them, steps them once with joint torques, and reports
primitives. Drives, the weightless start and the policy period are the same code for all, here.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Protocol

import numpy as np

from backends.command import CommandBank
from backends.drive import DriveBank
from backends.encoder import EncoderBank
from backends.spec import Spec, field_names
from backends.state import Array, InitialState, State

EXACT = "exact"
_SHARED = {"drive", "command", "encoder", "taxels", "timing", "joint", "hand"}
SHARED_SUPPORT: Mapping[str, str] = {
    name: EXACT for name in field_names() if name.split(".")[0] in _SHARED and name != "joint.axis"
}
"""Answers for the fields that shared code computes above the engines."""


class Simulator(Protocol):
    """N worlds being simulated: what tasks see of an engine."""

    specs: tuple[Spec, ...]

    def reset(self, initial: InitialState, mask: Array) -> State:
        """Start the masked worlds from `initial`; the others stay as they are."""
        ...

    def advance(self, target_rad: Array, load_nm: Array | None = None) -> State:
        """Hold the target angles (N, J) [rad] for one policy period; the state after it.

        `load_nm` (N, J) is an external torque on the joints, such as a push.
        """
        ...

    def close(self) -> None:
        """Free the engine; twice is harmless."""
        ...


class Engine(ABC):
    """Base of every backend; a subclass named `Backend` in its own file is one engine.

    `specs` are N worlds of one structure that may differ in every number: domain randomisation
    and the refitting of candidates are this one mechanism.
    """

    support: ClassVar[Mapping[str, str]]
    """Per spec field: 'exact', 'approximate: why' or 'refused: why'."""
    steps_in_threads: ClassVar[bool] = False
    """Whether the constructor takes `threads` (the engine frees the interpreter lock)."""

    def __init__(self, specs: Sequence[Spec]) -> None:
        first = specs[0]
        if len({(s.timing.drive_s, s.timing.policy_s) for s in specs}) > 1:
            raise ValueError("worlds of one batch step together: give them the same rates")
        self._refuse(specs)
        self.specs = tuple(specs)
        self._timing = first.timing
        self._commands, self._encoders = CommandBank(specs), EncoderBank(specs)
        self._drives = DriveBank(specs)
        self.state = State.allocate(
            len(specs), len(first.hand.joint_names), len(first.hand.fingertips)
        )
        gravity = np.array([s.gravity_m_s2 for s in specs])
        self._weight_n = gravity * np.array([[s.stick.mass_kg] for s in specs])
        self._age_steps = np.zeros(len(specs), dtype=np.int64)
        self._noise_seed = np.zeros(len(specs), dtype=np.int64)
        self._weightless_steps = np.array(
            [round(s.timing.weightless_s / s.timing.drive_s) for s in specs]
        )

    def reset(self, initial: InitialState, mask: Array) -> State:
        """Start the masked worlds from `initial`, at rest; the others stay as they are."""
        ids = np.flatnonzero(mask)
        self._place(ids, initial)
        self._drives.reset(initial.joint_rad, mask)
        self._age_steps[ids] = 0
        self._noise_seed[ids] = initial.noise_seed[ids]
        state = self.state
        state.joint_rad[ids] = initial.joint_rad[ids]
        state.motor_rad[ids] = initial.joint_rad[ids]
        state.stick_pos_m[ids] = initial.stick_pos_m[ids]
        state.stick_quat_wxyz[ids] = initial.stick_quat_wxyz[ids]
        for at_rest in (
            state.joint_rad_s,
            state.drive_torque_nm,
            state.stick_vel_m_s,
            state.stick_omega_rad_s,
            state.contact_point_m,
            state.contact_force_n,
        ):
            at_rest[ids] = 0.0
        self._measure()
        return state

    def advance(self, target_rad: Array, load_nm: Array | None = None) -> State:
        """See `Simulator.advance`."""
        state, drives, age = self.state, self._drives, self._age_steps
        for _ in range(self._timing.substeps):
            command = self._commands.step(target_rad, age, self._noise_seed)
            torque = drives.step(command, state.joint_rad, state.joint_rad_s)
            weightless = age < self._weightless_steps
            self._tick(
                torque if load_nm is None else torque + load_nm,
                np.where(weightless[:, None], -self._weight_n, 0.0),
            )
            age += 1
            if self._encoders.remembers:
                self._encoders.note(state.joint_rad, drives.motor_rad, age)
        state.motor_rad[:] = drives.motor_rad
        state.drive_torque_nm[:] = drives.pd_nm
        self._measure()
        self._observe()
        return state

    def _refuse(self, specs: Sequence[Spec]) -> None:
        """Raise ValueError for a number, zero by default, that this engine cannot honour."""
        for name, answer in self.support.items():
            if answer.startswith("refused") and any(np.any(s.values(name)) for s in specs):
                raise ValueError(f"{name} is {answer}")

    def _measure(self) -> None:
        """Read the position sensors."""
        angles = self.state.joint_rad, self._drives.motor_rad
        self._encoders.note(*angles, self._age_steps)
        self.state.measured_rad[:] = self._encoders.read(*angles, self._age_steps, self._noise_seed)

    @abstractmethod
    def close(self) -> None:
        """Free the engine; twice is harmless."""

    @abstractmethod
    def _place(self, ids: Array, initial: InitialState) -> None:
        """Put worlds `ids` at rest in their rows of `initial`, with no memory of the past."""

    @abstractmethod
    def _tick(self, torque_nm: Array, stick_force_n: Array) -> None:
        """Step every world once with joint torques (N, J) and a force (N, 3) at the stick's centre.

        Leaves the new joint angles and speeds in `state.joint_rad` and `state.joint_rad_s`.
        """

    @abstractmethod
    def _observe(self) -> None:
        """Write stick pose, twist and fingertip contacts of every world into `state`."""
