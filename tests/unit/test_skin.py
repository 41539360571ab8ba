"""Touch effects: found by geometry, apart from each other and from what geometry gets wrong."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from backends.effect import NumberEffect
from backends.shard import simulate
from backends.touch import taxel_grid
from benchmark.cli import app as cli
from benchmark.parts import registry
from benchmark.parts.registry import ROOT
from benchmark.settings.run_spec import RunSpec
from diagnosis.blind import rigs
from diagnosis.logs.log import Log, read_log
from diagnosis.motion.held import held
from diagnosis.recording.record import Plan, record
from diagnosis.skin.forward_model import Faults, Pressed, alone, expected
from diagnosis.skin.samples import samples
from diagnosis.skin.skin_faults import identify_skin_faults, search
from diagnosis.skin.taxel_fits import DEAD, DRIFT, Fitting
from diagnosis.verdict.probability import RIGHT, in_hand
from diagnosis.verdict.result import Report

CATALOGUE = {name: registry.load("effect", name) for name in registry.names("effect")}
NOMINAL = RunSpec(backend="mujoco", task="circle", effects="none").world()
MM = 1e-3
STICK_M, QUAT, JOINTS = ("stick_x", "stick_y", "stick_z"), "stick_q", "position_rad"
NOISE = rigs.NOISE_RAD


@cache
def log(effects: str, kind: str, protocol: str = "grasp", variants: int = 2) -> Log:
    """Grasps of the reference hand with effects; `kind` is touch or contact."""
    engine = registry.load("backend", "mujoco")
    spec = RunSpec(backend="mujoco", task="circle", effects=effects).world()
    channels = ("command", "position", "stick", kind)
    plan = Plan(protocols=(protocol,), channels=channels, variants=variants, seed=5)
    return record(lambda specs: simulate(engine, specs, 1), spec, plan, "test")


def tracked(clean: Log) -> Log:
    """The log with a tracker's noise on the stick and an encoder's on the joints."""
    rng, samples = np.random.default_rng(0), clean.samples.copy()
    for names, std in ((STICK_M, rigs.TRACKER_M), (QUAT, rigs.TRACKER_RAD / 2), (JOINTS, NOISE)):
        columns = [name for name in samples.columns if name.startswith(names)]
        samples[columns] += std * rng.normal(size=(len(samples), len(columns)))
    return replace(clean, samples=samples)


@cache
def skin_report(effects: str, kind: str) -> Report:
    """What the skin's diagnosis says of them."""
    return identify_skin_faults(log(effects, kind), NOMINAL, CATALOGUE)


def found(effects: str, kind: str) -> dict:
    return {one.effect: one for one in skin_report(effects, kind).causes}


@pytest.mark.slow
@pytest.mark.parametrize("shift_mm", [-0.1, 0.3])
def test_threshold(shift_mm):
    """Measure a threshold from yes and no within a finer step of the search."""
    (one,) = skin_report(f"taxel-threshold={shift_mm}mm", "contact").causes
    assert one.effect == "taxel-threshold"
    assert one.sizes[0] == pytest.approx(shift_mm * MM, abs=0.012 * MM)
    assert one.share > 0.9


@pytest.mark.parametrize(
    ("kind", "within"), [("touch", 0.06), pytest.param("contact", 0.2, marks=pytest.mark.slow)]
)
def test_drift(kind, within):
    """Measure the fastest drift: a uniform number's largest of hundreds, on a grid of 7 %."""
    (one,) = skin_report("taxel-drift=0.05mm/s", kind).causes
    assert one.effect == "taxel-drift"
    assert one.sizes[0] == pytest.approx(0.05 * MM, rel=within)


@pytest.mark.parametrize("kind", ["touch", pytest.param("contact", marks=pytest.mark.slow)])
def test_dead_taxels(kind):
    """Find dead taxels among those that should answer, and their share."""
    (one,) = skin_report("taxel-dropout=20%", kind).causes
    assert one.effect == "taxel-dropout"
    assert one.sizes[1] <= 0.2 <= one.sizes[2]


@pytest.mark.parametrize("effect", ["taxel-gain", "taxel-hysteresis"])
@pytest.mark.parametrize("share", [5, 50])
def test_depths_are_measured(effect, share):
    """Measure how far gains differ, and how much more an easing press reads."""
    (one,) = skin_report(f"{effect}={share}%", "touch").causes
    assert one.effect == effect
    assert one.sizes[0] == pytest.approx(share / 100, rel=0.05)
    assert one.sizes[1] <= share / 100 <= one.sizes[2]


