"""Folders in which everything is in order, to be spoilt."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import savemat

from baselines.saved import POLICY_FILE, file_sha256
from benchmark.cli import app
from benchmark.runs.run_folder import RUN_FILE

ROOT = Path(__file__).resolve().parents[2]
MAKE = ["blind", "make", "--rig", "joint", "--seed", "3"]
"""Words that make a blind set."""
PLACES = ["--cases", "2", "--out", "out", "--answers", "answers.json"]
ARM = """<mujoco model="arm">
  <option timestep="0.001"/>
  <default><geom contype="0"/></default>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="a" axis="0 1 0" armature="0.01" damping="0.01" range="-90 90"/>
      <inertial mass="0.5" pos="0 0 -0.1" diaginertia="1e-3 1e-3 1e-3"/>
      <body name="lower" pos="0 0 -0.2">
        <joint name="b" axis="0 1 0" armature="0.01" frictionloss="0.01"/>
        <geom type="capsule" size="0.02 0.1" mass="0.2"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
LOG = """schema: 1
source: campaign
mechanism:
  mjcf: arm.xml
  joints:
    a: {kp: 5.0, kd: 0.2, limit: 3.0}
    b: {kp: 5.0, kd: 0.2, limit: 3.0, sensor: motor}
channels:
  command_rad: {unit: rad, rate_hz: 100}
episodes:
  - {episode: 0, protocol: free, note: first}
nominal_uncertainty: 0.1
"""
CALIBRATION = """schema: 1
log: logs/one
source: campaign
backend: mujoco
hand: trx
stick: reference
nominal_effects: none
seed: 0
effects: backlash=1deg@J3,kp-scale=-5%
spread: kp-scale=3%@J0
joints: {}
tactile: not recorded
"""
SETTINGS = """backend: mujoco
task: line
algo: hold-still
smoke: true
seed: 3
radius: 2cm
effects: none
"""
SWEEP = """defaults: {backend: mujoco, task: line, algo: hold-still, smoke: true}
grid:
  seed: [0, 1]
  radius: [2cm, 3cm]
cells:
  - {task: circle, effects: none}
time_limit: 1h
slurm: {cpus: 1, memory_gb: 2.0}
"""


def log(folder: Path) -> None:
    """A log of an arm of two joints, as CSV."""
    (folder / "log").mkdir(parents=True)
    (folder / "log/arm.xml").write_text(ARM)
    (folder / "log/log.yaml").write_text(LOG)
    _samples().to_csv(folder / "log/samples.csv", index=False)


def log_parquet(folder: Path) -> None:
    """The same log as parquet."""
    log(folder)
    (folder / "log/samples.csv").unlink()
    _samples().to_parquet(folder / "log/samples.parquet", index=False)


def run(folder: Path) -> None:
    """A finished run of the repository, and a leaderboard with a transfer matrix."""
    policy = sorted((ROOT / "leaderboard/policies").iterdir())[0]
    shutil.copytree(policy, folder / "run")
    matrix = sorted((ROOT / "leaderboard/transfer").glob("*/matrix.csv"))[0].parent
    for name in ("matrix.csv", "agreement.csv"):
        (folder / "board/transfer/a").mkdir(parents=True, exist_ok=True)
        shutil.copyfile(matrix / name, folder / "board/transfer/a" / name)
    marks = {"0123abcd": {"run": "a", "state": "exact", "cpu": "a", "commit": "b"}}
    (folder / "board/verified.json").write_text(json.dumps(marks))


def seal(folder: Path) -> None:
    """Write into a run's file that its policy is the one that lies there."""
    run_json = json.loads((folder / RUN_FILE).read_text())
    run_json["policy_sha256"] = file_sha256(folder / POLICY_FILE)
    (folder / RUN_FILE).write_text(json.dumps(run_json))


def calibration(folder: Path) -> None:
    """A calibration."""
    _write(folder / "calibration.yaml", CALIBRATION)


def settings(folder: Path) -> None:
    """Settings of a run."""
    _write(folder / "settings.yaml", SETTINGS)


def sweep(folder: Path) -> None:
    """A sweep of five cells."""
    _write(folder / "sweep.yaml", SWEEP)


