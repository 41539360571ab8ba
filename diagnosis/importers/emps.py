"""EMPS: a linear axis with motor and ball screw (Janot, Gautier, Brunot 2019), DATA_EMPS.mat.

The controller `vir = kv (kp (qg - qm) - dqm/dt)` with the force `gtau vir` is a cascade. The
mass is the authors' value. They do not say how much of it belongs to motor and screw; half is
assumed. The friction and the constant offset that they identified are not in the model, so that a
diagnosis can find them.
"""

import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs import importer
from diagnosis.logs.log import Log, LogError, as_log_errors, drive_of
from files.bounded import one_line, read_bytes

MASS_KG = 95.1089
"""Moving mass with motor and screw, as identified by the authors [kg]."""
VOLTAGE_V = 10.0
"""Voltage at which the drive saturates [V]."""
_NAMES = ("t", "qg", "qm", "vir", "gtau", "kp", "kv")
_READER = """
import io, sys
import numpy as np
from scipy.io import loadmat, whosmat
given, file, wanted = sys.stdin.buffer.read(), io.BytesIO(), sys.argv[1:]
data = loadmat(io.BytesIO(given), variable_names=wanted)
found = {name: np.asarray(data[name], dtype=float).ravel() for name in wanted if name in data}
others = [name for name, _, _ in whosmat(io.BytesIO(given)) if name not in wanted]
np.savez(file, unused=np.array(others, dtype=str), **found)
sys.stdout.buffer.write(file.getvalue())
"""
_MJCF = f"""<mujoco model="emps">
  <option timestep="0.001"/>
  <worldbody>
    <body name="carriage">
      <inertial mass="{MASS_KG / 2}" pos="0 0 0" diaginertia="1 1 1"/>
      <joint name="axis" type="slide" axis="1 0 0" armature="{MASS_KG / 2}"/>
    </body>
  </worldbody>
</mujoco>
"""


class Importer(importer.Importer):
    """One episode of 24.8 s at 1 kHz. It begins 14 ms after rest, at 7 mm/s."""

    def read(self, path: Path) -> dict[str, Log]:
        """See `importer.Importer.read`."""
        return {p.stem: _log(p) for p in importer.files(path, "*.mat")}


def _log(path: Path) -> Log:
    data = _load(path)
    gtau, kp, kv = (float(data[name][0]) for name in ("gtau", "kp", "kv"))
    numbers = {"position_gain": kp, "kd": gtau * kv, "limit": gtau * VOLTAGE_V}
    drive = drive_of(path, sensor="motor", **numbers)
    samples = pd.DataFrame(
        {
            "t_s": data["t"],
            "command_m.axis": data["qg"],
            "position_m.axis": data["qm"],
            "torque_n.axis": gtau * data["vir"],
        }
    )
    source, unused = "EMPS (Janot, Gautier, Brunot 2019)", map(str, data["unused"])
    return importer.log_of(source, samples, ("emps.xml", _MJCF), {"axis": drive}, unused)


def _load(path: Path) -> dict[str, np.ndarray]:
    """The numbers of a file, read in another process: a damaged one ends its reader."""
    with as_log_errors():
        given = read_bytes(path, importer.MOST_BYTES)
    command = [sys.executable, "-P", "-c", _READER, *_NAMES]
    done = subprocess.run(command, input=given, capture_output=True)
    if done.returncode != 0:
        said = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        why = one_line(said) or "it ends its reader"
        raise LogError(f"{path} cannot be read as a MATLAB file: {why}")
    data = dict(np.load(io.BytesIO(done.stdout)))
    if lacking := [name for name in _NAMES if name not in data]:
        raise LogError(f"{path} has no {lacking[0]!r}; an EMPS file has {', '.join(_NAMES)}")
    return data
