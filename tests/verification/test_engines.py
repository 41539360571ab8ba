"""Every engine against closed forms and conservation laws, as `bench doctor physics` does."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from backends.engine import Engine
from backends.spec import Body
from benchmark.physics import parity, rigs, suite
from benchmark.physics.check import Measure

DEAR = (parity.floor,)
"""Measures that take seconds; `parity` measures the same motions between engines."""
KEPT = Path(__file__).resolve().parents[2] / "leaderboard/physics.json"


def name_of(measure: Measure) -> str:
    """File and name of a measuring function."""
    return f"{measure.__module__.split('.')[-1]}.{measure.__name__}"


@pytest.mark.parametrize(
    "measure",
    [pytest.param(one, marks=pytest.mark.slow if one in DEAR else ()) for one in suite.ALONE],
    ids=map(name_of, suite.ALONE),
)
def test_engine_obeys(engine: type[Engine], measure: Measure) -> None:
    """Come as near to the closed form as the time step and the engine's rounding allow."""
    checks = tuple(measure(engine))
    assert checks
    assert [check for check in checks if not check.passed] == []
    kept = KEPT.read_text()
    assert [check.name for check in checks if check.name not in kept] == []


@pytest.mark.parametrize(
    ("number", "change"),
    [
        ("joint.slides", lambda b: replace(b, joint=replace(b.joint, slides=True))),
        ("body.products_kgm2", lambda b: replace(b, products_kgm2=(1e-6, 0.0, 0.0))),
    ],
)
def test_what_no_check_measures_is_refused(
    engine: type[Engine], number: str, change: Callable[[Body], Body]
) -> None:
    """Refuse slides and products of inertia instead of dropping them in silence."""
    hand = rigs.hand()
    with pytest.raises(ValueError, match=number):
        engine([hand.with_driven(change(body) for body in hand.hand.driven)])
