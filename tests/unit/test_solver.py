"""The solver on whole logs of arms in plain MuJoCo, one per kind of answer."""

import json
from dataclasses import replace

import arms
import numpy as np
import pytest
from arms import HZ, KD, KP, LIMIT, Real, limbs_of, log_of, mjcf
from diagnosis_logs import arm_log

from diagnosis.logs.log import HandMechanism, LogError, make_log
from diagnosis.verdict.ordinary import ROBOTS
from diagnosis.walk import diagnose

KINDS = {
    "none": (Real(), ("none",)),
    "single": (Real(joints=2, kp={1: 0.6}), ("kp-scale",)),
    "pair": (Real(kp={0: 0.6}, coulomb_nm={0: 2.0}), ("coulomb-friction", "kp-scale")),
    "unknown": (Real(spring_nm_rad3=400.0), ("unknown",)),
}


@pytest.fixture(scope="module")
def results():
    """The answer to a log of every kind."""
    return {kind: diagnose(log_of(real)) for kind, (real, _) in KINDS.items()}


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_says_what_is_wrong(results, kind):
    """Name the effects of a log, none, or unknown."""
    assert tuple(sorted(results[kind].verdict)) == KINDS[kind][1]


def test_says_where_and_how_much(results):
    """Find a gain 40 % too low on the joint that has it, and no other."""
    (cause,) = results["single"].magnitudes
    assert (cause.joint, cause.unit) == ("J1", "%")
    assert cause.low < -40.0 < cause.high
    assert cause.value == pytest.approx(-40.0, abs=3.0)
    assert cause.share > 0.9


def test_is_plain_data_with_sentences(results):
    """Go to JSON; say shares, what is left and what is ordinary in words."""
    said = json.loads(json.dumps(results["single"].plain()))
    assert said["ordinary_from"] == "robot"
    (sentence,) = said["limbs"][0]["sentences"][:1]
    assert "kp-scale" in sentence and "% of the gap" in sentence and "ordinary" in sentence
    assert 0.0 < said["probability"] < 1.0


def test_says_the_same_again(results):
    """Give the same answer to the same log."""
    again = diagnose(log_of(KINDS["single"][0])).plain()
    first = results["single"].plain()
    assert {**again, "cpu_s": 0} == {**first, "cpu_s": 0}


def test_healthy_logs_say_what_is_ordinary():
    """Take what the healthy robot leaves as ordinary, and name a fault beside it."""
    result = diagnose(log_of(Real(kp={0: 0.7}), seed=1), [log_of(Real(), seed=2)])
    assert result.verdict == ("kp-scale",)
    assert result.ordinary_from == "healthy logs"
    assert result.ordinary == pytest.approx(1.2, abs=0.3)


def test_healthy_logs_make_a_guess_known():
    """Name a gain that a table of servos does not exclude, but a log of the healthy robot does."""
    guessed = Real(joints=2, kp={0: 0.8, 1: 0.8}, said_kp=f"{KP} +- 30%")
    today = log_of(replace(guessed, kp={0: 0.5, 1: 0.8}))
    assert diagnose(today).verdict == ("none",)
    result = diagnose(today, healthy=[log_of(guessed, seed=1)])
    (named,) = result.magnitudes
    assert (named.effect, named.joint) == ("kp-scale", "J0")
    assert named.low < -50.0 < named.high


def test_healthy_logs_say_what_drives_do():
    """Take an integral that no file says as the robot's own where its healthy log has it."""
    fine = Real(joints=2, integral_hz=4.0)
    result = diagnose(log_of(replace(fine, delay_s=0.03)), healthy=[log_of(fine, seed=1)])
    assert result.verdict == ("command-delay",) and result.ordinary < ROBOTS.floors
    assert result.magnitudes[0].value == pytest.approx(30.0, abs=2.0)
    assert "integral" in result.sentences[0]


@pytest.mark.parametrize(("kp", "verdict"), [({}, "none"), ({1: 0.7}, "kp-scale")])
def test_a_model_is_its_own_simulator(kp, verdict):
    """Take the step and integrator of its file for no fault, and name a gain beside them."""
    found = diagnose(log_of(Real(joints=2, kp=kp, option='timestep="0.005" integrator="Euler"')))
    assert found.verdict == (verdict,)
    (limb,) = found.limbs
    (own,) = [one for one in limb.nominal if one.effect == "simulator-steps"]
    assert own.value == pytest.approx(100.0, abs=1.0 if not kp else 40.0)
    assert kp or limb.gap_nominal < 0.5 < limb.gap_before


@pytest.mark.parametrize("armature_kgm2", [0.01, 0.3])
def test_an_inertia_that_no_file_has_is_no_fault(armature_kgm2):
    """Find what motors have that the model says nothing of, far from any guess."""
    found = diagnose(log_of(Real(joints=2, armature_kgm2=armature_kgm2)))
    assert found.verdict == ("none",)
    assert found.left < 1.0


