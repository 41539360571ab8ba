"""What is wrong with real skin, against its definition: threshold, drift, dead taxels, halo."""

import numpy as np
import pytest

from backends import kinematics, sticks, trx
from backends.spec import Spec
from backends.state import Array, State, quat_z_axis
from backends.touch import THRESHOLD_M, Skin, Touch, taxel_grid
from benchmark.settings.effects import parse_effects
from tasks.initial_states import sample_initial_states

IDEAL = trx.spec(sticks.STICKS["reference"])
TAXELS = IDEAL.hand.taxels
GRID = np.stack([taxel_grid(tip, TAXELS)[0] for tip in IDEAL.hand.fingertips])
"""Taxel positions in their fingertips' frames [m], (F, T, 3)."""


def grasp(forces: bool = True) -> State:
    """A grasp of the stick with every finger touching, with or without force."""
    start = sample_initial_states([IDEAL], np.random.default_rng(2))
    state = State.allocate(1, 6, 3)
    state.joint_rad[:] = start.joint_rad
    state.stick_pos_m[:], state.stick_quat_wxyz[:] = start.stick_pos_m, start.stick_quat_wxyz
    state.contact_force_n[:] = float(forces)
    return state


def world(text: str) -> Spec:
    """The ideal hand with effects."""
    spec = IDEAL
    for effect in parse_effects(text, spec.hand):
        spec = effect.on_spec(spec)
    return spec


def feel(text: str, time_s: float = 0.0, forces: bool = True) -> Touch:
    """What the skin of the ideal hand with effects feels of the grasp."""
    return Skin([world(text)]).feel(grasp(forces), np.array([time_s]))


def distances() -> Array:
    """Distance of every taxel to the stick's surface [m], (F, T): to its axis, less its radius."""
    state = grasp()
    origin, rotation = kinematics.tip_frames(IDEAL.hand, state.joint_rad)
    points = origin[0, :, None] + np.einsum("fij,ftj->fti", rotation[0], GRID)
    axis = quat_z_axis(state.stick_quat_wxyz[0])
    away = points - state.stick_pos_m[0]
    return np.linalg.norm(np.cross(away, axis), axis=-1) - IDEAL.stick.radius_m


def centers(active: Array) -> Array:
    """Mean position of the active taxels of each tip [m], (F, 3)."""
    count = np.maximum(active.sum(axis=1, keepdims=True), 1)
    return np.einsum("ft,ftk->fk", active, GRID) / count


def test_reading_is_the_pressed_depth() -> None:
    """Read the skin's thickness less the distance; thickness is reach and threshold."""
    touch = feel("none")
    depth = np.maximum(TAXELS.reach_m + THRESHOLD_M - distances(), 0.0)
    assert touch.reading_m[0] == pytest.approx(depth, abs=1e-12)
    assert np.array_equal(touch.active[0], distances() < TAXELS.reach_m)


@pytest.mark.parametrize("shift_mm", [-0.15, 0.1, 0.3, 1.0])
def test_threshold_moves_what_counts(shift_mm: float) -> None:
    """Activate what is pressed deeper by the shift than nominally needed; read as before."""
    touch = feel(f"taxel-threshold={shift_mm}mm")
    expected = distances() < TAXELS.reach_m - 1e-3 * shift_mm
    assert np.array_equal(touch.active[0], expected)
    assert np.array_equal(touch.reading_m, feel("none").reading_m)
    assert touch.center_m[0] == pytest.approx(centers(expected), abs=1e-12)
    assert np.array_equal(touch.in_contact[0], expected.any(axis=1))


def test_gains_are_the_taxels_own() -> None:
    """Multiply every reading by its own factor, spread evenly about 1, pressed or drifting."""
    nominal, some, more = (feel(text).reading_m for text in GAINS)
    pressed = nominal > 0.0
    assert np.array_equal(pressed, some > 0.0)
    gain = some[pressed] / nominal[pressed] - 1
    assert more[pressed] / nominal[pressed] - 1 == pytest.approx(2 * gain, abs=1e-12)
    assert np.abs(gain).max() < 0.2
    # A mean of n numbers that are uniform between +-0.2; four standard errors.
    assert abs(gain.mean()) < 4 * 0.2 / np.sqrt(3 * gain.size)
    assert gain.std() == pytest.approx(0.2 / np.sqrt(3), rel=0.5)
    drift = feel("taxel-drift=0.02mm/s", 3.0, forces=False).reading_m
    assert np.array_equal(drift, feel("taxel-drift=0.02mm/s,taxel-gain=20%", 3.0, False).reading_m)


