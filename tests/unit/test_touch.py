"""Taxels, contact centres and stick distances against geometry written down again."""

import dataclasses

import numpy as np
import pytest

from backends import kinematics, sticks, trx
from backends.spec import Fingertip, Spec
from backends.state import Array, State, quat_from_z_axis
from backends.touch import Skin, Touch, stick_shape, surface_distance, taxel_grid

SPEC = trx.spec(sticks.STICKS["reference"])
TIPS = SPEC.hand.fingertips
TAXELS = SPEC.hand.taxels


def axis_point(tip: Fingertip, points: Array) -> Array:
    """Nearest points on a tip's axis, fingertip frame."""
    nearest = np.zeros_like(points)
    nearest[:, 0] = np.clip(points[:, 0], -tip.length_m, 0.0)
    return nearest


@pytest.mark.parametrize("tip", TIPS, ids=lambda tip: tip.finger)
def test_grid_lies_on_the_tip(tip: Fingertip) -> None:
    """Place 128 distinct taxels on the capsule, normals of length one pointing straight out."""
    positions, normals = taxel_grid(tip, TAXELS)
    assert positions.shape == normals.shape == (128, 3)
    outwards = positions - axis_point(tip, positions)
    assert np.linalg.norm(outwards, axis=1) == pytest.approx(tip.radius_m, abs=1e-12)
    assert normals == pytest.approx(outwards / tip.radius_m, abs=1e-12)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-12)
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=2) + np.eye(128)
    assert apart.min() > 5e-4


def test_grid_covers_the_inner_and_front_side() -> None:
    """Run row by row from the rear of the pad to its front, mirrored across the finger."""
    positions, normals = taxel_grid(TIPS[0], TAXELS)
    rows = positions.reshape(TAXELS.rows, TAXELS.columns, 3)
    assert rows[0, :, 0] == pytest.approx(-TIPS[0].length_m, abs=1e-12)
    assert (np.diff(rows[..., 0].max(axis=1)) > 0).all()
    assert rows[:, ::-1, 2] == pytest.approx(-rows[..., 2], abs=1e-12)
    assert (normals[:, 1] > 0).all()
    middle = np.degrees(np.arctan2(normals[:, 0], normals[:, 1]))
    assert middle.max() == pytest.approx(np.degrees(TAXELS.front_rad))


def tip_frame(tip: int) -> tuple[Array, Array]:
    """Origin and rotation of a fingertip in the nominal grasp."""
    origins, rotations = kinematics.tip_frames(SPEC.hand, np.array([SPEC.hand.grasp_rad]))
    return origins[0, tip], rotations[0, tip]


def pressed(spec: Spec, tip: int, point: Array, normal: Array, axis: Array) -> State:
    """A stick touching one tip at a point, given with normal and stick axis in the tip's frame."""
    origin, rotation = tip_frame(tip)
    up = rotation @ axis
    up *= np.sign(up[2])
    state = State.allocate(1, 6, 3)
    state.joint_rad[0] = spec.hand.grasp_rad
    state.stick_pos_m[0] = origin + rotation @ (point + spec.stick.radius_m * normal)
    state.stick_quat_wxyz[0] = quat_from_z_axis(up)
    state.contact_force_n[0, tip] = rotation @ -normal
    return state


def surface(tip: Fingertip, along_m: float, across_rad: float) -> tuple[Array, Array]:
    """A point `along_m` from the rear of the pad over the surface, and its outward normal."""
    front = max(along_m - tip.length_m, 0.0) / tip.radius_m
    normal = np.array(
        [
            np.sin(front) * np.cos(across_rad),
            np.cos(front) * np.cos(across_rad),
            np.sin(across_rad),
        ]
    )
    return tip.radius_m * normal + [min(along_m - tip.length_m, 0.0), 0.0, 0.0], normal


def feel(spec: Spec, state: State) -> Touch:
    """What one world's skin feels."""
    return Skin([spec]).feel(state)