@pytest.mark.parametrize(("armature_kgm2", "delay_s"), [(0.5, 0.05), (1.0, 0.06)])
def test_a_delay_is_no_inertia_that_no_file_has(armature_kgm2, delay_s):
    """Find how late commands are beside motors that are as slow, both far from any guess."""
    found = diagnose(log_of(Real(joints=2, armature_kgm2=armature_kgm2, delay_s=delay_s)))
    assert (found.verdict, found.joints) == (("command-delay",), ("J0", "J1"))
    assert found.limbs[0].causes[0].value == pytest.approx(1e3 * delay_s, rel=0.05)


@pytest.mark.parametrize("said_nm", [200.0, 600.0])
def test_a_limit_far_below_what_the_file_says(said_nm):
    """Find it where nothing asks for the torque between them."""
    found = diagnose(log_of(Real(limit_nm=20.0, said_nm=said_nm)))
    assert found.verdict == ("torque-limit",)
    assert found.limbs[0].causes[0].value == pytest.approx(100 * (20.0 / said_nm - 1.0), abs=2.0)


def test_numbers_that_are_off_together_hide_no_fault():
    """Name a gain that all nominal numbers could only hide together, or say that they hide some."""
    log = log_of(Real(joints=2, kp={1: 0.75}))
    found = diagnose(log)
    assert (found.verdict, found.joints) == (("kp-scale",), ("J1",))
    (limb,) = found.limbs
    assert limb.gap_nominal < limb.ordinary and limb.strain > 4.0
    assert "off than those of a healthy robot" in limb.sentences[0]
    (limb,) = diagnose(log, catalogue={}).limbs
    assert limb.verdict == ("none",)
    assert "nominal_uncertainty" in limb.sentences[1]


RUBS = {0: 1.0, 1: 1.5, 2: 0.8}
"""Dry friction of three joints, which their file does not say [Nm]."""


@pytest.mark.parametrize("kp", [{}, {1: 0.3}])
def test_friction_that_no_file_says_is_one_cause(kp):
    """Find it on all joints with its sizes; beside a larger cause it is a number of the file."""
    found = diagnose(log_of(Real(joints=3, kp=kp, coulomb_nm=RUBS)))
    sizes = {joint: row["drive.coulomb_nm"] for joint, row in found.corrected.items()}
    assert sizes == pytest.approx({f"J{j}": size for j, size in RUBS.items()}, rel=0.25)
    if not kp:
        assert found.verdict == ("coulomb-friction",) and len(found.joints) == 3
        return
    assert found.verdict == ("kp-scale",) and found.joints == ("J1",)
    assert {one.joint for one in found.nominal if one.effect == "coulomb-friction"} == {*sizes}


@pytest.mark.parametrize("joints", [(1,), (0, 1)])
def test_a_weak_motor_is_no_lower_gain(joints):
    """Name a motor, or all, that gives less than is asked of it: kp and kd are lower alike."""
    found = diagnose(log_of(Real(joints=2, weakness=dict.fromkeys(joints, 0.4))))
    assert found.verdict == ("weak-motor",) and found.joints == tuple(f"J{j}" for j in joints)
    assert found.magnitudes[0].value == pytest.approx(40.0, abs=4.0)


def test_a_joints_zero_is_no_load():
    """Name a zero that drive and sensor share, where a load leaves as little."""
    found = diagnose(log_of(Real(joints=2, zero_rad={1: 0.25})))
    assert found.verdict == ("joint-zero",) and found.joints == ("J1",)
    assert found.magnitudes[0].value == pytest.approx(np.degrees(0.25), rel=0.05)


def test_looks_for_nothing_in_an_empty_catalogue():
    """Say unknown where no effect may be named."""
    assert diagnose(log_of(KINDS["single"][0]), catalogue={}).verdict == ("unknown",)


def test_refuses_a_hand_without_its_nominal_world():
    """Ask for the nominal world of a hand known by name."""
    log = log_of(Real())
    hand = HandMechanism(hand="finger")
    meta = log.meta.model_copy(update={"mechanism": hand, "channels": {}})
    with pytest.raises(LogError, match="hand known by name"):
        diagnose(make_log(meta, log.samples))


def test_lost_packets_are_found_beside_the_verdict():
    """Say that every tenth packet was lost, and that nothing else is wrong."""
    result = diagnose(log_of(Real(lost_share=0.1)))
    assert result.verdict == ("command-dropout",)
    (finding,) = result.limbs[0].sensors
    assert finding.low < 10.0 < finding.high
    assert result.limbs[0].verdict == ("none",)


