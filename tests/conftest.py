"""What all suites share: a test in an engine that 'all' leaves out is slow."""

import pytest

from benchmark.parts import registry


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as slow what is parametrised by such an engine's name."""
    apart = set(registry.names("backend")) - set(registry.usual("backend"))
    for item in items:
        params = getattr(item, "callspec", None) and item.callspec.params.values()
        if apart.intersection(one for one in params or () if isinstance(one, str)):
            item.add_marker(pytest.mark.slow)
