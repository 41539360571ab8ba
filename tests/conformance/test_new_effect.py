"""A new effect is one file: simulated, drawn, searched for and documented without another edit."""

import sys

import pytest

from backends import effects
from backends.catalogue import catalogue
from backends.engine import Simulator
from backends.shard import simulate
from benchmark.parts import registry
from benchmark.parts.registry import ROOT
from benchmark.settings.effects import parse_effects
from diagnosis.blind import draw, make, rigs
from diagnosis.verdict.sensors import not_looked_for
from diagnosis.walk import diagnose
from files import plugins

FILE = '''"""The encoder's magnet sits askew."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Offset of the readings.

    Law: reading = angle + magnitude.
    """

    group = "magnets"
    dimension, unit = "angle", "deg"
    bounds = (-1.0, 1.0)
    levels = (0.1, 0.15, 0.2)
    number = "encoder.bias_rad"
    least = 0.001
    most = 0.5
    either_sign = True
    exact = True
'''
NAME = "magnet-offset"


@pytest.fixture
def added(tmp_path, monkeypatch):
    """The catalogue with one file more."""
    (tmp_path / "magnet_offset.py").write_text(FILE)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    effects.__spec__.submodule_search_locations = effects.__path__
    catalogue.cache_clear(), plugins.parts.cache_clear()
    yield catalogue()
    monkeypatch.undo()
    effects.__spec__.submodule_search_locations = effects.__path__
    catalogue.cache_clear(), plugins.parts.cache_clear()
    sys.modules.pop("backends.effects.magnet_offset")


def start(name: str, specs) -> Simulator:
    return simulate(registry.load("backend", name), specs, 1)


def test_a_new_effect_is_drawn_simulated_and_named(added):
    """Draw it on an engine by default, and name it from the log where its twin is not known."""
    settings = draw.Settings(
        cases=200,
        reals=("mujoco",),
        modes=("single",),
        channels=(("position",),),
        rigs=("joint",),
        protocols=("steps", "push"),
    )
    cases = draw.draw(settings, 0)
    case = next(c for c in cases if c.faults[0].effect == NAME)
    log = make.real_log(case, start, make.case_rng(case, 0))
    kinds = {name: kind for name, kind in added.items() if name != "encoder-bias"}
    found = diagnose(log, nominal=rigs.nominal(case.rig), catalogue=kinds)
    assert found.verdict == (NAME,)
    assert not_looked_for({NAME: added[NAME]}) == ()


def test_a_plant_is_not_dealt_what_it_does_not_know(added):
    """Deal the new effect to engines alone: plants implement effects themselves."""
    settings = draw.Settings(cases=200, reals=("mujoco", "plant"), modes=("single",))
    cases = draw.draw(settings, 0)
    assert {c.real for c in cases if c.faults[0].effect == NAME} == {"mujoco"}


def test_a_new_effect_is_typed_and_documented(added, monkeypatch):
    """Read it on the command line, and write its section on its group's page."""
    spec = rigs.nominal("finger")
    (one,) = parse_effects(f"{NAME}=10deg@J0", spec.hand)
    assert one.on_spec(spec).hand.driven[0].joint.encoder.bias_rad == pytest.approx(
        0.1745, rel=1e-3
    )
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    from _pages import effects as pages

    page = pages.pages()["reference/effects/magnets.md"]
    assert f"## {NAME}\n\nThe encoder's magnet sits askew. Offset of the readings." in page
