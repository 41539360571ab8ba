"""What a diagnosis says of recordings on real hardware whose cause their authors documented.

The nominal mechanisms have masses and gains, and none of what is to be found. Nothing is set per
log.
"""

from pathlib import Path

import numpy as np
import pytest

from backends.shard import simulate
from benchmark.parts import registry
from diagnosis import Diagnosis, diagnose
from diagnosis.calibration.backlash import Play, push_test
from diagnosis.logs.log import Log
from diagnosis.logs.servos import servo
from diagnosis.logs.two_files import Asked, pair
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.triage.triage import triage
from diagnosis.verdict.result import UNKNOWN

REAL = Path(__file__).resolve().parents[3] / "shared/real_logs"
FOLDERS = {"emps": "emps", "bam": "bam_xl330", "play-test": "robonine"}
COUNT_RAD = 2 * np.pi / 4096
EMPS_COULOMB_N = 20.3935
"""Identified by the authors of EMPS."""
PLAY_COUNTS = {"motor_telemetry_single": (7.03, 14.78), "motor_telemetry_nocomp2": (5.33, 7.67)}
"""Play measured by the authors of the play test: unloaded and loaded, of the worse servo."""
FRICTIONS = {"coulomb-friction", "viscous-friction", "stiction", "load-friction"}
FRICTIONS |= {"direction-friction"}
MOTIONS = "triangle_wave", "staircase_motion", "single_joint_rotation", "backlash_detection"
GAINS = ("kp100", "kp200", "kp400", "kp800")


def logs(kind: str) -> dict[str, Log]:
    path = REAL / FOLDERS[kind]
    if not path.is_dir():
        pytest.skip(f"no real recordings at {path}")
    return registry.load("importer", kind)().read(path)


@pytest.fixture(scope="module")
def emps() -> Diagnosis:
    (log,) = logs("emps").values()
    return diagnose(log)


@pytest.mark.slow
def test_emps_is_friction(emps):
    """Name Coulomb friction of the axis as the authors identified it, within a twentieth."""
    (found,) = emps.magnitudes
    assert (found.effect, found.joint) == ("coulomb-friction", "axis")
    assert found.value == pytest.approx(EMPS_COULOMB_N, rel=0.05)
    assert found.low < EMPS_COULOMB_N < found.high and found.unit == "N"
    assert emps.shrinkage.interval[0] > 0.8
    assert emps.in_mujoco is not None and emps.in_mujoco.step_s < emps.in_mujoco.file_step_s
    assert emps.in_mujoco.after_rad < 0.15 * emps.in_mujoco.before_rad


@pytest.mark.parametrize(
    "gain", [GAINS[0], *(pytest.param(gain, marks=pytest.mark.slow) for gain in GAINS[1:])]
)
def test_bam_is_load_dependent_friction(gain):
    """Name or lead with load-dependent friction, which takes most of the gap, at every gain."""
    found = diagnose(logs("bam")[gain])
    assert set(found.verdict) <= {"load-friction", UNKNOWN}
    (limb,) = found.limbs
    assert limb.leading[0].effect == "load-friction" and limb.leading[0].share > 0.7


def servo_arm(motion: str) -> Log:
    """A motion of the SO-101, as its two tables, its model and its servos have it."""
    folder = REAL / "sage_so101"
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}")
    tables = [folder / motion / f"{name}.csv" for name in ("control", "state_motor")]
    return pair(folder / "so101.xml", tables, Asked(drives={"*": servo("sts3215,gain:16")}))


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_servo_arm_is_not_refused(motion):
    """Accuse no sensor and no unit where friction holds joints beside their targets."""
    log = servo_arm(motion)
    triage(log, mjcf_world(log))


@pytest.mark.slow
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_servo_arm_leads_with_friction(motion):
    """Lead with friction, and be sure of nothing else."""
    found = diagnose(servo_arm(motion))
    assert FRICTIONS & {cause.effect for limb in found.limbs for cause in limb.leading}
    assert {*found.verdict} <= FRICTIONS | {UNKNOWN} or found.probability < 0.8


def played(log: Log) -> list[Play]:
    world = mjcf_world(log)
    pushes = recordings(log, world)
    engine = registry.load("backend", "mujoco")
    plays = push_test(lambda specs: simulate(engine, specs, 1), world, pushes).values()
    assert all(isinstance(play, Play) for play in plays)
    return [play for play in plays if isinstance(play, Play)]


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (k > 0)) for k, n in enumerate(PLAY_COUNTS)]
)
def test_play_tests_show_play(name):
    """Find play by the push test, within a count of between the authors' unloaded and loaded."""
    plays = played(logs("play-test")[name])
    assert all(play.has_play for play in plays)
    worst = max(2 * play.mean_rad for play in plays) / COUNT_RAD
    unloaded, loaded = PLAY_COUNTS[name]
    assert unloaded - 1 < worst < loaded + 1
