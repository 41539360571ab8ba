"""What the conformance suites share: every engine, and environments that are closed again."""

from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import pytest

from backends.engine import Engine
from benchmark.errors import CommandError
from benchmark.parts import registry
from benchmark.settings.run_spec import RunSpec
from files.plugins import name_of
from tasks.batch import BatchEnv

MakeEnv = Callable[..., BatchEnv]


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--only NAME`: the checks of one part, as `bench test` asks for."""
    parser.addoption("--only", metavar="NAME", help="checks of the part of this name")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep the checks that take the part of `--only`."""
    only = config.getoption("--only")
    if only is not None:
        items[:] = [i for i in items if only in getattr(i, "callspec", _NONE).params.values()]


class _NONE:
    """Of a check that takes no part."""

    params: ClassVar[dict[str, Any]] = {}


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
    return name_of(engine.__module__)


@pytest.fixture
def make() -> Iterator[MakeEnv]:
    """Makes nominal environments by `RunSpec` settings, world count and seed; MuJoCo by default."""
    made = []

    def one(worlds: int = 1, seed: int = 0, **settings: Any) -> BatchEnv:
        run = RunSpec(**{"backend": "mujoco", "task": "line", **settings})
        made.append(run.make_env([run.world()] * worlds, seed, workers=1))
        return made[-1]

    yield one
    for env in made:
        env.close()