def press(tip: int, along_m: float, across_rad: float) -> tuple[Array, Array]:
    """Taxels (T,) active when a stick touches a tip there, and the error of their centre [m] (3,).

    The error is along the finger, across it and along the outward normal.
    """
    point, normal = surface(TIPS[tip], along_m, across_rad)
    across = np.cross(normal, np.cross([0.0, 0.0, 1.0], normal))
    across /= np.linalg.norm(across)
    touch = feel(SPEC, pressed(SPEC, tip, point, normal, across))
    assert touch.in_contact[0].tolist() == [f == tip for f in range(3)]
    frame = np.array([np.cross(normal, across), across, normal])
    return touch.active[0, tip], frame @ (touch.center_m[0, tip] - point)


@pytest.mark.parametrize("tip", range(3))
def test_press_is_felt_where_it_is(tip: int) -> None:
    """Activate the taxels around a contact, with their centre where the contact is.

    Within 1 mm along the finger and on the pad's middle line. Elsewhere across the finger within
    half a column's width: no mean over a grid is nearer in the worst case. The mean of points on
    a curved pad lies under it, by less than the reach.
    """
    rng = np.random.default_rng(tip)
    positions, _ = taxel_grid(TIPS[tip], TAXELS)
    column_m = TIPS[tip].radius_m * 2 * TAXELS.half_width_rad / (TAXELS.columns - 1)
    errors = []
    for along_m in rng.uniform(6e-3, 30e-3, 25):
        for across_rad, bound_m in ((0.0, 1e-3), (rng.uniform(-0.2, 0.2), column_m / 2)):
            active, error = press(tip, along_m, across_rad)
            away_m = np.linalg.norm(positions - surface(TIPS[tip], along_m, across_rad)[0], axis=1)
            assert active[away_m < 0.9 * TAXELS.reach_m].all()
            assert 5 <= active.sum() <= 12
            assert away_m[active].max() < 7e-3
            assert abs(error[0]) < 1e-3
            assert abs(error[1]) < bound_m
            assert -TAXELS.reach_m < error[2] <= 1e-12
            errors.append(error)
    assert np.sqrt(np.square(errors).sum(axis=1).mean()) < 1e-3


def test_no_force_no_taxel() -> None:
    """Feel nothing without force, however near the stick; forget what was felt before."""
    point, normal = surface(TIPS[1], 12e-3, 0.0)
    state = pressed(SPEC, 1, point, normal, np.array([0.0, 0.0, 1.0]))
    skin = Skin([SPEC])
    assert skin.feel(state).in_contact[0, 1]
    state.contact_force_n[:] = 0.0
    touch = skin.feel(state)
    assert not touch.active.any()
    assert not touch.center_m.any()
    assert not touch.in_contact.any()


def test_far_stick_is_not_felt() -> None:
    """Feel nothing of a stick farther away than the reach; feel it once it is nearer."""
    point, normal = surface(TIPS[0], 12e-3, 0.0)
    up = np.array([0.0, 0.0, 1.0])
    touch = feel(SPEC, pressed(SPEC, 0, point + 1.1e-3 * normal, normal, up))
    assert not touch.active.any()
    wide = dataclasses.replace(TAXELS, reach_m=3e-3)
    spec = dataclasses.replace(SPEC, hand=dataclasses.replace(SPEC.hand, taxels=wide))
    assert feel(spec, pressed(spec, 0, point + 1.1e-3 * normal, normal, up)).active.any()


def test_worlds_feel_their_own_stick() -> None:
    """Use each world's stick and state: a batch feels what its worlds feel alone."""
    specs = [SPEC, trx.spec(sticks.STICKS["thick"]), trx.spec(sticks.STICKS["square"])]
    point, normal = surface(TIPS[2], 14e-3, 0.05)
    alone = [pressed(spec, 2, point, normal, np.array([0.0, 0.0, 1.0])) for spec in specs]
    batch = State.allocate(3, 6, 3)
    for n, state in enumerate(alone):
        for field in dataclasses.fields(State):
            getattr(batch, field.name)[n] = getattr(state, field.name)[0]
    together = Skin(specs).feel(batch)
    for n, (spec, state) in enumerate(zip(specs, alone, strict=True)):
        assert np.array_equal(together.active[n], feel(spec, state).active[0])
    assert len({active.tobytes() for active in together.active}) == 3