def small_sweep(folder: Path) -> None:
    """A sweep of two cells."""
    _write(folder / "sweep.yaml", SWEEP.partition("grid:")[0] + "grid: {seed: [0, 1]}\n")


def short_log(folder: Path) -> None:
    """A log of one joint whose motion is explained by the nominal world."""
    one = ARM.replace(
        ARM[ARM.index('      <body name="lower"') : ARM.index("    </body>\n  </w")], ""
    )
    _write(folder / "log/arm.xml", one)
    kept = [line for line in LOG.splitlines() if not line.startswith("    b:")]
    (folder / "log/log.yaml").write_text("\n".join(kept) + "\n")
    samples = _samples()
    own = [name for name in samples.columns if not name.endswith(".b")]
    samples[own].to_csv(folder / "log/samples.csv", index=False)


def bam(folder: Path) -> None:
    """A recording of a pendulum."""
    t = np.arange(100) / 200
    entries = [
        {
            "timestamp": s,
            "goal_position": np.sin(3 * s),
            "position": 0.8 * np.sin(3 * s - 0.1),
            "speed": 2.4 * np.cos(3 * s - 0.1),
            "torque_enable": True,
        }
        for s in t
    ]
    data = {"kp": 400, "mass": 0.5, "length": 0.1, "vin": 7.4, "trajectory": "swing"}
    _write(folder / "bam.json", json.dumps({**data, "entries": entries}))


def emps(folder: Path) -> None:
    """A recording of a linear axis."""
    t = np.arange(500) / 1000
    law = {"gtau": 35.0, "kp": 160.0, "kv": 240.0}
    folder.mkdir(parents=True, exist_ok=True)
    savemat(
        folder / "emps.mat",
        {"t": t, "qg": 0.1 * t**2, "qm": 0.1 * (t - 0.01) ** 2, "vir": 2 * t, **law},
    )


def play_test(folder: Path) -> None:
    """A recording of four servos, two of which pull."""
    rows = 60
    pull = (np.arange(rows) // 10) % 3 == 2
    stamps = pd.Timestamp("2025-11-12T09:53:06Z") + pd.to_timedelta(0.1 * np.arange(rows), "s")
    table = {"timestamp": [s.isoformat() for s in stamps]}
    for servo, rest, way in ((1, 2047, 0), (2, 2047, 0), (3, 1747, 400), (4, 2347, -400)):
        table[f"target pos ({servo})"] = rest + way * pull
        table[f"pos ({servo})"] = rest + 0.9 * way * pull
    folder.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(table).to_csv(folder / "play.csv", index=False)


def blind_set(folder: Path) -> None:
    """A blind set of one case, and its answers."""
    folder.mkdir(parents=True, exist_ok=True)
    words = [*MAKE, "--cases", "1", "--real", "presliding", "--out", str(folder / "set")]
    if app.call([*words, "--answers", str(folder / "answers.json"), "-j", "1", "-q"]) != 0:
        raise RuntimeError("no blind set could be made")


def solved_set(folder: Path) -> None:
    """The same, solved."""
    blind_set(folder)
    if app.call(["blind", "run", str(folder / "set"), "-j", "1", "-q"]) != 0:
        raise RuntimeError("no blind set could be solved")


EVERYTHING = (run, short_log, small_sweep, bam, solved_set)
"""What commands act on."""


def copy(base: Callable[[Path], None], folder: Path, shelf: Path) -> None:
    """Put a copy of what `base` writes into a folder; it is written once."""
    good = shelf / f"base {base.__name__}"
    if not good.exists():
        base(good)
    shutil.copytree(good, folder, dirs_exist_ok=True)


def _samples() -> pd.DataFrame:
    t = np.arange(300) / 100
    table: dict[str, np.ndarray] = {"episode": np.zeros(300, int), "t_s": t}
    table["protocol"] = np.full(300, "free")
    for joint, pace in (("a", 2.0), ("b", 3.0)):
        table[f"command_rad.{joint}"] = 0.3 * np.sin(pace * t)
        table[f"position_rad.{joint}"] = 0.3 * np.sin(pace * (t - 0.02))
        table[f"torque_nm.{joint}"] = 0.1 * np.cos(pace * t)
    return pd.DataFrame(table)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
