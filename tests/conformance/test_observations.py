"""Every observation keeps the contract: its layout is golden and its values can be recomputed."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from backends import kinematics
from backends.encoder import EncoderBank
from backends.spec import Hand, Spec
from backends.state import Array, State, quat_to_matrix
from backends.touch import Skin, taxel_grid
from benchmark.parts import registry
from benchmark.settings.run_spec import RunSpec
from tasks.batch import BatchEnv
from tasks.observation import Observation, Percept

MakeEnv = Callable[..., BatchEnv]
GOLDEN = Path(__file__).resolve().parent.parent / "golden"
REWRITE = (
    "a golden file no longer holds. If that is meant, say so in the commit and write it anew:\n"
    "  (cd tests/conformance && "
    "python -c 'import test_observations as t; t.write_golden()')"
)
SCALE_M = 0.02
LEAD_SCALE_RAD = 0.1


def contracts() -> dict:
    """The layout of every observation of the TRX hand."""
    hand = RunSpec(backend="mujoco", task="line").world().hand
    return {name: observation(name, hand).contract() for name in registry.names("observation")}


def observation(name: str, hand: Hand) -> Observation:
    """An observation of a hand by its name."""
    return registry.load("observation", name)(hand)


def digests() -> dict[str, str]:
    """What identifies the ideal and the built reference world."""
    runs = {"ideal": "none", "built": "built"}
    return {
        name: RunSpec(backend="mujoco", task="line", effects=effects).world().digest
        for name, effects in runs.items()
    }


def write_golden() -> None:
    """Write the golden files anew: a decision, to be said in the commit."""
    for name, content in (("observations", contracts()), ("digests", digests())):
        (GOLDEN / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")


@pytest.fixture(params=registry.names("observation"))
def name(request: pytest.FixtureRequest) -> str:
    """Every observation."""
    return request.param


def taxels_pressed(spec: Spec, state: State) -> Array:
    """Active taxels (N, F, T), recomputed in world coordinates for a round stick."""
    origin, rotation = kinematics.tip_frames(spec.hand, state.joint_rad)
    grids = np.array([taxel_grid(tip, spec.hand.taxels)[0] for tip in spec.hand.fingertips])
    world = origin[:, :, None] + np.einsum("nfij,ftj->nfti", rotation, grids)
    from_center = world - state.stick_pos_m[:, None, None]
    axis = (quat_to_matrix(state.stick_quat_wxyz) @ np.array([0.0, 0.0, 1.0]))[:, None, None]
    half = spec.stick.length_m / 2 - spec.stick.radius_m
    along = np.clip((from_center * axis).sum(axis=-1, keepdims=True), -half, half)
    gap = np.linalg.norm(from_center - along * axis, axis=-1) - spec.stick.radius_m
    touching = np.linalg.norm(state.contact_force_n, axis=-1) > 0
    return (gap < spec.hand.taxels.reach_m) & touching[..., None]


def expected_channels(env: BatchEnv) -> dict[str, Array]:
    """Every known channel, recomputed from state and reference, scaled, (N, width)."""
    state, spec = env.state, env.simulator.specs[0]
    ranges = np.array([body.joint.range_rad for body in spec.hand.driven])
    pressed = taxels_pressed(spec, state)
    grids = np.array([taxel_grid(tip, spec.hand.taxels)[0] for tip in spec.hand.fingertips])
    count = pressed.sum(axis=-1)
    center = np.einsum("nft,fti->nfi", pressed, grids) / np.maximum(count, 1)[..., None]
    n = env.worlds
    return {
        "joint_position_over_range": (state.joint_rad - ranges[:, 0]) / np.ptp(ranges, axis=1),
        "desired_axis": env.reference()[1],
        "contact_center": center.reshape(n, -1) / SCALE_M,
        "stick_position_from_grip": (state.stick_pos_m - spec.hand.grip_m) / SCALE_M,
        "stick_axis": quat_to_matrix(state.stick_quat_wxyz)[:, :, 2],
        "in_contact": count > 0,
        "taxel": pressed.reshape(n, -1),
        "target_lead": (env.target_rad - state.measured_rad) / LEAD_SCALE_RAD,
    }


def test_width_is_the_sum_of_channels(name: str, make: MakeEnv) -> None:
    """Give vectors as wide as the contract's channels together, joints and u_d first."""
    env = make(2, observation=name)
    channels = env.observation.contract()["observation"]
    total = sum(channel["width"] for channel in channels)
    assert env.observation.width == total
    assert env.reset().shape == (2, total)
    assert [c["name"] for c in channels[:2]] == ["joint_position_over_range", "desired_axis"]
    assert all(channel["scale"] > 0 and channel["unit"] for channel in channels)


def test_values_can_be_recomputed(name: str, make: MakeEnv) -> None:
    """Hold in every channel what state and reference say, at rest and under motion.

    A channel that nobody has computed a second way, yet, is finite at least.
    """
    env = make(4, observation=name)
    env.reset()
    rng = np.random.default_rng(2)
    for _ in range(8):
        seen = env.step(rng.uniform(-1, 1, (4, 6))).observation
        known = expected_channels(env)
        column = 0
        for channel in env.observation.channels:
            block = seen[:, column : column + channel.width]
            if channel.name in known:
                assert block == pytest.approx(known[channel.name].astype(float), abs=1e-6)
            assert np.isfinite(block).all()
            column += channel.width
    assert known["in_contact"].any()


def test_motor_side_sensor_reads_the_motor() -> None:
    """Measure the motor's angle where the sensor sits there, and observe what is measured."""
    spec = RunSpec(backend="mujoco", task="line").world()
    driven = (
        dataclasses.replace(b, joint=dataclasses.replace(b.joint, sensor="motor"))
        if b.joint.name == "J3"
        else b
        for b in spec.hand.driven
    )
    bank, zeros = EncoderBank([spec.with_driven(driven)]), np.zeros(1, dtype=np.int64)
    measured = bank.read(np.zeros((1, 6)), np.full((1, 6), 0.3), zeros, zeros)[0]
    assert measured.tolist() == [0.3 * (name == "J3") for name in spec.hand.joint_names]
    state = State.allocate(1, 6, 3)
    upright = np.array([[0.0, 0.0, 1.0]])
    felt = Skin([spec]).feel(state)
    percept = Percept(
        state=state,
        touch=felt,
        desired_axis=upright,
        target_rad=np.zeros((1, 6)),
        axes=upright[:, None],
        steps=np.zeros(1, dtype=int),
    )
    before = observation("pose", spec.hand).read(percept)[0, :6]
    state.measured_rad[:] = measured
    moved = np.flatnonzero(observation("pose", spec.hand).read(percept)[0, :6] != before)
    assert [spec.hand.joint_names[j] for j in moved] == ["J3"]


def test_layouts_are_golden() -> None:
    """Keep every policy contract as it was published; one that is not published is free."""
    published, now = json.loads((GOLDEN / "observations.json").read_text()), contracts()
    assert {name: now.get(name) for name in published} == published, REWRITE


def test_worlds_are_golden() -> None:
    """Keep the numbers of the ideal and the built reference world as they were published."""
    assert json.loads((GOLDEN / "digests.json").read_text()) == digests(), REWRITE