def test_hysteresis_beside_gains():
    """Find both, each within a twentieth."""
    both = found("taxel-gain=20%,taxel-hysteresis=20%", "touch")
    assert {name: one.sizes[0] for name, one in both.items()} == pytest.approx(
        {"taxel-gain": 0.2, "taxel-hysteresis": 0.2}, rel=0.05
    )


@pytest.mark.parametrize("other", ["taxel-dropout=20%", "taxel-drift=0.05mm/s"])
def test_gains_beside_another_fault(other):
    """Find both, and the gains within a tenth."""
    both = found(f"taxel-gain=20%,{other}", "touch")
    assert set(both) == {"taxel-gain", other.split("=")[0]}
    assert both["taxel-gain"].sizes[0] == pytest.approx(0.2, rel=0.1)


def test_answers_say_nothing_of_gains():
    """Ask for depths where the log has yes and no."""
    said = skin_report("none", "contact").missing[0]
    assert said.startswith("taxel-gain, taxel-hysteresis: not identifiable") and "touch" in said


def test_confidence_is_what_former_findings_were_right():
    """Be as sure of a fault that is far ahead as former ones were right, else less."""
    (one,) = skin_report("taxel-dropout=20%", "touch").causes
    assert in_hand(one) == pytest.approx(RIGHT)
    tied = replace(one, tied=("taxel-drift",))
    assert in_hand(tied) == pytest.approx(RIGHT / 2)


@pytest.mark.slow
def test_halo():
    """Find a halo as far as the distances between taxels tell it."""
    report = skin_report("taxel-halo=5mm", "contact")
    (one,) = report.causes
    assert one.effect == "taxel-halo"
    assert one.sizes[1] <= 5 * MM <= one.sizes[2]
    assert max(spot.gap_after for spot in report.spots) < 0.1


@pytest.mark.slow
def test_two_at_once():
    """Find a higher threshold and dead taxels together."""
    both = found("taxel-threshold=0.3mm,taxel-dropout=15%", "contact")
    assert set(both) == {"taxel-threshold", "taxel-dropout"}
    assert both["taxel-threshold"].sizes[0] == pytest.approx(0.3 * MM, abs=0.02 * MM)
    assert both["taxel-dropout"].sizes[1] <= 0.15 <= both["taxel-dropout"].sizes[2]


@pytest.mark.slow
def test_who_hides_a_part_of_the_other_is_measured_with_it():
    """Measure a threshold and a halo, of which either alone is taken for another."""
    both = found("taxel-threshold=0.2mm,taxel-halo=10mm", "contact")
    assert set(both) == {"taxel-threshold", "taxel-halo"}
    assert both["taxel-threshold"].sizes[0] == pytest.approx(0.2 * MM, abs=0.02 * MM)
    assert both["taxel-halo"].sizes[1] <= 10 * MM <= both["taxel-halo"].sizes[2]


@pytest.mark.slow
def test_a_drift_is_measured_with_the_halo_that_it_spreads_by():
    """Measure both, of which a far faster drift alone explains almost as much."""
    both = found("taxel-drift=0.23mm/s,taxel-halo=8.2mm", "contact")
    assert set(both) == {"taxel-drift", "taxel-halo"}
    _, low, high = both["taxel-halo"].sizes
    assert low <= 8.2 * MM <= high
    assert both["taxel-drift"].sizes[0] == pytest.approx(0.23 * MM, rel=0.25)


@pytest.mark.slow
def test_a_drift_is_as_sharp_at_any_threshold():
    """Measure drift and threshold together: what nothing presses tells but their ratio."""
    both = found("taxel-drift=0.2mm/s,taxel-threshold=0.2mm", "contact")
    assert set(both) == {"taxel-drift", "taxel-threshold"}
    assert both["taxel-threshold"].sizes[0] == pytest.approx(0.2 * MM, abs=0.02 * MM)
    assert both["taxel-drift"].sizes[0] == pytest.approx(0.2 * MM, rel=0.1)


@pytest.mark.slow
def test_a_drift_is_as_fast_where_taxels_are_dead():
    """Measure the drift: who never answered is slow or dead, which makes the others no slower."""
    both = found("taxel-drift=0.1mm/s,taxel-dropout=23%", "contact")
    assert set(both) == {"taxel-drift", "taxel-dropout"}
    _, low, high = both["taxel-drift"].sizes
    assert low <= 0.1 * MM <= high


