"""Importing this module registers the tasks with Gymnasium: stickbench/Line-v0, ...

Gymnasium 1.0 dropped its plug-in entry points, so a program says `import benchmark.gym` first, or
`gymnasium.make("benchmark.gym:stickbench/Eight-v0", backend="bullet")`.
"""

from gymnasium.envs import registration

from benchmark import registry


def _register() -> None:
    """Register every task as stickbench/NAME-v0."""
    for task in registry.names("task"):
        name = f"stickbench/{task.capitalize()}-v0"
        if name not in registration.registry:
            registration.register(
                name,
                entry_point="benchmark.gym_make:single",
                vector_entry_point="benchmark.gym_make:vector",
                kwargs={"task": task},
            )


_register()