def test_readings_stay_where_a_press_eases() -> None:
    """Read the depth on the way in, what was read on a little way back, and a share more beyond."""
    shifts_m = 1e-3 * np.array([0.0, 0.2, 0.4, 0.38, 0.3, 0.1, -0.2, 0.3, 5.0, 0.3])
    nominal, stays = Skin([world("none")]), Skin([world("taxel-hysteresis=20%")])
    for _ in range(2):  # an episode begins without what the one before left
        held = np.zeros_like(nominal.touch.reading_m)
        for k, shift_m in enumerate(shifts_m):
            state, now_s = grasp(), np.array([0.02 * k])
            state.stick_pos_m[:, 1] += shift_m
            depth = nominal.feel(state, now_s).reading_m
            held = np.minimum(np.maximum(held, depth), 1.2 * depth)
            read = stays.feel(state, now_s).reading_m.copy()
            assert read == pytest.approx(held, abs=1e-15)
            assert np.array_equal(stays.feel(state, now_s).reading_m, read)
        assert (held > depth).any()


GAINS = ("none", "taxel-gain=20%", "taxel-gain=40%")


def test_drift_grows_with_time() -> None:
    """Add to every reading its own rate times the time, rates spread from none to the fastest."""
    nominal = feel("none").reading_m
    drifts = {t: feel("taxel-drift=0.02mm/s", t).reading_m - nominal for t in (0.0, 1.0, 5.0)}
    assert not drifts[0.0].any()
    assert drifts[5.0] == pytest.approx(5 * drifts[1.0], abs=1e-15)
    rate = drifts[1.0] / 2e-5
    assert rate.min() >= 0.0
    assert rate.max() < 1.0
    # A mean of n uniform numbers; four standard errors.
    assert rate.mean() == pytest.approx(0.5, abs=4 * np.sqrt(1 / 12 / rate.size))


def test_drift_needs_no_touch_and_is_felt_in_the_end() -> None:
    """Read drift without force too, and activate a taxel once it is over the threshold."""
    for time_s, felt in ((5.0, False), (15.0, True)):  # at most 0.1 and 0.3 mm
        touch = feel("taxel-drift=0.02mm/s", time_s, forces=False)
        assert np.array_equal(touch.active, touch.reading_m > THRESHOLD_M)
        assert touch.active.any() == felt


@pytest.mark.parametrize("share", [0.0625, 0.25, 0.5, 1.0])
def test_share_of_dead_taxels(share: float) -> None:
    """Silence exactly the share of each tip's taxels, whatever presses or drifts; spare others."""
    text = f"taxel-dropout={100 * share}%"
    touch = feel(f"{text},taxel-drift=0.1mm/s", 1.0)
    living = feel("taxel-drift=0.1mm/s", 1.0)
    dead = touch.reading_m[0] == 0.0
    assert (dead.sum(axis=1) == round(share * GRID.shape[1])).all()
    assert np.array_equal(touch.reading_m[0][~dead], living.reading_m[0][~dead])
    assert not touch.active[0][dead].any()


def test_more_dead_taxels_are_the_same_and_others() -> None:
    """Leave dead at 40 % what is dead at 20 %."""
    texts = (f"taxel-dropout={s}%,taxel-drift=0.1mm/s" for s in (20, 40))
    some, more = (feel(text, 1.0).reading_m == 0.0 for text in texts)
    assert (more | ~some).all()


@pytest.mark.parametrize("halo_mm", [1.0, 3.0, 8.0])
def test_neighbours_answer(halo_mm: float) -> None:
    """Activate what lies nearer than the halo to a pressed taxel; read as before."""
    pressed = distances() < TAXELS.reach_m
    apart = np.linalg.norm(GRID[:, :, None] - GRID[:, None], axis=-1)
    near = ((apart < 1e-3 * halo_mm) & pressed[:, None]).any(axis=2)
    touch = feel(f"taxel-halo={halo_mm}mm")
    assert np.array_equal(touch.active[0], near)
    assert np.array_equal(touch.reading_m, feel("none").reading_m)
    assert touch.center_m[0] == pytest.approx(centers(near), abs=1e-12)


def test_dead_neighbours_stay_silent() -> None:
    """Let a halo wake no dead taxel."""
    dead = feel("taxel-dropout=30%,taxel-drift=0.1mm/s", 1.0).reading_m == 0.0
    wide = feel("taxel-halo=8mm")
    both = feel("taxel-halo=8mm,taxel-dropout=30%")
    assert (wide.active & dead).any()
    assert not (both.active & dead).any()
    assert not feel("taxel-halo=8mm", forces=False).active.any()


def test_worlds_have_their_own_skin() -> None:
    """Feel in a batch what each skin feels alone."""
    texts = ("none", "taxel-halo=4mm", "taxel-threshold=0.3mm", "taxel-dropout=40%")
    batch, one = State.allocate(len(texts), 6, 3), grasp()
    for name in ("joint_rad", "stick_pos_m", "stick_quat_wxyz", "contact_force_n"):
        getattr(batch, name)[:] = getattr(one, name)
    together = Skin([world(text) for text in texts]).feel(batch)
    for n, text in enumerate(texts):
        assert np.array_equal(together.active[n], feel(text).active[0])
        assert np.array_equal(together.reading_m[n], feel(text).reading_m[0])
