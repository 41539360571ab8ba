"""What the verification suites share: every engine."""

import pytest

from backends.engine import Engine
from benchmark.errors import CommandError
from benchmark.parts import registry


@pytest.fixture(params=registry.names("backend"))
def engine(request: pytest.FixtureRequest) -> type[Engine]:
    """Every engine that is installed."""
    try:
        return registry.load("backend", request.param)
    except CommandError as error:
        pytest.skip(str(error))
