"""Joints, sensors, touch and stick in one diagnosis: what it names and shows."""

import json
from functools import cache

import pytest
from arms import Real, log_of
from diagnosis_logs import with_short_grasps

from backends.effect import NumberEffect
from backends.shard import simulate
from benchmark.gap._diagnosis_texts import effects_text
from benchmark.parts import registry
from benchmark.settings.effects import read_effects
from benchmark.settings.run_spec import RunSpec
from diagnosis import Diagnosis, diagnose, page
from diagnosis.grasp.in_hand import stick_report
from diagnosis.logs.log import Log
from diagnosis.recording.record import Plan, record

FEW = (
    "coulomb-friction",
    "command-delay",
    "command-dropout",
    "encoder-noise",
    "encoder-resolution",
)
HELD = ("stick-radius", "contact-softness", "taxel-threshold", "taxel-dropout")
CATALOGUE = {name: registry.load("effect", name) for name in (*FEW, *HELD)}
NOMINAL = RunSpec(backend="mujoco", task="circle", effects="none").world()


def on(backend: str):
    engine = registry.load("backend", backend)
    return lambda specs: simulate(engine, specs, 1)


@cache
def log(
    effects: str,
    backend: str = "mujoco",
    protocols: tuple[str, ...] = ("steps",),
    variants: int = 1,
) -> Log:
    """A log of the hand with effects on an engine."""
    plan = Plan(
        protocols=protocols,
        variants=variants,
        channels=("command", "position", "push", "stick", "contact", "pull"),
        seed=4,
    )
    spec = RunSpec(backend=backend, task="circle", effects=effects).world()
    return with_short_grasps(record(on(backend), spec, plan, "test"))


@cache
def diagnosed(effects: str, backend: str, protocols: tuple[str, ...]) -> Diagnosis:
    """Its diagnosis against MuJoCo."""
    real = log(effects, backend, protocols)
    return diagnose(real, nominal=NOMINAL, catalogue=CATALOGUE, simulate=on("mujoco"))


@pytest.fixture(scope="module")
def held() -> Diagnosis:
    """Of a log on another engine with a thick stick, deaf taxels and friction."""
    effects = "coulomb-friction=60mNm@J3,stick-radius=10%,taxel-threshold=0.3mm"
    return diagnosed(effects, "bullet", ("steps", "grasp"))


def test_joints_touch_and_stick_together(held):
    """Name an effect of each, with its size."""
    assert set(held.verdict) == {"coulomb-friction", "stick-radius", "taxel-threshold"}
    assert held.joints == ("J3",)
    sizes = {m.effect: m for m in held.magnitudes}
    assert sizes["stick-radius"].low <= 10 <= sizes["stick-radius"].high
    assert sizes["taxel-threshold"].value == pytest.approx(0.3, abs=0.03)
    text = " ".join(held.sentences)
    assert "taxel-threshold" in text and "coulomb-friction of" in text


@pytest.mark.slow
def test_pulls_are_replayed_with_refitted_drives():
    """Measure a heavy stick although gains are off, which free air tells to 3 %, by 4 %."""
    real = log("kp-scale=4%,stick-mass=100%", "mujoco", ("multisine", "grasp", "pull"), 2)
    few = {name: registry.load("effect", name) for name in (*FEW, "stick-mass")}
    found = diagnose(real, nominal=NOMINAL, catalogue=few, simulate=on("mujoco"))
    assert found.verdict == ("stick-mass",)
    (stick,) = found.magnitudes
    assert stick.low < 100 < stick.high < 200


@pytest.mark.slow
def test_play_that_is_known_and_rattles_hides_no_friction():
    """Name friction on a hand with known play, and nothing on its other fingers.

    After a while no simulation follows a joint that rattles in its play, not even the same one.
    """
    built = RunSpec(backend="mujoco", task="circle", effects="built").world()
    real = log("built,coulomb-friction=60mNm@J3", protocols=("steps", "triangle", "push"))
    found = diagnose(real, nominal=built, catalogue=CATALOGUE)
    assert found.verdict == ("coulomb-friction",) and found.joints == ("J3",)
    assert found.magnitudes[0].value == pytest.approx(60, rel=0.15)


