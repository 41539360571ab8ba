"""Environments as people use them through Gymnasium: seeds, resets, time limits, pictures."""

import contextlib
import inspect
from collections.abc import Iterator

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers.vector import NormalizeObservation

import stickbench as sb
from backends.state import Array
from benchmark.parts import registry
from benchmark.runs import gym as made
from benchmark.settings import run_spec


@pytest.fixture
def many() -> Iterator[VectorEnv]:
    """Three worlds of the line."""
    env = sb.make_vec("Line", 3)
    yield env
    env.close()


def rest(env: VectorEnv) -> Array:
    """An action that moves nothing."""
    return np.zeros(env.action_space.shape, np.float32)


def test_only_masked_worlds_are_reset(many: VectorEnv) -> None:
    """Begin anew where the mask is, and leave the others alone."""
    many.reset(seed=1)
    for _ in range(5):
        seen = many.step(rest(many) + 1)[0]
    after, _ = many.reset(options={"reset_mask": np.array([True, False, True])})
    assert (after == seen).all(axis=1).tolist() == [False, True, False]


@pytest.mark.parametrize(
    "options", [{"mask": 1}, {"reset_mask": [1, 0, 0]}, {"reset_mask": [True]}]
)
def test_an_unknown_option_is_refused(many: VectorEnv, options: dict) -> None:
    """Say in a sentence what a reset allows."""
    with pytest.raises(ValueError, match="allowed: "):
        many.reset(seed=0, options=options)


def test_seeds_are_each_worlds_own(many: VectorEnv) -> None:
    """Give a world of seed 5 the episodes of a single environment of seed 5."""
    alone = sb.make("Line")
    first, _ = alone.reset(seed=5)
    again, _ = alone.reset()
    seen, _ = many.reset(seed=[4, 5, None])
    assert np.array_equal(seen[1], first) and not np.array_equal(seen[0], first)
    seen, _ = many.reset(options={"reset_mask": np.array([False, True, False])})
    assert np.array_equal(seen[1], again)
    alone.close()


def test_counts_of_seeds_and_of_actions_are_the_worlds(many: VectorEnv) -> None:
    """Refuse another number of seeds, and actions of another shape, with what is allowed."""
    with pytest.raises(ValueError, match="2 seeds were given; allowed: 3"):
        many.reset(seed=[1, 2])
    many.reset(seed=0)
    with pytest.raises(ValueError, match=r"\(3, 5\); allowed: \(3, 6\)"):
        many.step(rest(many)[:, :5])
    one = sb.make("Line")
    one.reset(seed=0)
    with pytest.raises(ValueError, match=r"\(1, 5\); allowed: \(1, 6\)"):
        one.step(np.zeros(5, np.float32))
    one.close()


def test_an_action_that_is_no_number_is_named(many: VectorEnv) -> None:
    """Name the world and the step, not the engine."""
    many.reset(seed=0)
    many.step(rest(many))
    action = rest(many)
    action[1, 2] = np.nan
    with pytest.raises(ValueError, match="action of world 1 is not finite at step 2"):
        many.step(action)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_autoreset_can_be_chosen(mode: AutoresetMode) -> None:
    """Restart in the next step, in the same one, or when the user says so; after 3 steps here."""
    env = sb.make_vec("Line", 2, autoreset_mode=mode, max_episode_steps=3)
    env.reset(seed=0)
    for _ in range(3):
        last, _, terminated, truncated, info = env.step(rest(env))
    assert truncated.all() and not terminated.any()
    assert ("final_obs" in info) == (mode == AutoresetMode.SAME_STEP)
    if mode == AutoresetMode.DISABLED:
        with pytest.raises(ValueError, match="episode of world 0 is over"):
            env.step(rest(env))
    elif mode == AutoresetMode.NEXT_STEP:
        new, reward, *ended, _ = env.step(rest(env))
        assert not np.array_equal(new, last) and not reward.any() and not np.any(ended)
    for _ in range(2):
        if mode != AutoresetMode.DISABLED:
            assert not env.step(rest(env))[3].any()
    env.close()


def test_gymnasiums_wrappers_fit(many: VectorEnv) -> None:
    """Normalise with Gymnasium's own wrapper, whatever ends an episode."""
    wrapped = NormalizeObservation(many)
    seen, _ = wrapped.reset(seed=0)
    assert np.isfinite(wrapped.step(rest(many))[0]).all() and seen.shape == (3, 18)


