"""What the conformance suites share: every engine, and environments that are closed again."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from backends.engine import Engine
from benchmark import registry
from benchmark.errors import CommandError
from benchmark.run_spec import RunSpec
from benchmark.worlds import make_env
from tasks.batch import BatchEnv

MakeEnv = Callable[..., BatchEnv]


@pytest.fixture(params=registry.names("backend"))
def engine(request: pytest.FixtureRequest) -> type[Engine]:
    """Every engine that is installed."""
    try:
        return registry.load("backend", request.param)
    except CommandError as error:
        pytest.skip(str(error))


@pytest.fixture
def backend(engine: type[Engine]) -> str:
    """The name of every engine that is installed."""
    return engine.__module__.split(".")[-1].replace("_", "-")


@pytest.fixture
def make() -> Iterator[MakeEnv]:
    """Makes nominal environments by `RunSpec` settings, world count and seed; MuJoCo by default."""
    made = []

    def one(worlds: int = 1, seed: int = 0, **settings: Any) -> BatchEnv:
        run = RunSpec(**{"backend": "mujoco", "task": "line", **settings})
        made.append(make_env(run, [run.world()] * worlds, seed, workers=1))
        return made[-1]

    yield one
    for env in made:
        env.close()