def test_packets_that_each_joint_loses_by_itself_are_found():
    """Say that each joint loses three of ten of its own packets."""
    result = diagnose(log_of(Real(joints=2, lost_share=0.3, alone=True)))
    (finding,) = result.limbs[0].sensors
    assert finding.effect == "command-dropout" and finding.joints == ("J0", "J1")
    assert finding.value == pytest.approx(30.0, abs=5.0)


def test_many_lost_packets_are_found_in_turns():
    """Say that four of ten packets were lost: losses and the fit find each other."""
    result = diagnose(log_of(Real(lost_share=0.4)))
    assert result.verdict == ("command-dropout",)
    (finding,) = result.limbs[0].sensors
    assert finding.value == pytest.approx(40.0, abs=8.0)


def changed(change):
    """The log of a healthy arm with its samples changed in place."""
    log = log_of(Real())
    samples = log.samples.copy()
    change(samples)
    return make_log(log.meta, samples, log.mjcf_xml)


def test_refuses_a_log_in_which_nothing_moves():
    """Say what is wrong with the log before any cause is sought."""
    with pytest.raises(LogError, match="nothing moves"):
        limbs_of(changed(lambda s: s.__setitem__("command_rad.J0", 0.1)))


def test_leaves_out_an_absurd_sample_and_a_torque_of_noise():
    """Note what of a log cannot be used, and judge by the rest."""
    noise = np.random.default_rng(0)

    def spoil(samples):
        samples.loc[700, "position_rad.J0"] = 40.0
        samples["torque_nm.J0"] = noise.standard_normal(len(samples))

    (limb,), notes = limbs_of(changed(spoil))
    assert limb.result.verdict == ("none",)
    assert len(notes) == 2
    assert "absurd" in notes[0] and "noise" in notes[1]


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (np.negative, "of the wrong sign"),
        (np.zeros_like, "the same"),
        (np.abs, "without its sign"),
    ],
)
def test_leaves_out_torques_that_cannot_be(read, said):
    """Note torques that oppose what drives ask, never change or have no sign; judge by the rest."""

    def spoil(samples):
        angle = samples["position_rad.J0"]
        speed = np.gradient(angle, 1.0 / HZ)
        drive = KP * (samples["command_rad.J0"] - angle) - KD * speed
        samples["torque_nm.J0"] = read(np.clip(drive, -LIMIT, LIMIT))

    result = diagnose(changed(spoil))
    assert result.verdict == ("none",)
    (note,) = result.notes
    assert said in note


def test_torques_of_late_commands_are_no_noise():
    """Keep torques that follow what the motion takes, where commands act late."""
    delay_s = 0.1
    log = log_of(Real(delay_s=delay_s))
    samples = log.samples.copy()
    angle = samples["position_rad.J0"]
    late = samples.groupby("episode")["command_rad.J0"].shift(round(delay_s * HZ)).bfill()
    drive = KP * (late - angle) - KD * np.gradient(angle, 1.0 / HZ)
    samples["torque_nm.J0"] = np.clip(drive, -LIMIT, LIMIT)
    _, notes = limbs_of(make_log(log.meta, samples, log.mjcf_xml))
    assert not [note for note in notes if "torque" in note]


def test_tells_its_progress_from_the_start():
    """Begin at nothing, never go back, and name what is fitted."""
    said = []
    diagnose(log_of(Real(kp={0: 0.6})), progress=lambda text, done: said.append((text, done)))
    done = [share for _, share in said]
    assert done[0] == 0.0 and done == sorted(done) and done[-1] == 1.0
    assert any("kp-scale on J0" in text for text, _ in said)


def thinned(log, every, protocols):
    """The log with one of so many samples, of these protocols alone."""
    kept = {e.episode for e in log.episodes if e.protocol in protocols}
    samples = log.samples[log.samples["episode"].isin(kept)]
    episodes = [e for e in log.meta.episodes if e.episode in kept]
    meta = log.meta.model_copy(update={"episodes": episodes})
    return make_log(meta, samples.iloc[::every].reset_index(drop=True), log.mjcf_xml)


def test_of_a_slow_log_only_rests_are_judged():
    """See at rests of a log of 10 Hz that a gain is low; refuse one without rests."""
    log = log_of(Real(kp={0: 0.4}))
    assert "kp-scale" in {c.effect for c in diagnose(thinned(log, 20, ("steps",))).limbs[0].leading}
    with pytest.raises(LogError, match="no target stands still"):
        diagnose(thinned(log, 20, ("multisine",)))


def test_a_large_uncertainty_is_no_fault():
    """Take a gain within three of the file's own deviations as ordinary, in finite numbers."""
    log = log_of(Real(kp={0: 0.6}))
    meta = log.meta.model_copy(update={"nominal_uncertainty": 0.2})
    result = diagnose(make_log(meta, log.samples, log.mjcf_xml))
    assert result.verdict == ("none",)
    assert np.isfinite([n.value for n in result.limbs[0].nominal]).all()


