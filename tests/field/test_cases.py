"""What people report in public, in small logs outside of the repository: each is said rightly.

Skipped where they are not there.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from diagnosis import diagnose
from diagnosis.logs.log import Log, read_log
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.robot import contradictions
from diagnosis.triage.triage import FaultError, triage

CASES = Path(__file__).resolve().parents[3] / "shared/field_cases"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CASES.is_dir(), reason=f"no field cases at {CASES}"),
]


@pytest.mark.parametrize(
    "name",
    [
        "textured_floor",
        "mesh_mass_only",
        "keyframe_of_free_base",
        "damped_drive",
        "numeric_names",
        "urdf_no_armature",
        "actuator_differs",
        "mimic_follower",
    ],
)
def test_a_robot_is_read(name):
    """Read the robot, and say what contradicts itself or is unknown."""
    log = read_log(CASES / name)
    assert mjcf_world(log).drives
    said = " ".join(contradictions(log))
    wanted = {"actuator_differs": "kp is 400", "urdf_no_armature": "inertia of the motors"}
    assert wanted.get(name, "") in said


def log(name: str, folder: Path) -> Log:
    """A whole log of a case, made in plain MuJoCo."""
    made = [sys.executable, str(CASES / "make_logs.py"), str(folder), name]
    subprocess.run(made, check=True)
    return read_log(folder / name)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("turns", "both are in turns"),
        ("hundred", "both are in a unit of which"),
        ("zero_of_both", "from the model's zero"),
        ("gravity_compensated", "gravity.compensation|carr"),
        ("latched_off", "did not follow from 6.[01] to 8.[01] s"),
        ("stamps_scatter", "made from a row number"),
    ],
)
def test_a_log_is_understood(name, said, tmp_path):
    """Name what is wrong with the data, or what to know of it, before any cause."""
    one = log(name, tmp_path)
    world = mjcf_world(one)
    try:
        found = " ".join(triage(one, world))
    except FaultError as error:
        found = str(error)
    assert re.search(said, found)


@pytest.mark.parametrize("name", ["fine", "mesh_mass"])
def test_nothing_wrong_is_none(name, tmp_path):
    """Accuse nothing where nothing is wrong."""
    assert diagnose(log(name, tmp_path)).verdict == ("none",)


def test_an_integral_is_unknown_and_asked_for(tmp_path):
    """Say the drive's integral and lead with no sensor."""
    found = diagnose(log("integral", tmp_path))
    assert found.verdict == ("unknown",) and not found.limbs[0].leading
    assert "an integral" in " ".join(found.sentences)
