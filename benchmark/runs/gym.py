"""Importing this module registers the tasks with Gymnasium: stickbench/Line-v0, ...

Gymnasium has no plug-in entry points, so a program imports `stickbench` first, or says
`gymnasium.make("stickbench:stickbench/Eight-v0", engine="bullet")`.
"""

from gymnasium.envs import registration

from backends.spec import Timing
from benchmark.parts import registry
from tasks.task import EPISODE_S

EPISODE_STEPS = round(EPISODE_S / Timing().policy_s)


def gym_id(task: str) -> str:
    """The name of a task in Gymnasium."""
    return f"stickbench/{task.capitalize()}-v0"


def _register() -> None:
    """Register every task."""
    for task in registry.names("task"):
        if gym_id(task) not in registration.registry:
            registration.register(
                gym_id(task),
                entry_point="benchmark.runs.gym_make:single",
                vector_entry_point="benchmark.runs.gym_make:vector",
                max_episode_steps=EPISODE_STEPS,
                kwargs={"task": task},
            )


_register()