def test_a_gain_beyond_its_file_keeps_its_sign():
    """Stay positive and finite under a large uncertainty and a gain five times the file's."""
    log = log_of(Real(kp={0: 5.0}))
    meta = log.meta.model_copy(update={"nominal_uncertainty": 0.5})
    result = diagnose(make_log(meta, log.samples, log.mjcf_xml))
    assert all(np.isfinite([c.value, c.low, c.high]).all() for c in result.magnitudes)
    assert all(c.low > -100.0 for c in result.magnitudes if c.effect == "kp-scale")


def test_friction_may_be_more_than_a_sound_drive_asks_for(monkeypatch):
    """Find its size where small targets ask little of the nominal drive."""
    monkeypatch.setattr(arms, "PROTOCOLS", ("multisine",))
    (cause,) = diagnose(log_of(Real(coulomb_nm={0: 5.0}))).magnitudes
    assert cause.effect == "coulomb-friction"
    assert cause.low < 5.0 < cause.high
    assert cause.value == pytest.approx(5.0, rel=0.05)


def test_kinds_of_friction_at_a_joint_are_one_cause():
    """Name the dry friction of a joint once, with what else shapes its law beside it."""
    result = diagnose(log_of(Real(coulomb_nm={0: 4.0})))
    assert result.verdict == ("coulomb-friction",)
    assert len(result.magnitudes) == 1


def test_what_shapes_the_law_of_a_cause_is_said_with_its_size():
    """Say both of a dry friction that is larger in one direction."""
    found = diagnose(arm_log("coulomb-friction=40mNm@elbow,direction-friction=25mNm@elbow"))
    (cause,) = found.magnitudes
    (shape,) = cause.shape
    said = found.sentences[0]
    assert {cause.effect, shape.split(" of ")[0]} == {"coulomb-friction", "direction-friction"}
    for size, effect in ((40.0, "coulomb-friction"), (25.0, "direction-friction")):
        assert float(said.split(f"{effect} of ")[1].split()[0]) == pytest.approx(size, rel=0.1)


def test_the_same_gears_on_all_joints_are_one_cause():
    """Name the share of the load that gears of one kind lose, as what all joints have."""
    result = diagnose(arm_log("load-friction=40%@shoulder,load-friction=40%@elbow"))
    (found,) = result.limbs[0].causes
    assert (found.effect, found.joint) == ("load-friction", None)
    assert found.low < 40.0 < found.high


def test_a_delay_that_all_joints_share_is_no_joints_own():
    """Say all of it, and leave none to the littles that each joint may have."""
    found = diagnose(log_of(Real(joints=3, delay_s=0.012)))
    (delay,) = found.magnitudes
    assert delay.effect == "command-delay" and delay.value == pytest.approx(12.0, abs=0.2)
    late_s = [numbers["command.delay_s"] for numbers in found.corrected.values()]
    assert late_s == pytest.approx([delay.value / 1e3] * 3)


@pytest.mark.parametrize(
    ("coulomb_nm", "verdict"), [({}, "unknown"), ({1: 3.0}, "coulomb-friction")]
)
def test_an_integral_in_all_drives_is_no_weight_that_they_carry(coulomb_nm, verdict):
    """Ask for an integral that the file does not say, and name a fault beside it."""
    found = diagnose(log_of(Real(joints=2, integral_hz=1.5, coulomb_nm=coulomb_nm)))
    (limb,) = found.limbs
    assert found.verdict == (verdict,)
    assert "an integral in all drives" in limb.law and any(limb.law in x for x in found.sentences)
    assert float(limb.law.split("ki: ")[1].split(" kp")[0]) == pytest.approx(1.5, rel=0.2)
    assert [cause.joint for cause in found.magnitudes] == ["J1"] * len(coulomb_nm)


@pytest.mark.parametrize("joints", [1, 2])
def test_a_file_may_say_more_friction_than_there_is(joints):
    """Find a weak drive's gain where dry friction is a tenth less than the file says."""
    last = joints - 1
    log = log_of(Real(joints=joints, coulomb_nm={last: 1.8}, kp={last: 0.72}))
    log = make_log(log.meta, log.samples, mjcf(joints, {last: 2.0}))
    result = limbs_of(log)[0][0].result
    (cause,) = result.causes
    friction = next(one for one in result.nominal if one.effect == "coulomb-friction")
    assert (cause.effect, cause.joint) == ("kp-scale", f"J{last}")
    assert cause.value == pytest.approx(-28.0, abs=2.0)
    assert friction.value == pytest.approx(-200.0, abs=60.0)