def test_a_lone_fault_explains_what_seems_an_offset():
    """Fit a drift to the nominal skin too, where a threshold within the error was put first."""
    parts = held(log("taxel-drift=0.05mm/s", "contact"), NOMINAL)
    grid = np.stack([taxel_grid(t, NOMINAL.hand.taxels)[0] for t in NOMINAL.hand.fingertips])
    data, start, _ = samples(NOMINAL, parts, binary=True)
    fitting = Fitting(data, grid)
    offset = replace(start, threshold_m=-0.03 * MM)
    _, found = search(fitting, [offset, start], [DRIFT])
    assert found.skin.threshold_m == start.threshold_m


def test_a_further_fault_needs_a_gap_of_its_own():
    """Name dead taxels alone where a drift that is none fits nothing."""
    parts = held(log("taxel-dropout=20%", "contact"), NOMINAL)
    grid = np.stack([taxel_grid(t, NOMINAL.hand.taxels)[0] for t in NOMINAL.hand.fingertips])
    data, skin, _ = samples(NOMINAL, parts, binary=True)
    _, found = search(Fitting(data, grid), [skin], [DEAD, DRIFT])
    assert found.names == (DEAD,) and found.tied == () and not found.is_unknown


def _answers(depth_mm: float, time_s: float, **faults) -> float:
    """The chance that a taxel answers which is pressed so deep, known to 0.04 mm."""
    one = np.ones((1, 1, 1))
    data = Pressed(
        time_s=np.array([time_s]),
        depth_m=depth_mm * MM * one,
        reading=one,
        touched=np.ones((1, 1), dtype=bool),
        binary=True,
    )
    return float(expected(data, Faults(blur_m=0.04 * MM, **faults))[0, 0, 0])


def test_what_drifts_is_blurred_where_the_stick_presses_it_alone():
    """Expect answers of what nothing presses once its drift reaches 0.2 mm, and not before."""
    drift = {"slope_m_s": np.array(0.1 * MM)}
    assert _answers(-0.12, 1.9, **drift) < 0.01
    assert _answers(-0.12, 2.1, **drift) > 0.99
    assert _answers(0.01, 1.9, **drift) == pytest.approx(0.5, abs=0.01)
    assert _answers(-0.12, 0.0, threshold_m=-0.18 * MM) < 0.01


def test_who_is_silent_elsewhere_was_taken_along():
    """Take a taxel for none that drifts where it is silent as late in another episode."""
    data = Pressed(
        time_s=np.array([1.0, 1.0, 2.0]),
        depth_m=np.full((3, 1, 2), -MM),
        reading=np.array([[[1.0, 1.0]], [[0.0, 0.0]], [[1.0, 1.0]]]),
        touched=np.ones((3, 1), dtype=bool),
        binary=True,
    )
    own = alone(data, Faults(blur_m=0.04 * MM), np.ones((1, 2, 2), dtype=bool)).reading
    assert own[:, 0].tolist() == [[0, 0], [0, 0], [1, 1]]


@pytest.mark.parametrize(
    ("effects", "kind"),
    [
        ("none", "touch"),
        pytest.param("none", "contact", marks=pytest.mark.slow),
        pytest.param("encoder-noise=0.7mrad", "touch", marks=pytest.mark.slow),
        ("encoder-noise=0.7mrad", "contact"),
        ("stick-radius=10%", "touch"),
        pytest.param("contact-softness=0.3mm/N", "contact", marks=pytest.mark.slow),
        ("backlash=1deg", "contact"),
    ],
)
def test_other_effects_are_not_the_skin(effects, kind):
    """Accuse no taxel of what is wrong with joints, stick or contact."""
    assert skin_report(effects, kind).causes == ()


@pytest.mark.parametrize("kind", ["touch", pytest.param("contact", marks=pytest.mark.slow)])
def test_a_misplaced_finger_tells_nothing(kind):
    """Ask for the joint's zero to be mended before its taxels are judged."""
    report = skin_report("encoder-bias=1deg@J3", kind)
    assert report.causes == ()
    text = " ".join(report.missing)
    assert "finger2" in text
    assert "joints' zero" in text