def test_mixed_hands_are_refused() -> None:
    """Raise ValueError for worlds whose fingertips differ; each may have its own reach."""
    blunt = tuple(dataclasses.replace(tip, radius_m=0.014) for tip in TIPS)
    other = dataclasses.replace(SPEC, hand=dataclasses.replace(SPEC.hand, fingertips=blunt))
    with pytest.raises(ValueError, match="geometry"):
        Skin([SPEC, other])
    wide = dataclasses.replace(TAXELS, reach_m=3e-3)
    far = dataclasses.replace(SPEC, hand=dataclasses.replace(SPEC.hand, taxels=wide))
    point, normal = surface(TIPS[0], 14e-3, 0.0)
    state = pressed(SPEC, 0, point + 1.1e-3 * normal, normal, np.array([0.0, 0.0, 1.0]))
    batch = State.allocate(2, 6, 3)
    for field in dataclasses.fields(State):
        getattr(batch, field.name)[:] = getattr(state, field.name)
    assert Skin([SPEC, far]).feel(batch).in_contact[:, 0].tolist() == [False, True]


SHORT_M = 0.03
"""Length of the sticks whose surface is sampled [m]."""


def box_surface(half: float, r: float, spacing: float) -> Array:
    """Points all over a box's surface."""
    spans = [np.linspace(-h, h, round(2 * h / spacing) + 1) for h in (r, r, half)]
    faces = []
    for fixed, extent in enumerate((r, r, half)):
        free = [axis for axis in range(3) if axis != fixed]
        grid = np.meshgrid(*(spans[axis] for axis in free), indexing="ij")
        for side in (-extent, extent):
            face = np.full((grid[0].size, 3), side)
            face[:, free] = np.stack([g.ravel() for g in grid], axis=1)
            faces.append(face)
    return np.concatenate(faces)


def capsule_surface(half: float, r: float, rng: np.random.Generator) -> Array:
    """Points all over a capsule's surface."""
    normals = rng.normal(size=(60_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cap = r * normals + np.where(normals[:, 2:] > 0, half, -half) * [0, 0, 1]
    angle, z = rng.uniform(0, 2 * np.pi, 120_000), rng.uniform(-half, half, 120_000)
    return np.concatenate([cap, np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)])


@pytest.mark.parametrize("name", ["square", "reference"])
def test_distance_equals_sampled_distance(name: str) -> None:
    """Equal the distance to the nearest of many surface points, negative inside the stick."""
    stick = dataclasses.replace(sticks.STICKS[name], length_m=SHORT_M)
    r, rng = stick.radius_m, np.random.default_rng(0)
    if name == "square":
        samples, slack = box_surface(SHORT_M / 2, r, 2e-4), 1.5e-4
    else:
        samples, slack = capsule_surface(SHORT_M / 2 - r, r, rng), 4e-4
    reach = np.array([2.5 * r, 2.5 * r, SHORT_M / 2 + 1.5 * r])
    for point in rng.uniform(-reach, reach, (50, 3)):
        nearest = np.linalg.norm(samples - point, axis=1).min()
        distance = surface_distance(*point, stick_shape(stick))
        over = max(abs(point[2]) - (SHORT_M / 2 - r), 0.0)
        inside = (
            (np.abs(point) < [r, r, SHORT_M / 2]).all()
            if name == "square"
            else np.linalg.norm([point[0], point[1], over]) < r
        )
        assert (distance < 0) == inside
        assert -1e-12 < nearest - abs(distance) < slack


def test_stick_ends_are_where_the_length_says() -> None:
    """Put the surface at half the length on the axis and at the radius beside it."""
    for stick in sticks.STICKS.values():
        shape = stick_shape(stick)
        end, side = (0.0, 0.0, stick.length_m / 2), (stick.radius_m, 0.0, 0.0)
        assert [surface_distance(*p, shape) for p in (end, side)] == pytest.approx(
            [0.0, 0.0], abs=1e-15
        )
