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
GIVEN = ("qpos", "qfrc_applied", "userdata")
"""What may be written between steps."""


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
    """Worlds of their own, with the calls of `mujoco.batch.Batch` that the backend makes."""

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
        self._bound: dict[str, Array] = {}

    def bind(self, name: str) -> Array:
        """A quantity of all worlds, (N, size): written before a step and read after it."""
        values = np.stack([getattr(data, name) for data in self._data])
        if name == "sensordata" and self._touching is not None:
            values = np.zeros((len(self._data), self._touching.size))
        return self._bound.setdefault(name, values)

    def reset(self, ids: Array, stage: object = None) -> None:
        """Reset some worlds."""
        for n in ids:
            mujoco.mj_resetData(self._models[n], self._data[n])
            self._read(n)

    def step(self, nstep: int) -> None:
        """Step all worlds."""
        list(self._threads.map(partial(self._step, nstep), range(len(self._data))))

    def rollout(self, nstep: int, control: Array, control_spec: int, record: tuple = ()) -> None:
        """Step all worlds under the forces `control` (N, nstep, nv), which are `qfrc_applied`."""
        for tick in range(nstep):
            self._bound["qfrc_applied"][:] = control[:, tick]
            self.step(1)

    def _step(self, nstep: int, n: int) -> None:
        model, data = self._models[n], self._data[n]
        for name in GIVEN:
            getattr(data, name)[:] = self._bound[name][n]
        mujoco.mj_step(model, data, nstep)
        self._read(n)

    def _read(self, n: int) -> None:
        for name, values in self._bound.items():
            if name == "sensordata" and self._touching is not None:
                self._touching.read(self._models[n], self._data[n], values[n])
            else:
                values[n] = getattr(self._data[n], name)
