"""Many MuJoCo worlds at once: by `mujoco.batch` where there is one, else one after the other.

MuJoCo has batches since 4.0 and contact sensors since 3.3.5. `Worlds` gives the same numbers to the
bit by what every version since 3.3 has, more slowly, so that versions can be compared.
"""

import operator
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np

from backends.state import Array

HAS_BATCH = int(mujoco.__version__.split(".")[0]) >= 4
"""Whether this version steps many worlds by itself."""
HAS_SENSOR = hasattr(mujoco, "mjtConDataField")
"""Whether this version has contact sensors."""
SLOT = 10
"""Numbers per contact: found 1, force 3 (contact frame, normal first), point 3, normal 3."""
WHOLE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""All that a step starts from."""


@dataclass(frozen=True, kw_only=True)
class Touching:
    """What contact sensors would read, for versions that have none."""

    tips: tuple[str, ...]
    """Geoms."""
    stick: str
    slots: int
    """Contacts per tip."""

    @property
    def size(self) -> int:
        """Count of the numbers."""
        return len(self.tips) * self.slots * SLOT

    def read(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Write the readings (size,)."""
        tips, stick = [model.geom(name).id for name in self.tips], model.geom(self.stick).id
        slots, used, force = out.reshape(len(tips), self.slots, SLOT), [0] * len(tips), np.zeros(6)
        slots[:] = 0.0
        for k, contact in enumerate(data.contact):
            first, second = (int(geom) for geom in contact.geom)
            f = tips.index(first + second - stick)
            if used[f] < self.slots:
                mujoco.mj_contactForce(model, data, k, force)
                normal = contact.frame[:3] if second == stick else -contact.frame[:3]
                slots[f, used[f]] = [1.0, *force[:3], *contact.pos, *normal]
                used[f] += 1


def pool(
    models: Sequence[mujoco.MjModel], rows: Sequence[int], threads: int, touching: Touching
) -> Any:
    """N worlds, world n with the model of number rows[n]."""
    if not HAS_BATCH:
        return Worlds(models, rows, threads, None if HAS_SENSOR else touching)
    from mujoco.batch import MODEL_FIELDS, Batch

    batch = Batch(models[0], nsim=len(rows), nthread=threads)
    for name, values in differences(models, MODEL_FIELDS).items():
        batch.expand(name)[:] = values[rows]
    return batch


def differences(models: Sequence[mujoco.MjModel], names: Sequence[str]) -> dict[str, Array]:
    """The fields in which compiled models differ, by name, with a row per model.

    They take 1 kB per model. Full models would not fit into the cache and would slow every step.
    """
    fields = {}
    for name in names:
        field = operator.attrgetter(name)
        if np.size(first := field(models[0])) > 0:
            values = [np.asarray(field(model)) for model in models]
            if any(not np.array_equal(first, value) for value in values):
                fields[name] = np.array(values)
    return fields


class Worlds:
    """Worlds of their own, with what the backend uses of `mujoco.batch.Batch`."""

    def __init__(
        self,
        models: Sequence[mujoco.MjModel],
        rows: Sequence[int],
        threads: int,
        touching: Touching | None,
    ) -> None:
        self._models = [models[row] for row in rows]
        self._data = [mujoco.MjData(model) for model in self._models]
        self._threads, self._touching = ThreadPoolExecutor(threads), touching
        self.state = np.zeros((len(rows), self._size(WHOLE)))
        """The states of all worlds: written before a step and read after it."""
        sensors = models[0].nsensordata if touching is None else touching.size
        self._sensors = np.zeros((len(rows), sensors))
        for model, data, state in zip(self._models, self._data, self.state, strict=True):
            mujoco.mj_getState(model, data, state, WHOLE)

    def _size(self, parts: int) -> int:
        return int(mujoco.mj_stateSize(self._models[0], parts))

    def bind(self, name: str) -> Array:
        """A part of the states, or `sensordata`, of all worlds, (N, size)."""
        if name == "sensordata":
            return self._sensors
        part = int(getattr(mujoco.mjtState, f"mjSTATE_{name.upper()}"))
        start = self._size(WHOLE & (part - 1))  # parts are in the order of their bits
        return self.state[:, start : start + self._size(part)]

    def step(self, nstep: int) -> None:
        """Step all worlds."""
        list(self._threads.map(partial(self._step, nstep), range(len(self._data))))

    def rollout(self, nstep: int, control: Array, control_spec: int, record: tuple = ()) -> None:
        """Step all worlds under the forces `control` (N, nstep, nv), which are `qfrc_applied`."""
        for tick in range(nstep):
            self.bind("qfrc_applied")[:] = control[:, tick]
            self.step(1)

    def _step(self, nstep: int, n: int) -> None:
        model, data, state = self._models[n], self._data[n], self.state[n]
        mujoco.mj_setState(model, data, state, WHOLE)
        mujoco.mj_step(model, data, nstep)
        mujoco.mj_getState(model, data, state, WHOLE)
        if self._touching is None:
            self._sensors[n] = data.sensordata
        else:
            self._touching.read(model, data, self._sensors[n])
