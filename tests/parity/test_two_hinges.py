"""The drive law's dead band against MuJoCo's backlash: two hinges in series, one limited.

The paper models backlash so, with a stiff limit. A limit that yields like the law's teeth makes
both models one, solved by a constraint solver here and by the drive law there.
"""

import dataclasses
import math

import mujoco
import numpy as np
import pytest

from backends import trx
from backends.mujoco import Backend
from backends.state import Array
from benchmark.physics import rigs, rollout
from benchmark.physics.rigs import DT_S

PLAY_RAD, PUSH_NM = math.radians(1.0), 0.2
DRIVE = dataclasses.replace(trx.PROXIMAL_DRIVE, coulomb_nm=0.0, play_rad=PLAY_RAD)
LINK = rigs.arm(DRIVE, mass_kg=0.1, com_m=(0.05, 0.0, 0.0), inertia_kgm2=1e-3)
TIME_S = DT_S * np.arange(1, 3001)
PUSHES_NM = np.repeat([0.0, PUSH_NM, -PUSH_NM], 1000)
STIFF = ((2.01 * DT_S, 1.0), (0.9, 0.95, 1e-3, 0.5, 2.0))
"""solref and solimp of a limit as hard as the time step bears."""


def teeth(impedance: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Limit (solref, solimp) that yields like the teeth of the drive law.

    MuJoCo's limit force is f = (B v + K r - a) / R with R = A (1 - d) / d, K = -solref[0] / d and
    B = -solref[1] / d ("Solver parameters" in its documentation), a the acceleration that results
    and A the inverse inertia between rotor and link; so solref = -(k, c) A (1 - d) leaves of the
    spring and damper k r + c v only a share d / (1 - d) of inertia, which vanishes with d.
    """
    inertia = LINK.inertia_kgm2[2] + LINK.mass_kg * LINK.com_m[0] ** 2
    scale = (1 / DRIVE.rotor_inertia_kgm2 + 1 / inertia) * (1 - impedance)
    solref = (-DRIVE.gear_stiffness_nm_rad * scale, -DRIVE.gear_damping_nms_rad * scale)
    return solref, (impedance, impedance, 1e-3, 0.5, 2.0)


def two_hinges(limit: tuple, gravity_m_s2: tuple[float, float, float]) -> mujoco.MjModel:
    """A rotor that carries the link on a hinge with play."""
    model = mujoco.MjSpec()
    model.compiler.degree = False
    model.option.timestep, model.option.gravity = DT_S, gravity_m_s2
    model.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.option.iterations, model.option.tolerance = 100, 1e-14
    hinge = {"type": mujoco.mjtJoint.mjJNT_HINGE, "axis": (0, 0, 1)}
    given = {"iquat": (1, 0, 0, 0), "explicitinertial": True}
    rotor_inertia = (DRIVE.rotor_inertia_kgm2,) * 3
    rotor = model.worldbody.add_body(mass=1e-6, ipos=(0, 0, 0), inertia=rotor_inertia, **given)
    rotor.add_joint(**hinge)
    link = rotor.add_body(mass=LINK.mass_kg, ipos=LINK.com_m, inertia=LINK.inertia_kgm2, **given)
    link.add_joint(
        range=(-PLAY_RAD, PLAY_RAD),
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        solref_limit=limit[0],
        solimp_limit=limit[1],
        **hinge,
    )
    return model.compile()


def by_hinges(limit: tuple, target: Array, push: Array, gravity: tuple = (0, 0, 0)) -> Array:
    """Angle of the link after every step; the push on the link turns both hinges."""
    model = two_hinges(limit, gravity)
    data = mujoco.MjData(model)
    path = []
    for wanted, push_nm in zip(target, push, strict=True):
        pd = DRIVE.kp_nm_rad * (wanted - data.qpos[0]) - DRIVE.kd_nms_rad * data.qvel[0]
        data.qfrc_applied[:] = pd + push_nm, push_nm
        mujoco.mj_step(model, data)
        path.append(data.qpos.sum())
    return np.array(path)


def by_law(target: Array, push: Array, gravity: tuple = (0, 0, 0)) -> Array:
    """The same with the drive law."""
    spec = rigs.rig([LINK], gravity_m_s2=gravity)
    start = rollout.at_rest([spec])
    path = rollout.record(Backend, [spec], start, target[:, None, None], push[:, None, None])
    return path.joint_rad[:, 0, 0]


@pytest.mark.parametrize("gravity", [(0, 0, 0), (0, 9.81, 0)], ids=["adrift", "leaning"])
def test_dead_band_is_a_limited_hinge(gravity: tuple) -> None:
    """Move alike through reversals and pushes, the nearer the less inertia the limit adds."""
    sway = 0.15 * np.sin(2 * np.pi * TIME_S)
    law = by_law(sway, PUSHES_NM / 2, gravity)
    gaps = [
        np.abs(by_hinges(teeth(d), sway, PUSHES_NM / 2, gravity) - law).max() for d in (1e-2, 1e-3)
    ]
    assert gaps[1] < 1e-5
    assert gaps[0] / gaps[1] == pytest.approx(10, rel=0.2)


def test_push_test_reads_the_same_play() -> None:
    """Find the play that was set in both models; a stiff limit lacks the teeth's yield."""
    still = np.zeros_like(TIME_S)
    paths = [by_law(still, PUSHES_NM), by_hinges(teeth(1e-3), still, PUSHES_NM)]
    paths.append(by_hinges(STIFF, still, PUSHES_NM))
    yields = PUSH_NM / DRIVE.gear_stiffness_nm_rad * np.array([1, 1, 0])
    for path, tooth in zip(paths, yields, strict=True):
        a, b, c = path[999], path[1999], path[2999]
        back = PUSH_NM / DRIVE.kp_nm_rad + tooth
        # The stiff limit is soft by solref: penetration under 1 mrad.
        assert b - a - back == pytest.approx(PLAY_RAD, abs=1e-3 if tooth == 0 else 1e-9)
        assert a - c - back == pytest.approx(PLAY_RAD, abs=1e-3 if tooth == 0 else 1e-9)
