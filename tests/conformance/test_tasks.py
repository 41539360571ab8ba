"""Every task keeps the contract: its figure, its batched environment, its Gymnasium faces."""

import dataclasses
import warnings
from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_gymnasium
from gymnasium.vector import AutoresetMode

from backends.state import Array, State, quat_to_matrix
from benchmark.parts import registry
from benchmark.runs.gym import gym_id as name_of
from benchmark.settings.run_spec import RunSpec
from tasks.batch import BatchEnv
from tasks.task import EPISODE_S, RADIUS_M, RATE_RAD_S, Figure

POLICY_S = 0.02
STEPS = 300
SIGNALS = tuple(f.name for f in dataclasses.fields(State))
MakeEnv = Callable[..., BatchEnv]


@pytest.fixture(params=registry.names("task"))
def task(request: pytest.FixtureRequest) -> str:
    """Every task."""
    return request.param


def drawn(figure: Figure, heading_rad: float = 0.7) -> Array:
    """The figure over one episode at policy steps, offsets (T, 2) [m]."""
    time_s = POLICY_S * np.arange(STEPS + 1)
    return figure.offset_m(time_s, np.full(len(time_s), heading_rad))


def length(path_m: Array) -> float:
    """Length of a path [m]."""
    return float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum())


def actions(env: BatchEnv, steps: int, seed: int = 0) -> Array:
    """Gentle random actions (steps, N, J)."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.3, 0.3, (steps, env.worlds, env.action_width))


def test_figure_starts_at_the_centre(task: str) -> None:
    """Start at the centre whatever the heading, and give one offset per time."""
    figure = registry.load("task", task)()
    heading = np.linspace(0, 6, 5)
    assert figure.offset_m(np.zeros(5), heading) == pytest.approx(np.zeros((5, 2)), abs=1e-15)
    assert figure.offset_m(np.linspace(0, 6, 5), heading).shape == (5, 2)


@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_figure_is_continuous(task: str, speed: float) -> None:
    """Move less than 1.5 rate radius per second at the training pace and faster."""
    path = drawn(registry.load("task", task)(speed=speed))
    step_m = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert step_m.max() < 1.5 * speed * RATE_RAD_S * RADIUS_M * POLICY_S


def test_figure_fills_its_radius(task: str) -> None:
    """Stay within the radius and come within 1 % of it, for one heading or another."""
    figure, headings = registry.load("task", task)(), np.linspace(0, 2 * np.pi, 256, False)
    reach = max(np.linalg.norm(drawn(figure, at), axis=1).max() for at in headings)
    assert 0.99 * RADIUS_M < reach <= RADIUS_M * (1 + 1e-12)


def test_figure_scales_with_radius_and_speed(task: str) -> None:
    """Double every offset with the radius, and about double the path with the speed."""
    make = registry.load("task", task)
    once = drawn(make())
    assert drawn(make(radius_m=2 * RADIUS_M)) == pytest.approx(2 * once, abs=1e-15)
    assert length(drawn(make(speed=2.0))) == pytest.approx(2 * length(once), rel=0.1)


def test_tasks_draw_different_figures() -> None:
    """Draw another figure in every task."""
    paths = [drawn(registry.load("task", name)()) for name in registry.names("task")]
    for i, path in enumerate(paths):
        assert all(np.abs(path - other).max() > 0.2 * RADIUS_M for other in paths[:i])


def test_shapes_and_dtypes(task: str, make: MakeEnv) -> None:
    """Give float32 observations of the stated width and one number or flag per world."""
    env = make(3, task=task)
    first = env.reset()
    step = env.step(np.zeros((3, 6)))
    assert env.horizon == round(EPISODE_S / POLICY_S) == STEPS
    assert (env.worlds, env.action_width) == (3, 6)
    for observation in (first, step.observation):
        assert observation.shape == (3, env.observation.width)
        assert observation.dtype == np.float32
    for name, dtype in (
        ("reward", np.float64),
        ("end_error_m", np.float64),
        ("axis_error_rad", np.float64),
        ("terminated", np.bool_),
        ("truncated", np.bool_),
        ("done", np.bool_),
        ("tracked", np.bool_),
    ):
        assert getattr(step, name).shape == (3,)
        assert getattr(step, name).dtype == dtype


def test_same_seed_same_run(task: str, make: MakeEnv) -> None:
    """Repeat a run with equal seed to the last bit, in a new environment and in the same one."""
    runs = []
    envs = [make(2, seed=5, task=task), make(2, seed=5, task=task)]
    for env in (*envs, envs[0]):
        env.seed(5)
        run = [env.reset()]
        for action in actions(env, 10):
            step, observation = env.step_and_restart(action)
            run += [observation, step.reward]
        runs.append(run)
    for other in runs[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(runs[0], other, strict=True))


def test_start_is_randomised(task: str, make: MakeEnv) -> None:
    """Start differently in every world, with every seed and in the next episode."""
    env = make(2, task=task)
    first = env.reset()
    assert not np.array_equal(first[0], first[1])
    env.seed(1)
    assert not np.array_equal(first, env.reset())
    starts = {env.reset()[0].tobytes() for _ in range(8)}
    assert len(starts) > 1


def test_observations_live_and_are_finite(task: str, make: MakeEnv) -> None:
    """Give finite observations of which each number moves, and rewards of at most 0.5."""
    env = make(4, task=task, observation="pose-and-centers")
    seen = [env.reset()]
    for action in actions(env, 40):
        step, observation = env.step_and_restart(action)
        seen.append(observation)
        assert np.isfinite(step.reward).all()
        assert (step.reward <= 0.5).all()
        assert np.isfinite(step.end_error_m).all()
        assert np.isfinite(step.axis_error_rad).all()
    stack = np.array(seen)
    assert np.isfinite(stack).all()
    assert (stack.std(axis=0).max(axis=0) > 0).all()


def test_observations_share_no_memory(task: str, make: MakeEnv) -> None:
    """Keep what was given: no later step and no state shares its memory."""
    env = make(2, task=task)
    first = env.reset()
    step = env.step(np.zeros((2, 6)))
    given = (step.observation, step.reward, step.terminated, step.end_error_m, step.axis_error_rad)
    for array in (first, *given):
        assert not any(np.shares_memory(array, getattr(env.state, name)) for name in SIGNALS)
    kept = [array.copy() for array in (first, *given)]
    env.step(np.ones((2, 6)))
    assert all(np.array_equal(a, b) for a, b in zip(kept, (first, *given), strict=True))


def test_fallen_stick_ends_the_episode(task: str, make: MakeEnv) -> None:
    """Terminate, untracked, soon after the fingers open, with the centre 3 cm down; not before."""
    env = make(2, task=task)
    env.reset()
    height_m = env.state.stick_pos_m[:, 2].copy()
    fell_at = np.zeros(2, dtype=int)
    for step_no in range(1, 61):
        step = env.step(-np.ones((2, 6)))
        sunk_m = height_m - env.state.stick_pos_m[:, 2]
        assert (sunk_m[step.terminated] > 0.02).all()
        assert (sunk_m[~step.terminated] < 0.04).all()
        assert not (step.truncated & step.terminated).any()
        assert not step.tracked[step.terminated].any()
        fell_at[step.terminated & (fell_at == 0)] = step_no
        if step.terminated.all():
            break
    assert (fell_at > 5).all()
    assert step.terminated.all()


def test_episode_is_cut_after_300_steps(make: MakeEnv) -> None:
    """Truncate a held stick exactly after 6 s and restart it with its clock at zero."""
    env = make(1)
    env.reset()
    for step_no in range(1, STEPS + 1):
        step, observation = env.step_and_restart(np.zeros((1, 6)))
        assert step.truncated[0] == (step_no == STEPS)
        assert not step.terminated[0]
    assert env.time_s[0] == 0.0
    assert not np.array_equal(observation, step.observation)


def test_staggered_episodes_end_apart(make: MakeEnv) -> None:
    """Cut episodes at lengths of their own when asked to, and none of them otherwise."""
    env = make(32)
    for stagger in (True, False):
        env.reset(stagger=stagger)
        cut = np.array([env.step(np.zeros((32, 6))).truncated for _ in range(20)])
        assert cut.any() == stagger
        assert not cut.all(axis=1).any()


def test_reward_is_the_papers_formula(task: str, make: MakeEnv) -> None:
    """Equal C - w0 |u - u_d| - w1 (|P1 err| + |P2 err|) - w2 sum f, from state and reference."""
    env = make(3, task=task)
    env.reset()
    steps = int(np.random.default_rng(3).integers(15, 30))
    for action in actions(env, steps):
        step = env.step(action)
    state, (point, u_d) = env.state, env.reference()
    u = quat_to_matrix(state.stick_quat_wxyz) @ np.array([0.0, 0.0, 1.0])
    lower, upper = state.stick_pos_m - 0.1 * u, state.stick_pos_m + 0.1 * u
    p_lower = np.linalg.norm(lower - point, axis=1)
    p_upper = np.linalg.norm(upper - (point + 0.2 * u_d), axis=1)
    force_n = np.linalg.norm(state.contact_force_n, axis=2).sum(axis=1)
    axis = np.linalg.norm(u - u_d, axis=1)
    expected = 0.5 - 1.5 * axis - 2.0 * (p_lower + p_upper) - 0.005 * force_n
    assert step.reward == pytest.approx(expected, abs=1e-12)
    assert (force_n > 1).all()
    assert step.end_error_m == pytest.approx(p_lower, abs=1e-12)
    assert env.lower_end() == pytest.approx(lower, abs=1e-12)
    angle = np.arccos(np.clip((u * u_d).sum(axis=1), -1, 1))
    assert step.axis_error_rad == pytest.approx(angle, abs=1e-7)
    tracked = (p_lower < 0.01) & (angle < np.radians(5)) & ~step.terminated
    assert np.array_equal(step.tracked, tracked)


def test_reference_points_from_figure_to_grip(task: str, make: MakeEnv) -> None:
    """Hold u_d as the unit vector from the drawn point to the grip, 13 cm away, level offset."""
    env = make(3, task=task, radius_m=0.03)
    env.reset()
    grip = np.array([0.068, 0.0, 0.0])
    for _ in range(25):
        env.step(np.zeros((3, 6)))
        point, u_d = env.reference()
        assert np.linalg.norm(u_d, axis=1) == pytest.approx(1.0, abs=1e-12)
        assert point + 0.13 * u_d == pytest.approx(np.tile(grip, (3, 1)), abs=1e-12)
        assert (np.linalg.norm((point - grip)[:, :2], axis=1) <= 0.03 + 1e-12).all()


def test_figure_goes_on_after_the_episode(task: str) -> None:
    """Draw on where nobody ends an episode whose time is over, as in a longer one."""
    run = RunSpec(backend="mujoco", task=task)
    short, long = (run.make_env([run.world()] * 2, 0, 1, steps) for steps in (3, 20))
    short.reset()
    long.reset()
    for point in long.path(1):
        assert np.array_equal(short.reference()[0][1], point)
        short.step(np.zeros((2, 6)))
    short.close()
    long.close()


def test_gymnasium_accepts_the_environment(backend: str) -> None:
    """Pass the environment checkers of Gymnasium and Stable-Baselines3 on every engine."""
    from stable_baselines3.common.env_checker import check_env as check_sb3

    env = gymnasium.make(name_of("eight"), backend=backend).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*Box observation space (minimum|maximum).*")
        check_gymnasium(env, skip_render_check=True, skip_close_check=True)
        check_sb3(env)
    env.close()


def test_gymnasium_makes_every_task(task: str) -> None:
    """Register every task, single and vector, with the settings of a run."""
    env = gymnasium.make(name_of(task), observation="pose", radius="1cm", stick="thick")
    observation, _ = env.reset(seed=3)
    assert env.observation_space.contains(observation)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation)
    assert isinstance(reward, float)
    assert not (terminated or truncated)
    assert set(info) == {"p_err_cm", "q_err_deg", "tracked"}
    env.close()
    vector = gymnasium.make_vec(name_of(task), num_envs=2)
    assert vector.reset(seed=0)[0].shape == vector.observation_space.shape
    vector.close()


def test_gymnasium_makes_vectors(backend: str) -> None:
    """Step, restart within the step and hand out final observations in a vector environment."""
    mode = AutoresetMode.SAME_STEP
    env = gymnasium.make_vec(name_of("eight"), num_envs=2, engine=backend, autoreset_mode=mode)
    first, _ = env.reset(seed=3)
    again, _ = env.reset(seed=3)
    assert np.array_equal(first, again)
    assert env.observation_space.contains(first)
    for _ in range(40):
        observation, reward, terminated, truncated, info = env.step(-np.ones((2, 6), np.float32))
        assert env.observation_space.contains(observation)
        assert reward.shape == terminated.shape == truncated.shape == (2,)
        if terminated.any():
            break
    assert terminated.any()
    fallen = int(np.flatnonzero(terminated)[0])
    assert np.array_equal(info["_final_obs"], terminated | truncated)
    assert info["final_obs"][fallen].shape == observation[fallen].shape
    assert not np.array_equal(info["final_obs"][fallen], observation[fallen])
    env.close()


def test_unseeded_environments_differ() -> None:
    """Start unseeded Gymnasium environments from different states, as Gymnasium promises."""
    starts = []
    for _ in range(2):
        env = gymnasium.make("stickbench/Line-v0", backend="mujoco").unwrapped
        starts.append(env.reset()[0])
        env.close()
    assert not np.array_equal(*starts)