def test_an_episode_lasts_as_asked() -> None:
    """Cut a single environment at Gymnasium's own time limit."""
    env = sb.make("Line", max_episode_steps=4)
    env.reset(seed=0)
    cut = [env.step(np.zeros(6, np.float32))[3] for _ in range(4)]
    assert cut == [False, False, False, True]
    env.close()


@pytest.mark.parametrize("steps", [0, -1, 10**9])
def test_an_episode_has_a_length(steps: int) -> None:
    """Refuse episodes of no step, and those whose reference fits into no memory."""
    with pytest.raises(sb.UsageError, match=f"max_episode_steps is {steps}; allowed: 1 to"):
        sb.make_vec("Line", 3, max_episode_steps=steps)


def test_an_unknown_mode_of_reset_is_refused() -> None:
    """Say which modes there are."""
    with pytest.raises(sb.UsageError, match="autoreset_mode.*known: Disabled, NextStep, SameStep"):
        sb.make_vec("Line", 3, autoreset_mode="sometimes")


def test_settings_are_spelt_as_on_the_command_line() -> None:
    """Take a length with its unit, the pace, and the names of a run's fields; name what is not."""
    for radius in ({"radius": "3cm"}, {"radius_m": 0.03}):
        env = sb.make("Line", pace=1.5, **radius)
        assert env.unwrapped._env.task.radius_m == pytest.approx(0.03)  # type: ignore[attr-defined]
        env.close()
    with pytest.raises(sb.UsageError, match="no setting named 'raduis'.*Did you mean 'radius'"):
        sb.make("Line", raduis=1)
    with pytest.raises(sb.UsageError, match="no setting of an environment named 'steps'; known: b"):
        sb.make("Line", steps=5)
    with pytest.raises(sb.UsageError, match="given twice"):
        sb.make("Line", radius="3cm", radius_m=0.03)


@pytest.mark.parametrize("call", [sb.make, sb.make_vec])
def test_settings_are_shown(call) -> None:
    """Show every setting of a world, a figure or a percept with its default and its text."""
    shown = inspect.signature(call).parameters
    for name in run_spec.settings_for(run_spec.WORLD, run_spec.FIGURE, run_spec.PERCEPT):
        one = run_spec.SETTINGS[name]
        if name not in ("task", "backend"):
            assert one.read(shown[one.names[0]].default) == one.default
            assert f"- `{one.names[0]}`: {one.said}" in call.__doc__


@pytest.mark.parametrize("engine", registry.usual("backend"))
def test_a_video_is_recorded(engine, tmp_path, monkeypatch) -> None:
    """Film any engine's worlds with Gymnasium's RecordVideo; a child draws, and one is enough."""
    pytest.importorskip("moviepy")
    monkeypatch.setattr(made, "SIZE", (64, 64))
    try:
        drawn = sb.make("Line", engine=engine, render_mode="rgb_array", max_episode_steps=4)
        env = RecordVideo(drawn, str(tmp_path))
        env.reset(seed=0)
    except sb.CommandError as error:
        pytest.skip(str(error))
    for _ in range(4):
        env.step(np.zeros(6, np.float32))
    assert np.ptp(env.render()) > 50
    env.close()
    assert [path.suffix for path in tmp_path.iterdir()] == [".mp4"]


def test_every_world_is_drawn_as_it_is(monkeypatch) -> None:
    """Draw a picture per world, which changes as the world moves."""
    monkeypatch.setattr(made, "SIZE", (96, 96))
    env = sb.make_vec("Line", 2, render_mode="rgb_array")
    env.reset(seed=0)
    try:
        before = env.render()
    except sb.CommandError as error:
        pytest.skip(str(error))
    env.step(rest(env) - 1)
    after = env.render()
    assert before is not None and after is not None
    assert [image.shape for image in after] == [(96, 96, 3)] * 2
    assert all((a != b).any() for a, b in zip(before, after, strict=True))
    env.close()


def test_a_plain_list_is_an_action():
    """Step a batch with nested lists, as `bench doctor` does."""
    run = run_spec.RunSpec(backend="mujoco", task="line", worlds=1)
    with contextlib.closing(run.make_env([run.world()], 0, 1)) as env:
        env.reset()
        assert np.isfinite(env.step([[0.0] * env.action_width]).reward).all()


def test_whole_numbers_are_actions():
    """Move targets as far for a full action of any type."""
    run, targets = run_spec.RunSpec(backend="mujoco", task="line", worlds=1), []
    for full in (1, 1.0):
        with contextlib.closing(run.make_env([run.world()], 0, 1)) as env:
            env.reset()
            env.step([[full] * env.action_width])
            targets.append(env.target_rad.copy())
    assert np.array_equal(*targets)
