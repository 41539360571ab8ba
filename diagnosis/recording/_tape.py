"""The samples of an engine, in the columns of a robot's log."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from backends.engine import Simulator
from backends.spec import Hand, Spec
from backends.state import Array, InitialState, State
from backends.touch import Skin
from diagnosis.logs._checks import MIN_SAMPLES
from diagnosis.logs._columns import PULL, STICK, name_of
from tasks.batch import DROP_M, SimulationDivergedError

SIGNALS = {
    "position": "measured_rad",
    "motor": "motor_rad",
    "torque": "drive_torque_nm",
    "velocity": "joint_rad_s",
}
"""The state field of each channel."""
NEEDS_STICK = ("touch", "contact", "stick", "pull")


class Tape:
    """The samples of N worlds: readings, and what acts from each sample on.

    If `held`, the stick is in the hand, and touch and its pose are stored too: 'touch' is the
    pressed depth [m], 'contact' is whether each taxel is active.
    """

    def __init__(self, specs: Sequence[Spec], channels: Sequence[str], held: bool) -> None:
        self._hand, self._held = specs[0].hand, held
        self.channels = tuple(c for c in channels if held or c not in NEEDS_STICK)
        feels = held and ("touch" in channels or "contact" in channels)
        self._skin = Skin(specs) if feels else None
        self._dt_s = specs[0].timing.policy_s
        self.rows: list[dict[str, Array]] = []

    def note(
        self,
        state: State,
        target_rad: Array,
        load_nm: Array | None = None,
        pull_n: Array | None = None,
    ) -> None:
        """Store the readings and the targets, loads (N, J) and pulls (N,) that act next."""
        now_s = len(self.rows) * self._dt_s
        bad = state.first_bad_signal()
        if bad is not None:
            raise SimulationDivergedError(f"{bad} is not finite at {now_s:.2f} s or before")
        row = {"command": target_rad.copy()}
        row |= {kind: getattr(state, field).copy() for kind, field in SIGNALS.items()}
        row["push"] = np.zeros_like(target_rad) if load_nm is None else load_nm.copy()
        row["pull"] = np.zeros(len(target_rad)) if pull_n is None else pull_n.copy()
        row["stick"] = np.hstack([state.stick_pos_m, state.stick_quat_wxyz])
        if self._skin is not None:
            touch = self._skin.feel(state, np.full(len(target_rad), now_s))
            row["touch"] = touch.reading_m.astype(np.float32)
            row["contact"] = touch.active.astype(np.float32)
        self.rows.append({kind: row[kind] for kind in ("stick", *self.channels)})

    @property
    def taken(self) -> dict[str, Array]:
        """All readings by channel, shape (T, N, ...), and the stick's pose."""
        return {kind: np.stack([row[kind] for row in self.rows]) for kind in self.rows[0]}

    def frames(self, ends: Sequence[int]) -> list[pd.DataFrame]:
        """The samples of every world, so many or until its stick falls."""
        taken, time_s = self.taken, np.arange(len(self.rows)) * self._dt_s
        if self._held:
            height_m = taken["stick"][..., 2]
            fallen = np.vstack([height_m < height_m[0] - DROP_M, np.ones(height_m.shape[1], bool)])
            # enough for an episode in any case
            ends = np.minimum(ends, np.maximum(fallen.argmax(axis=0), MIN_SAMPLES)).tolist()
        return [
            frame(self._hand, time_s[:end], {k: taken[k][:end, n] for k in self.channels})
            for n, end in enumerate(ends)
        ]


def frame(hand: Hand, time_s: Array, taken: Mapping[str, Array]) -> pd.DataFrame:
    """Readings of one world by channel, shape (T, ...), in the columns of a log."""
    columns: dict[str, object] = {"t_s": time_s}
    for kind, values in taken.items():
        if kind == "stick":
            columns |= dict(zip(STICK, values.T, strict=True))
        elif kind == "pull":
            columns[PULL] = values
        elif kind in ("touch", "contact"):
            for f, tip in enumerate(hand.fingertips):
                columns[f"touch.{tip.finger}"] = list(values[:, f])
        else:
            for j, body in enumerate(hand.driven):
                columns[name_of(kind, body.joint.name, body.joint.slides)] = values[:, j]
    return pd.DataFrame(columns)


class TapedSimulator:
    """A simulator for a task, on tape: every advance holds the targets for several samples."""

    def __init__(self, simulator: Simulator, tape: Tape, policy_s: float) -> None:
        timing = simulator.specs[0].timing
        self._simulator, self._tape = simulator, tape
        self._samples = round(policy_s / timing.policy_s)
        slow = dataclasses.replace(timing, policy_s=policy_s)
        self.specs = tuple(dataclasses.replace(s, timing=slow) for s in simulator.specs)

    def reset(self, initial: InitialState, mask: Array) -> State:
        """See `Simulator.reset`; all worlds start together."""
        self.state = self._simulator.reset(initial, np.ones_like(mask))
        return self.state

    def advance(
        self, target_rad: Array, load_nm: Array | None = None, pull_n: Array | None = None
    ) -> State:
        """See `Simulator.advance`."""
        for _ in range(self._samples):
            self._tape.note(self.state, target_rad, load_nm, pull_n)
            self.state = self._simulator.advance(target_rad, load_nm, pull_n)
        return self.state

    def close(self) -> None:
        """Free the engine."""
        self._simulator.close()
