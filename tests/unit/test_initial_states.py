"""Algorithm 1: every finger touches, starts spread as stated, and the impossible is refused."""

import dataclasses

import numpy as np
import pytest

from backends import kinematics, sticks, trx
from backends.spec import Spec
from backends.state import Array, InitialState, quat_from_z_axis, quat_to_matrix, quat_z_axis
from benchmark.settings.run_spec import RunSpec
from leaderboard.identity import run_digest
from tasks.initial_states import AXIAL_M, DISTAL_RAD, PIVOT_M, TILT_RAD, sample_initial_states

STICKS = list(sticks.STICKS.values())
PROXIMAL, DISTAL = [0, 2, 4], [1, 3, 5]


def sample(spec: Spec, seed: int = 0, worlds: int = 1, spread: float = 1.0) -> InitialState:
    """Initial states of equal worlds."""
    return sample_initial_states([spec] * worlds, np.random.default_rng(seed), spread)


def tip_gaps(spec: Spec, start: InitialState) -> Array:
    """Distances (N, F) [m] from tip to stick surface, by 20001 points on each tip's axis."""
    origins, rotations = kinematics.tip_frames(spec.hand, start.joint_rad)
    tip, stick = spec.hand.fingertips[0], spec.stick
    along = np.linspace(-tip.length_m, 0.0, 20_001)
    axis_points = origins[:, :, None] + along[:, None] * rotations[:, :, None, :, 0]
    from_center = axis_points - start.stick_pos_m[:, None, None]
    local = np.einsum("nji,nftj->nfti", quat_to_matrix(start.stick_quat_wxyz), from_center)
    r, half = stick.radius_m, stick.length_m / 2
    if stick.shape == "box":
        outside = np.maximum(np.abs(local) - [r, r, half], 0.0)
        distance = np.linalg.norm(outside, axis=-1)
    else:
        local[..., 2] -= np.clip(local[..., 2], r - half, half - r)
        distance = np.linalg.norm(local, axis=-1) - r
    return distance.min(axis=-1) - tip.radius_m


@pytest.mark.parametrize("stick", STICKS, ids=lambda stick: stick.name)
def test_every_finger_touches(stick: sticks.Stick) -> None:
    """Close each finger to a distance of zero within 1 um, in no joint beyond its range."""
    spec = trx.spec(stick)
    start = sample(spec, worlds=12)
    assert np.abs(tip_gaps(spec, start)).max() < 1e-6
    low, high = np.array([body.joint.range_rad for body in spec.hand.driven]).T
    assert (start.joint_rad > low).all()
    assert (start.joint_rad < high).all()
    assert np.linalg.norm(start.stick_quat_wxyz, axis=1) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("stick", STICKS, ids=lambda stick: stick.name)
def test_every_finger_touches_with_its_side(stick: sticks.Stick) -> None:
    """Find the distance zero in the middle of a tip too, in a grasp nearer to the palm."""
    spec = trx.spec(stick)
    flat = {"grip_m": (0.064, 0.0, 0.0), "grasp_rad": (-0.561, 0.7) * 3}
    spec = dataclasses.replace(spec, hand=dataclasses.replace(spec.hand, **flat))
    start = sample(spec, worlds=8, spread=0.3)
    origins, rotations = kinematics.tip_frames(spec.hand, start.joint_rad)
    along = ((start.stick_pos_m[:, None] - origins) * rotations[..., 0]).sum(axis=-1)
    assert (along < 0.0).all()
    assert (along > -trx.TIP_LENGTH_M).all()
    assert np.abs(tip_gaps(spec, start)).max() < 1e-6


def test_sticks_of_a_batch_differ() -> None:
    """Close on each world's own stick when sticks differ within a batch."""
    specs = [trx.spec(stick) for stick in STICKS]
    start = sample_initial_states(specs, np.random.default_rng(1))
    for n, spec in enumerate(specs):
        row = {f.name: getattr(start, f.name)[n : n + 1] for f in dataclasses.fields(start)}
        assert np.abs(tip_gaps(spec, InitialState(**row))).max() < 1e-6


@pytest.mark.parametrize("spread", [1.0, 0.5])
def test_starts_spread_uniformly(spread: float) -> None:
    """Fill the stated intervals with the mean and the deviation of uniform draws."""
    spec, worlds = trx.spec(STICKS[0]), 1000
    start = sample(spec, worlds=worlds, spread=spread)
    axis = quat_z_axis(start.stick_quat_wxyz)
    rise = spec.stick.length_m / 2 - spec.stick.grip_to_lower_end_m
    # Height is grip + axis_z (rise + axial), so the axial draw follows from it, then the pivot.
    axial = (start.stick_pos_m[:, 2] - spec.hand.grip_m[2]) / axis[:, 2] - rise
    pivot = start.stick_pos_m - (rise + axial)[:, None] * axis - spec.hand.grip_m
    distal = start.joint_rad[:, DISTAL] - np.array(spec.hand.grasp_rad)[DISTAL]
    drawn = {"tilt": axis[:, :2], "pivot": pivot[:, :2], "axial": axial[:, None], "distal": distal}
    halves = {"tilt": TILT_RAD, "pivot": PIVOT_M, "axial": AXIAL_M, "distal": DISTAL_RAD}
    for name, values in drawn.items():
        half = spread * halves[name]
        assert np.abs(values).max() <= half * (1 + 1e-9)
        deviation = half / np.sqrt(3)
        # Four standard errors of the mean; the deviation's own is smaller.
        assert np.abs(values.mean(axis=0)).max() < 4 * deviation / np.sqrt(worlds)
        assert values.std(axis=0) == pytest.approx(deviation, rel=4 / np.sqrt(worlds))