def test_the_corrected_world_can_be_written(held):
    """Write effects for the command line that hold all three."""
    text = effects_text(read_effects("none", NOMINAL.hand), held.magnitudes, NOMINAL, CATALOGUE)
    assert {item.split("=")[0] for item in text.split(",")} == set(held.verdict)


def test_touch_and_stick_are_plain_data(held):
    """Give causes with what says so and fingers as JSON, and be the same when read again."""
    row = json.loads(json.dumps(held.plain(), allow_nan=False))
    assert Diagnosis.of(row) == held
    shown = {one["effect"]: one["evidence"] for one in row["magnitudes"]}
    assert not shown["coulomb-friction"] and "mm of press on" in shown["taxel-threshold"]
    places = {(spot["finger"], spot["family"]) for spot in row["spots"]}
    assert places == {(f"finger{k}", f) for k in (1, 2, 3) for f in ("touch", "stick")}
    assert all(s["gap_after"] < s["gap_before"] for s in row["spots"] if s["family"] == "stick")


def test_the_page_shows_them(held):
    """Show causes with what says so, fingers, and episodes that were used."""
    effects = "coulomb-friction=60mNm@J3,stick-radius=10%,taxel-threshold=0.3mm"
    shown = log(effects, "bullet", ("steps", "grasp", "pull"))
    text = page(held, shown, {"log": "x"}, {})
    used = ("used for touch and stick", "used for friction and mass")
    for said in ("Touch and stick", "finger2", "mm of press on", *used):
        assert said in text


def test_coarse_encoders_are_named():
    """Name the steps of encoders and no other cause for the gap that they leave."""
    found = diagnosed("encoder-resolution=0.3deg", "mujoco", ("steps",))
    assert found.verdict == ("encoder-resolution",)
    assert found.magnitudes[0].value == pytest.approx(0.3, abs=1e-3)


def test_steps_under_the_floor_are_nothing():
    """Say none of encoder steps that are less than the model's own error."""
    assert diagnosed("encoder-resolution=0.02deg", "mujoco", ("steps",)).verdict == ("none",)


class Foreign(NumberEffect):
    """An effect on a number that nothing here replays or measures."""

    group, number, dimension, unit, bounds = "drive", "drive.new_number", "share", "%", (0.0, 1.0)
    least = 0.1


def test_an_unknown_gap_is_located_and_the_catalogue_covered():
    """Say where a spring that no effect is leaves its gap, and what nothing looks for."""
    found = diagnose(
        log_of(Real(spring_nm_rad3=900.0)), catalogue={**CATALOGUE, "foreign": Foreign}
    )
    assert found.verdict == ("unknown",)
    assert any("largest part of the gap" in text and "of J0" in text for text in found.sentences)
    assert found.missing[0].startswith("foreign: not looked for")


def test_a_free_log_asks_for_a_grasp():
    """Say what to record for touch and stick where nothing was held."""
    missing = " ".join(diagnosed("encoder-resolution=0.02deg", "mujoco", ("steps",)).missing)
    assert "taxel-threshold" in missing and "stick-radius" in missing
    assert "record --protocol grasp" in missing


def test_a_free_log_asks_to_pull_for_friction():
    """Ask for pulls where an effect shows in motion alone, for grasps elsewhere."""
    sought = {name: registry.load("effect", name) for name in ("stick-radius", "contact-friction")}
    radius, friction = stick_report(log("none"), NOMINAL, sought, on("mujoco")).missing
    assert radius.startswith("stick-radius") and "grasp with the channel stick" in radius
    assert friction.startswith("contact-friction") and "grasp,pull --variants 2" in friction
