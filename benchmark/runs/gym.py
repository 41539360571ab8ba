"""The tasks as environments of Gymnasium; importing this registers them: stickbench/Line-v0, ...

Gymnasium has no plug-in entry points, so a program imports `stickbench` first, or says
`gymnasium.make("stickbench:stickbench/Eight-v0", engine="bullet")`.
"""

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any, Literal, ParamSpec, TypeVar

import gymnasium
import numpy as np
from gymnasium.envs import registration
from gymnasium.vector import AutoresetMode

from backends.spec import Timing
from backends.state import Array
from benchmark.errors import UsageError, unknown
from benchmark.parts import registry
from benchmark.pictures import _render
from benchmark.settings.run_spec import (
    FIGURE,
    PERCEPT,
    REFERENCE,
    WORLD,
    RunSpec,
    read_settings,
    setting_named,
    settings_for,
)
from benchmark.settings.run_spec import SETTINGS as RUN
from tasks.batch import BatchEnv
from tasks.gym_env import RENDER_MODES, MakePainter, StickEnv, StickVectorEnv
from tasks.task import EPISODE_S

P = ParamSpec("P")
T = TypeVar("T")
EPISODE_STEPS = round(EPISODE_S / Timing().policy_s)
MOST_EPISODE_STEPS = 100_000
"""The reference of an episode is drawn before it begins."""
SIZE = (480, 480)
"""Width and height of a picture [pixels]."""
RenderMode = Literal["rgb_array"]
SETTINGS = settings_for(WORLD, FIGURE, PERCEPT)
"""Settings of a run that an environment has."""
NAMED = ("task", "backend")
"""Those that are parameters of their own."""


def _shows_settings(call: Callable[P, T]) -> Callable[P, T]:
    """Give a function whose last parameter is `settings` their signature and text."""
    shown = [RUN[name] for name in SETTINGS if name not in NAMED]
    *own, rest = inspect.signature(call).parameters.values()
    keywords = [
        inspect.Parameter(
            one.names[0],
            inspect.Parameter.KEYWORD_ONLY,
            default=one.shown_default if getattr(one.kind, "unit", "") else one.default,
        )
        for one in shown
    ]
    said = [f"- `{p.name}`: {one.said}" for p, one in zip(keywords, shown, strict=True)]
    signature = inspect.signature(call).replace(parameters=[*own, *keywords])
    call.__signature__ = signature  # type: ignore[attr-defined]
    text = inspect.cleandoc(call.__doc__ or "")
    call.__doc__ = "\n".join([text, "", "Settings, written as those of `bench run`:", "", *said])
    return call


def gym_id(task: str) -> str:
    """The name of a task in Gymnasium."""
    return f"stickbench/{task.capitalize()}-v0"


@_shows_settings
def make(
    task: str,
    *,
    engine: str = REFERENCE,
    render_mode: RenderMode | None = None,
    max_episode_steps: int = EPISODE_STEPS,
    **settings: Any,
) -> gymnasium.Env[Array, Array]:
    """One world of a task, such as "Eight", as a Gymnasium environment.

    With `render_mode="rgb_array"` the environment draws itself, whatever the engine. Raises
    UsageError for what is not known, CommandError where an engine is missing.
    """
    return gymnasium.make(
        gym_id(task),
        max_episode_steps=max_episode_steps,
        engine=engine,
        render_mode=render_mode,
        **settings,
    )


@_shows_settings
def make_vec(
    task: str,
    num_envs: int,
    *,
    engine: str = REFERENCE,
    workers: int = 1,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    render_mode: RenderMode | None = None,
    max_episode_steps: int = EPISODE_STEPS,
    **settings: Any,
) -> StickVectorEnv:
    """N worlds of a task on up to `workers` cores as one Gymnasium vector environment.

    A world whose episode is over begins again with the next step, or as `autoreset_mode` says:
    "NextStep", "SameStep" or "Disabled". Raises as `make` does.
    """
    made = gymnasium.make_vec(
        gym_id(task),
        num_envs=num_envs,
        engine=engine,
        workers=workers,
        autoreset_mode=autoreset_mode,
        render_mode=render_mode,
        max_episode_steps=max_episode_steps,
        **settings,
    )
    assert isinstance(made, StickVectorEnv)
    return made


