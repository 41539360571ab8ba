"""BAM: a servo that swings a pendulum (Duclusaud et al., ICRA 2025), JSON files.

Its duty cycle is `gain kp (goal - position)`, at most 1, and its torque is
`kt / R (vin duty - kt speed)`, with the numbers of `logs.servos`. Recordings with the same firmware
gain `kp` become one log. Data after the torque was switched off (in `lift_and_drop`) is left out,
because it is no commanded motion.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from diagnosis.logs import importer
from diagnosis.logs.log import EpisodeMeta, Log, LogError, as_log_errors
from diagnosis.logs.servos import servo
from files.bounded import read_json

UNCERTAINTY = 0.1
_COLUMNS = {
    "timestamp": "t_s",
    "goal_position": "command_rad.servo",
    "position": "position_rad.servo",
    "speed": "velocity_rad_s.servo",
}
_SETTINGS = ("kp", "mass", "length", "vin", "trajectory", "entries")


class Importer(importer.Importer):
    """One log per firmware gain, one episode per file."""

    def read(self, path: Path) -> dict[str, Log]:
        """See `importer.Importer.read`."""
        recordings = [_load(p) for p in importer.files(path, "*.json")]
        gains = sorted({r["kp"] for r in recordings})
        return {f"kp{g:g}": _log([r for r in recordings if r["kp"] == g]) for g in gains}


def _load(path: Path) -> dict[str, Any]:
    with as_log_errors():
        data = read_json(path, importer.MOST_BYTES)
    missing = [name for name in _SETTINGS if name not in data]
    if missing or not data["entries"]:
        raise LogError(f"{path} has no {', '.join(missing) or 'entries'}; is it a BAM log?")
    return data


def _log(recordings: Sequence[dict[str, Any]]) -> Log:
    first = recordings[0]
    for key in ("mass", "length", "vin", "motor"):
        if len({r.get(key) for r in recordings}) > 1:
            raise LogError(
                f"recordings with the same gain differ in '{key}'; import them one by one"
            )
    parts = [_samples(r).assign(episode=k) for k, r in enumerate(recordings)]
    motor = str(first.get("motor", "xl330"))
    drive = servo(f"{motor},gain:{first['kp']:g},volts:{first['vin']:g}")
    every = (name for r in recordings for entry in r["entries"] for name in entry)
    used = {*_COLUMNS, "torque_enable"}
    return importer.log_of(
        f"BAM, {motor.upper()} with gain {first['kp']:g} (Duclusaud et al. 2025)",
        pd.concat(parts, ignore_index=True),
        ("pendulum.xml", _mjcf(first["mass"], first["length"])),
        {"servo": drive},
        (name for name in every if name not in used),
        episodes=[EpisodeMeta(episode=k, note=r["trajectory"]) for k, r in enumerate(recordings)],
        nominal_uncertainty=UNCERTAINTY,
    )


def _samples(recording: dict[str, Any]) -> pd.DataFrame:
    try:
        rows = pd.DataFrame(recording["entries"])
        off = np.flatnonzero(~rows["torque_enable"].to_numpy(dtype=bool))
        rows = rows.iloc[: off[0]] if len(off) else rows
        return pd.DataFrame({name: rows[given] for given, name in _COLUMNS.items()})
    except (KeyError, ValueError, TypeError) as error:
        raise LogError(f"entries of a BAM log lack {error}, or it is invalid") from None


def _mjcf(mass_kg: float, length_m: float) -> str:
    """A point mass that hangs straight down at position zero."""
    return f"""<mujoco model="pendulum">
  <option timestep="0.001"/>
  <worldbody>
    <body name="arm">
      <inertial mass="{mass_kg}" pos="0 0 {-length_m}" diaginertia="1e-6 1e-6 1e-6"/>
      <joint name="servo" axis="0 1 0"/>
    </body>
  </worldbody>
</mujoco>
"""
