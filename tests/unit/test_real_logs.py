"""What a diagnosis says of recordings on real hardware whose cause their authors documented.

The nominal mechanisms have masses and gains, and none of what is to be found. Nothing is set per
log.
"""

from pathlib import Path

import numpy as np
import pytest

from backends.effect import Effect
from backends.shard import simulate
from benchmark import registry
from diagnosis.attribution.attribute import Attribution
from diagnosis.attribution.conditions import join
from diagnosis.attribution.gather import gather
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import UNKNOWN, LimbVerdict
from diagnosis.beside.lost_motion import lost_motion
from diagnosis.calibration.backlash import Play, push_test
from diagnosis.calibration.worlds import motions
from diagnosis.diagnose import Diagnosis, diagnose
from diagnosis.leading import leading
from diagnosis.logs.log import Log, LogError
from diagnosis.replay.nominal import mjcf_world, own_catalogue
from diagnosis.triage.triage import faults

REAL = Path(__file__).resolve().parents[3] / "shared/real_logs"
FOLDERS = {"emps": "emps", "bam": "bam_xl330", "play-test": "robonine"}
COUNT_RAD = 2 * np.pi / 4096
EMPS_COULOMB_N, EMPS_VISCOUS_NS_M = 20.3935, 203.5034
"""Identified by the authors of EMPS."""
PLAY_COUNTS = {"motor_telemetry_single": (7.03, 14.78), "motor_telemetry_nocomp2": (5.33, 7.67)}
"""Play measured by the authors of the play test: unloaded and loaded, of the worse servo."""
FRICTIONS = ("coulomb-friction", "viscous-friction", "stiction", "load-friction")
AT_REST = ("encoder-resolution", "backlash", "dead-zone", "coulomb-friction", "kp-scale")
RIVALS = (*FRICTIONS, "command-delay", "encoder-scale", "kp-scale", "link-mass")


def logs(kind: str) -> dict[str, Log]:
    path = REAL / FOLDERS[kind]
    if not path.is_dir():
        pytest.skip(f"no real recordings at {path}")
    return registry.load("importer", kind)().read(path)


def catalogue() -> dict[str, type[Effect]]:
    return {name: registry.load("effect", name) for name in registry.names("effect")}


def floor() -> dict[str, float]:
    rule = rules()
    return {
        "position": rule.floor_position_rad,
        "motor": rule.floor_position_rad,
        "torque": rule.floor_torque_share,
    }


def diagnosed(log: Log) -> Diagnosis:
    world = mjcf_world(log)
    return diagnose(log, world, own_catalogue(catalogue(), world))


@pytest.mark.parametrize("kind", FOLDERS)
def test_recordings_have_no_bugs(kind):
    """Find no bug in what was recorded with care, whatever physics is missing in the nominal."""
    for log in logs(kind).values():
        assert faults(log, mjcf_world(log)) == ()


@pytest.fixture(scope="module")
def emps() -> Diagnosis:
    (log,) = logs("emps").values()
    return diagnosed(log)


def test_emps_is_friction(emps):
    """Name friction of the axis, and refuse a delay; both kinds lead what was tried alone."""
    assert set(emps.verdict) <= set(FRICTIONS) and emps.joints == ("axis",)
    singles = [row["effects"][0] for row in emps.ranking if len(row["effects"]) == 1]
    assert set(singles[:2]) == {"coulomb-friction", "viscous-friction"}
    assert emps.shrinkage.interval[0] > 0.9 > 0.1 > emps.shrinkage_nominal.value


def test_emps_is_coulomb_and_viscous_friction(emps):
    """Name both frictions, each within 5 % of what the authors identified."""
    assert set(emps.verdict) == {"coulomb-friction", "viscous-friction"}
    coulomb, viscous = (
        next(m.value for m in emps.magnitudes if m.effect == name) * 1e-3
        for name in ("coulomb-friction", "viscous-friction")
    )
    assert coulomb == pytest.approx(EMPS_COULOMB_N, rel=0.05)
    assert viscous == pytest.approx(EMPS_VISCOUS_NS_M, rel=0.05)


def test_emps_intervals_hold_what_the_authors_identified(emps):
    """Hold the authors' values in 90 % intervals that are narrower than a quarter of them."""
    truth = {"coulomb-friction": EMPS_COULOMB_N, "viscous-friction": EMPS_VISCOUS_NS_M}
    for found in emps.magnitudes:
        low, high = (1e-3 * end for end in found.interval)
        assert low < truth[found.effect] < high
        assert high - low < 0.25 * truth[found.effect]