def single(task: str, render_mode: str | None = None, **settings: Any) -> StickEnv:
    """The entry point of Gymnasium's `make`, with its keywords."""
    run = _run(task, settings)
    return StickEnv(partial(_make, run, 1, None), _painter(render_mode))


def vector(
    task: str,
    num_envs: int = 1,
    workers: int = 1,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    render_mode: str | None = None,
    max_episode_steps: int = EPISODE_STEPS,
    **settings: Any,
) -> StickVectorEnv:
    """The entry point of Gymnasium's `make_vec`, with its keywords."""
    if not 1 <= max_episode_steps <= MOST_EPISODE_STEPS:
        raise UsageError(
            f"max_episode_steps is {max_episode_steps}; allowed: 1 to {MOST_EPISODE_STEPS}"
        )
    modes = [mode.value for mode in AutoresetMode]
    if autoreset_mode not in (*AutoresetMode, *modes):
        raise unknown("autoreset_mode", str(autoreset_mode), modes)
    batch = partial(_make, _run(task, settings), workers, max_episode_steps)
    return StickVectorEnv(batch, num_envs, autoreset_mode, _painter(render_mode))


def _run(task: str, settings: dict[str, Any]) -> RunSpec:
    for name in settings:
        if (known := setting_named(name).name) not in SETTINGS:
            raise unknown("setting of an environment", known, SETTINGS)
    return RunSpec(**{"backend": REFERENCE, **read_settings({**settings, "task": task})})


def _make(
    run: RunSpec, workers: int, episode_steps: int | None, worlds: int, seed: int
) -> BatchEnv:
    return run.make_env([run.world()] * worlds, seed, workers, episode_steps)


def _painter(render_mode: str | None) -> MakePainter | None:
    if render_mode is None:
        return None
    if render_mode not in RENDER_MODES:
        raise unknown("render mode", render_mode, RENDER_MODES)
    return EnvPainter


class EnvPainter:
    """Draws the worlds of a batched environment; it keeps the trails of their episodes."""

    def __init__(self, env: BatchEnv) -> None:
        self._env = env
        self._painter = _render.Painter(_render.Stage(spec=env.simulator.specs[0], size=SIZE))
        self._trails: dict[int, list[Array]] = {}
        self._times_s: dict[int, float] = {}

    def paint(self, world: int) -> Array:
        """See `tasks.gym_env.Painter`."""
        env, state = self._env, self._env.state
        return self._painter.paint(
            _render.Moment(
                joint_rad=state.joint_rad[world].copy(),
                stick_pos_m=state.stick_pos_m[world].copy(),
                stick_quat_wxyz=state.stick_quat_wxyz[world].copy(),
                active=env.touch.active[world].copy(),
                reference_m=env.reference()[0][world],
                line_m=env.path(world),
                trail_m=self._trail(world),
            )
        )

    def close(self) -> None:
        """See `tasks.gym_env.Painter`."""
        self._painter.close()

    def _trail(self, world: int) -> Array:
        """Where the lower end was whenever this episode was drawn."""
        now_s = float(self._env.time_s[world])
        if now_s <= self._times_s.get(world, 0.0):
            self._trails[world] = []
        self._times_s[world] = now_s
        self._trails.setdefault(world, []).append(self._env.lower_end()[world])
        return np.array(self._trails[world])


def _register() -> None:
    """Register every task."""
    for task in registry.names("task"):
        if gym_id(task) not in registration.registry:
            registration.register(
                gym_id(task),
                entry_point="benchmark.runs.gym:single",
                vector_entry_point="benchmark.runs.gym:vector",
                max_episode_steps=EPISODE_STEPS,
                kwargs={"task": task},
            )


_register()