def test_no_spread_is_the_nominal_grasp() -> None:
    """Stand the stick upright at the grip, with nominal distal joints, in every world."""
    spec = trx.spec(STICKS[0])
    start = sample(spec, worlds=3, spread=0.0)
    rise = spec.stick.length_m / 2 - spec.stick.grip_to_lower_end_m
    assert start.stick_pos_m == pytest.approx(
        np.tile(np.add(spec.hand.grip_m, (0, 0, rise)), (3, 1)), abs=1e-15
    )
    assert np.array_equal(start.stick_quat_wxyz, np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
    grasp = np.array(spec.hand.grasp_rad)
    assert np.array_equal(start.joint_rad[:, DISTAL], np.tile(grasp[DISTAL], (3, 1)))
    assert start.joint_rad[:, PROXIMAL] == pytest.approx(np.tile(grasp[PROXIMAL], (3, 1)), abs=0.02)


def test_seed_decides() -> None:
    """Draw the same starts from equal seeds and others from another."""
    spec = trx.spec(STICKS[0])
    one, two, other = (sample(spec, seed, worlds=4) for seed in (3, 3, 4))
    for field in dataclasses.fields(InitialState)[:3]:
        assert np.array_equal(getattr(one, field.name), getattr(two, field.name))
        assert not np.array_equal(getattr(one, field.name), getattr(other, field.name))
    assert len({row.tobytes() for row in one.joint_rad}) == 4


def test_longer_list_begins_alike() -> None:
    """Draw the first grasps of a longer list as those of a shorter one."""
    spec = trx.spec(STICKS[0])
    few, many = (sample(spec, seed=3, worlds=n) for n in (2, 5))
    for field in dataclasses.fields(InitialState):
        assert np.array_equal(getattr(few, field.name), getattr(many, field.name)[:2])


def test_mixed_hands_are_refused() -> None:
    """Raise ValueError for worlds whose hands differ in geometry."""
    spec = trx.spec(STICKS[0])
    bodies = tuple(dataclasses.replace(b, origin_m=(0.05, 0.0, 0.0)) for b in spec.hand.bodies)
    other = dataclasses.replace(spec, hand=dataclasses.replace(spec.hand, bodies=bodies))
    with pytest.raises(ValueError, match="geometry"):
        sample_initial_states([spec, other], np.random.default_rng(0))


def test_quaternion_turns_z_to_every_axis() -> None:
    """Turn z to random unit axes, without turning about z."""
    axis = np.random.default_rng(0).normal(size=(100, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    quat = quat_from_z_axis(axis)
    assert quat_z_axis(quat) == pytest.approx(axis, abs=1e-12)
    assert quat_to_matrix(quat)[:, :, 2] == pytest.approx(axis, abs=1e-12)
    assert not quat[:, 3].any()


def test_quaternion_turns_z_upside_down() -> None:
    """Turn z straight down, where every shortest rotation will do."""
    down = np.array([[0.0, 0.0, -1.0]])
    assert quat_z_axis(quat_from_z_axis(down)) == pytest.approx(down, abs=1e-12)


@pytest.mark.parametrize(
    "change", [{"radius_m": 0.08}, {"grip_to_lower_end_m": 0.5}], ids=["too thick", "out of reach"]
)
def test_impossible_stick_is_refused(change: dict) -> None:
    """Raise ValueError where the open fingers overlap the stick and where the closed ones miss."""
    stick = dataclasses.replace(STICKS[0], **change)
    with pytest.raises(ValueError, match="cannot touch the stick"):
        sample(trx.spec(stick))


def test_training_may_start_from_a_single_state() -> None:
    """Start every training episode from the nominal grasp when asked, else from Algorithm 1's."""
    for width, count in ((0.0, 1), (1.0, 16)):
        run = RunSpec(backend="mujoco", task="line", worlds=16, start_spread=width)
        env = run.make_env([run.world()] * 16, seed=0, workers=1)
        env.reset()
        assert len({tuple(joints) for joints in env.state.joint_rad}) == count
        env.close()


def test_the_usual_width_of_starts_renames_no_run() -> None:
    """Give runs from before the setting existed the digest that they had."""
    run = RunSpec(backend="mujoco", task="line")
    older = {k: v for k, v in dataclasses.asdict(run).items() if k != "start_spread"}
    assert run.digest == run_digest(older, run.world().digest)
    assert dataclasses.replace(run, start_spread=0.0).digest != run.digest