def test_depths_say_nothing_of_thresholds():
    """Ask for contacts where the log has depths, which thresholds and halos do not change."""
    for effects in ("taxel-threshold=0.3mm", "taxel-halo=5mm"):
        report = skin_report(effects, "touch")
        assert report.causes == ()
        assert "taxel-threshold, taxel-halo: not identifiable from this log" in report.missing[0]
        assert "contact" in report.missing[0]


def test_no_grasp_no_touch():
    """Ask for the grasp protocol where no stick is held."""
    free = log("taxel-dropout=50%", "touch", protocol="steps", variants=1)
    report = identify_skin_faults(free, NOMINAL, CATALOGUE)
    assert report.causes == ()
    assert "record --protocol grasp" in report.missing[0]


def test_a_finger_that_lets_go_accuses_nobody(tmp_path):
    """Find nothing wrong with a good skin while a policy lifts fingers off the stick and back."""
    policy = min((ROOT / "leaderboard/policies").glob("mujoco-circle-*-s0-*"))
    made = ["record", "--backend", "mujoco", "--policy", str(policy), "--protocol", "policy"]
    options = ["--channels", "touch,stick", "--workers", "1", "--out", str(tmp_path / "log")]
    assert cli.call([*made, *options]) == 0
    playing = read_log(tmp_path / "log")
    readings = held(playing, NOMINAL)[0].touch
    assert not readings.any(axis=2).all()
    assert identify_skin_faults(playing, NOMINAL, CATALOGUE).causes == ()


def test_what_is_nominal_is_no_finding():
    """Find nothing where the nominal skin has the fault."""
    effects = "taxel-threshold=0.3mm"
    known = RunSpec(backend="mujoco", task="circle", effects=effects).world()
    assert identify_skin_faults(log(effects, "contact"), known, CATALOGUE).causes == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    "effects", ["taxel-halo=5mm", "taxel-dropout=20%", "taxel-threshold=-0.1mm"]
)
def test_effects_out_of_the_catalogue_are_unknown(effects):
    """Answer unknown where the fault is not in the catalogue, though others could imitate it."""
    without = {k: v for k, v in CATALOGUE.items() if k != effects.split("=")[0]}
    report = identify_skin_faults(log(effects, "contact"), NOMINAL, without)
    assert [one.effect for one in report.causes] == ["unknown"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shift_mm", "mended", "named"),
    [
        (-0.038, False, True),
        (-0.038, True, False),
        (0.053, True, False),
        (-0.08, True, True),
        (-0.015, False, False),
    ],
)
def test_a_small_threshold_shows_where_the_stick_is_as_given(shift_mm, mended, named):
    """Name a threshold within a sample's blur, unless the log says how thick the stick is."""
    noisy = tracked(log(f"taxel-threshold={shift_mm}mm", "contact"))
    found = [one.effect for one in identify_skin_faults(noisy, NOMINAL, CATALOGUE, mended).causes]
    assert found == ["taxel-threshold"] * named


def test_a_finger_that_presses_a_little_deeper_is_no_fault_of_its_skin():
    """Find nothing wrong with a skin where the stick is thicker by a share that nothing shows."""
    assert skin_report("stick-radius=0.3%", "touch").causes == ()


@pytest.mark.slow
def test_a_drift_that_could_be_faster_still_is_unknown():
    """Name no drift as fast as there is: a lower threshold drifts taxels over it at once."""
    both = found("taxel-threshold=-0.18mm,taxel-drift=0.2mm/s", "contact")
    assert set(both) == {"unknown"}


def test_a_fault_that_no_model_has_is_not_ignored():
    """Say of an effect on taxels that the model of a skin lacks that it is not looked for."""

    class Widened(NumberEffect):
        group, dimension, unit = "touch", "length", "mm"
        bounds, number, per_joint = (0.0, 1e-3), "taxels.reach_m", False

    report = identify_skin_faults(log("none", "contact"), NOMINAL, {"taxel-reach": Widened})
    assert report.causes == () and report.missing[0].startswith("taxel-reach: not looked for")


def test_a_fault_is_known_by_the_number_that_it_changes():
    """Name a threshold by the name that the catalogue gives it, whatever that is, and its size."""
    other = {"deaf-skin": CATALOGUE["taxel-threshold"]}
    (one,) = identify_skin_faults(log("taxel-threshold=0.3mm", "contact"), NOMINAL, other).causes
    assert one.effect == "deaf-skin"
    assert one.sizes[0] == pytest.approx(0.3 * MM, abs=0.012 * MM)
