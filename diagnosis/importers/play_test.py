"""Play test: STS3215 servos hold a position while two others pull a lever (Robonine), CSV files.

Elastic bands pull with about 0.3 kgf at 100 mm when a pulling servo is at its far end, and are
slack at its near end. In between the pull is assumed to be proportional. Two coupled servos are
assumed to carry half of pull and lever each.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs import importer
from diagnosis.logs.log import Log, LogError, as_log_errors
from diagnosis.logs.servos import servo as known_servo
from files.bounded import one_line
from files.tables import read_csv

RAD_PER_COUNT = 2 * np.pi / 4096
HOME = 2047
"""Count at which the lever stands in the middle."""
APART = 200
"""Counts from HOME beyond which a servo rests that pulls; a tested one holds nearer to it."""
PULL_NM = 0.3 * 9.80665 * 0.1
"""Torque of a fully stretched band: about 0.3 kgf at 100 mm [Nm]."""
SLACK = 0.02
"""A pulling servo is at its near end within this share of its range; it holds its position to a few
counts."""
SERVO = "sts3215-12v"
LEVER_KG, LEVER_M = 0.02, 0.1
"""Printed lever; its mass is a guess [kg]."""
UNCERTAINTY = 0.2


class Importer(importer.Importer):
    """One log per CSV file, one episode each, about 10 Hz."""

    def read(self, path: Path) -> dict[str, Log]:
        """See `importer.Importer.read`."""
        return {p.stem: _log(p) for p in importer.files(path, "*.csv")}


def _log(path: Path) -> Log:
    table, servos = _load(path)
    resting = {servo: float(table[f"target pos ({servo})"].median()) - HOME for servo in servos}
    pullers = {servo: np.sign(rest) for servo, rest in resting.items() if abs(rest) > APART}
    tested = [servo for servo in servos if servo not in pullers]
    if not tested or len(pullers) != 2:
        raise LogError(
            f"{path} has {len(tested)} servos that hold and {len(pullers)} that pull; a play test "
            f"has at least 1, within {APART} counts of {HOME}, and 2 that rest farther from it"
        )
    pull_nm = sum(side * _stretch(table, servo) for servo, side in pullers.items()) * PULL_NM
    columns = {"t_s": table["t_s"], "protocol": "push"}
    for servo in tested:
        joint, target = f"servo{servo}", table[f"target pos ({servo})"]
        along = np.dot(target - HOME, table[f"target pos ({tested[0]})"] - HOME)
        facing = -1.0 if along < 0 else 1.0  # whether it moves as the first one does
        columns[f"command_rad.{joint}"] = RAD_PER_COUNT * (target - HOME)
        columns[f"position_rad.{joint}"] = RAD_PER_COUNT * (table[f"pos ({servo})"] - HOME)
        columns[f"push_nm.{joint}"] = facing * pull_nm / len(tested)
    names, known = [f"servo{servo}" for servo in tested], known_servo(SERVO)
    # engines have the PD law alone: the back-EMF is its kd
    drive = known.model_copy(update={"kd": known.back_emf, "back_emf": 0.0})
    used = {f"{what} ({servo})" for what in ("target pos", "pos") for servo in servos}
    return importer.log_of(
        f"Robonine play test, {path.stem}",
        pd.DataFrame(columns),
        ("levers.xml", _mjcf(names)),
        dict.fromkeys(names, drive),
        (name for name in table.columns if name not in {"timestamp", "t_s", *used}),
        nominal_uncertainty=UNCERTAINTY,
    )


def _load(path: Path) -> tuple[pd.DataFrame, list[str]]:
    """The table from the first reading on, its times from zero, and the servos that answered."""
    with as_log_errors():
        table = read_csv(path)
    try:
        time = pd.to_datetime(table["timestamp"], format="ISO8601")
        named = [c[5:-1] for c in table.columns if c.startswith("pos (")]
        if not named:
            raise KeyError("pos (1)")
        servos = [servo for servo in named if table[f"pos ({servo})"].notna().any()]
        needed = [f"{what} ({s})" for s in servos for what in ("target pos", "pos")]
        table = table.assign(t_s=(time - time[0]).dt.total_seconds()).astype(
            dict.fromkeys(needed, float)
        )
        known = table[needed].notna().all(axis=1)
        return table[known].reset_index(drop=True), servos
    except KeyError as error:
        raise LogError(f"{path} has no column {error}; is it a play test?") from None
    except (ValueError, TypeError, OverflowError) as error:
        what = one_line(str(error))
        raise LogError(f"{path} cannot be read as a play test: {what}") from None


def _stretch(table: pd.DataFrame, puller: str) -> np.ndarray:
    """Stretch of a pulling servo's band, from 0 (relaxed target) to 1 (farthest target)."""
    target = table[f"target pos ({puller})"].to_numpy()
    relaxed = np.median(target)
    far = target[np.argmax(np.abs(target - relaxed))]
    if far == relaxed:
        return np.zeros(len(table))
    share = np.clip((table[f"pos ({puller})"].to_numpy() - relaxed) / (far - relaxed), 0, 1)
    return np.where(share < SLACK, 0.0, share)


def _mjcf(joints: list[str]) -> str:
    """One vertical axis per servo, with its share of the lever."""
    mass = LEVER_KG / len(joints)
    across = mass * LEVER_M**2 / 12
    bodies = "".join(
        f"""
    <body name="lever_{joint}">
      <inertial mass="{mass}" pos="{LEVER_M / 2} 0 0" diaginertia="1e-7 {across} {across}"/>
      <joint name="{joint}" axis="0 0 1"/>
    </body>"""
        for joint in joints
    )
    return f"""<mujoco model="levers">
  <option timestep="0.001"/>
  <worldbody>{bodies}
  </worldbody>
</mujoco>
"""