def test_bam_is_load_dependent_friction():
    """Rank load-dependent friction first on a gain that none was fitted on: that of 400.

    It leads, and takes most of the gap there, also where what it leaves is too much for a verdict.
    """
    every = logs("bam")
    worlds = {name: mjcf_world(log) for name, log in every.items()}
    parts = [gather(log, worlds[name], floor())[0] for name, log in every.items()]
    evidence = join(parts, [list(every).index("kp400")])
    kinds = {name: kind for name, kind in catalogue().items() if name in RIVALS}
    uncertainty = every["kp400"].meta.nominal_uncertainty
    found = Attribution(evidence, own_catalogue(kinds, worlds["kp400"]), uncertainty)
    by_cost, by_gap = (
        sorted(found.singles, key=key)
        for key in (lambda one: one.fit.cost, lambda one: float(one.plain.mean()))
    )
    assert by_cost[0].names == by_gap[0].names == ("load-friction",)
    assert by_gap[0].plain.mean() < 0.5 * by_gap[1].plain.mean()
    best = found.singles[0]
    strange = LimbVerdict(
        names=(UNKNOWN,), chosen=best, attribution=found, tied=(), lead_nats=best.surprise
    )
    (nearest,) = leading([strange])
    assert nearest.effect == "load-friction" and nearest.share.interval[0] > 0.5


def played(log: Log) -> list[Play]:
    world = mjcf_world(log)
    pushes = motions(log, world.hand.joint_names, world.timing.drive_s, ("push",))
    engine = registry.load("backend", "mujoco")
    plays = push_test(lambda specs: simulate(engine, specs, 1), world, pushes).values()
    assert all(isinstance(play, Play) for play in plays)
    return [play for play in plays if isinstance(play, Play)]


def test_play_tests_show_play():
    """Find play by the push test, within a count of between the authors' unloaded and loaded."""
    found = logs("play-test")
    for name in PLAY_COUNTS:
        plays = played(found[name])
        assert all(play.has_play for play in plays)
        worst = max(2 * play.mean_rad for play in plays) / COUNT_RAD
        unloaded, loaded = PLAY_COUNTS[name]
        assert unloaded - 1 < worst < loaded + 1


@pytest.mark.parametrize("name", PLAY_COUNTS)
def test_play_tests_are_diagnosed_as_backlash(name):
    """Name backlash of every servo, of a size between what friction and drive may have added.

    The authors' numbers are how far apart a servo rests after pulls to either side, released and
    loaded: the lost motion, within a count. Play itself is nothing they could measure.
    """
    log = logs("play-test")[name]
    world = mjcf_world(log)
    found = diagnose(log, world, {n: own_catalogue(catalogue(), world)[n] for n in AT_REST})
    assert set(found.verdict) == {"encoder-resolution", "backlash"}
    assert found.joints == log.joints
    assert all("dead-zone" in row["effects"] for row in found.indistinguishable)
    assert any("only its rests" in text for text in found.missing)
    lost = [one for part in gather(log, world, floor()) if (one := lost_motion(part, 0))]
    assert len(lost) == len(log.joints)
    unloaded, loaded = PLAY_COUNTS[name]
    assert max(one.released_rad for one in lost) / COUNT_RAD == pytest.approx(unloaded, abs=1)
    assert max(one.pushed_rad for one in lost) / COUNT_RAD == pytest.approx(loaded, abs=1)
    plays = [one for one in found.magnitudes if one.effect == "backlash"]
    for play in plays:
        low, high = (2 * np.radians(end) / COUNT_RAD for end in play.interval)
        assert low < unloaded < high


def test_conditions_are_of_one_mechanism():
    """Refuse to judge on all settings, on none, or with other joints."""
    (emps,), bam = logs("emps").values(), list(logs("bam").values())[:2]
    parts = [gather(log, mjcf_world(log), floor())[0] for log in (*bam, emps)]
    for judging in ([], [0, 1]):
        with pytest.raises(LogError, match="of 2 settings would judge"):
            join(parts[:2], judging)
    with pytest.raises(LogError, match="different joints"):
        join(parts[1:], [0])
