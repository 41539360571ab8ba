"""Random effects: found where they are, told apart from what replays explain, silent elsewhere."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from backends.noise import uniform
from backends.shard import simulate
from backends.spec import Spec
from benchmark import registry
from benchmark.run_spec import RunSpec
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.fit import Fitter
from diagnosis.attribution.gather import gather
from diagnosis.beside.fingerprints import comb, sensors, white_noise, widened
from diagnosis.beside.hearing import hear
from diagnosis.beside.losses import dropouts
from diagnosis.beside.packets import decisive
from diagnosis.recording.record import Plan, record
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.replay import replay

CATALOGUE = {name: registry.load("effect", name) for name in registry.names("effect")}
FLOOR = {"position": 3e-4, "motor": 3e-4, "torque": 5e-3}
SEED = 3
REAL = Path(__file__).resolve().parents[3] / "shared/real_logs/bam_xl330"
FREE = ("steps", "multisine")
MRAD, DEG = 1e-3, np.pi / 180


def world(effects: str) -> Spec:
    """The reference hand with effects."""
    return RunSpec(backend="mujoco", task="circle", effects=effects).world()


@cache
def parts(
    effects: str,
    nominal: str = "none",
    channels: str = "command,position,push",
    protocols: tuple[str, ...] = FREE,
) -> tuple[Evidence, ...]:
    """Evidence of a recording in the reference hand with effects, by a nominal world."""
    engine = registry.load("backend", "mujoco")
    plan = Plan(protocols=protocols, channels=tuple(channels.split(",")), seed=SEED)
    log = record(lambda specs: simulate(engine, specs, 1), world(effects), plan, "test")
    return gather(log, world(nominal), FLOOR)


def names(found) -> list[str]:
    return [one.effect for one in found]


@pytest.mark.parametrize("offset", [0.0, 0.4321])
@pytest.mark.parametrize("step", [2e-5, 1.5e-3, 0.05])
def test_a_comb_is_found_at_any_offset(step, offset):
    """Measure the step of rounded readings within its interval."""
    angle = np.sin(np.linspace(0, 20, 4000)) * max(0.3, 8 * step)
    found = comb(offset + step * np.round(angle / step))
    assert found is not None
    assert abs(found.step_rad - step) <= found.half_width_rad


def test_smooth_readings_have_no_comb():
    """Find no comb in a smooth motion, in noise, or where nothing moves."""
    rng = np.random.default_rng(0)
    smooth = np.sin(np.linspace(0, 20, 4000))
    for readings in (smooth, rng.normal(size=4000), np.zeros(4000), np.repeat([0.0, 0.1], 2000)):
        assert comb(readings) is None


def test_white_noise_is_measured_beside_motion():
    """Measure noise under a smooth motion within four standard errors; find none without it."""
    rng, std, t = np.random.default_rng(1), 5e-4, np.linspace(0, 10, 2000)
    motion = 0.2 * np.sin(2 * np.pi * t)
    found = white_noise([motion + rng.normal(0, std, t.shape)], 0.0)
    assert found is not None
    # A quarter of the windows tells as much as 83 / 4 windows of 9 degrees of freedom.
    assert found.std_rad == pytest.approx(std, rel=4 / np.sqrt(2 * 9 * 83 / 4))
    assert white_noise([motion], 0.0) is None


@pytest.mark.parametrize("backlash", ["", "backlash=1.5deg,"])
def test_noise_of_one_joint(backlash):
    """Name noise on the joint that has it alone, with its size, whatever else moves."""
    found = sensors(parts(f"{backlash}encoder-noise=0.5mrad@J4"), CATALOGUE)
    assert [(f.effect, f.joint) for f in found] == [("encoder-noise", "J4")]
    assert found[0].value == pytest.approx(0.5 * MRAD, rel=0.1)


def test_noise_that_nothing_explains_is_unknown():
    """Say unknown where readings are noisier than the sensor's and no effect may be the cause."""
    known = {n: kind for n, kind in CATALOGUE.items() if n != "encoder-noise"}
    found = sensors(parts("encoder-noise=1mrad@J4"), known)
    assert [(f.effect, f.joints) for f in found] == [("unknown", ("J4",))]
    assert sensors(parts("encoder-noise=1mrad", "encoder-noise=1mrad"), known) == ()
    everywhere = sensors(parts("encoder-noise=1mrad"), known)
    assert [(f.effect, f.joint, len(f.joints)) for f in everywhere] == [("unknown", None, 6)]


def test_small_steps_that_nothing_explains_are_unknown():
    """Hear steps of 1.7 mrad under noise of 0.5 mrad, where no effect may be the cause."""
    known = {n: k for n, k in CATALOGUE.items() if n not in ("encoder-noise", "encoder-resolution")}
    logs = "encoder-noise=0.5mrad,encoder-resolution=0.1deg@J4", "encoder-noise=0.5mrad"
    assert [(f.effect, f.joints) for f in sensors(parts(*logs), known)] == [("unknown", ("J4",))]


def test_resolution_with_noise_under_it():
    """Name the steps of all encoders, and the noise that is larger than half a step."""
    found = {
        f.effect: f
        for f in sensors(parts("encoder-noise=1mrad,encoder-resolution=0.05deg"), CATALOGUE)
    }
    step = found["encoder-resolution"]
    assert step.joint is None
    assert len(step.joints) == 6
    assert step.interval[0] <= 0.05 * DEG <= step.interval[1]
    assert found["encoder-noise"].value == pytest.approx(MRAD, rel=0.1)


def test_steps_are_allowed_for():
    """Explain the gap that a coarse encoder leaves, and widen the evidence by it."""
    coarse = parts("encoder-resolution=1deg")
    found = sensors(coarse, CATALOGUE)
    assert found[0].gap_before > 10
    # Uniform errors of a step have its square over 12; half as much again for an uneven motion.
    assert found[0].gap_after < 1.5
    assert widened(coarse[0], found).sigma[0].min() >= DEG / np.sqrt(12)


def test_what_is_nominal_is_no_finding():
    """Find nothing where the nominal world has the sensor's errors."""
    known = "encoder-noise=0.5mrad,encoder-resolution=0.02deg"
    assert sensors(parts(known, known), CATALOGUE) == ()


@pytest.mark.parametrize(
    "effects",
    [
        "none",
        "command-delay=4ms",
        "command-rate-limit=0.3s/rad",
        "backlash=1.5deg",
        "stiction=30mNm",
        "torque-limit=-60%",
    ],
)
def test_other_effects_are_not_random(effects):
    """Accuse no random effect of what others do, even in a nominal world without them."""
    seen = parts(effects, protocols=("steps",))
    assert sensors(seen, CATALOGUE) == ()
    assert dropouts(seen) == ((), seen)


@pytest.mark.slow
def test_noise_hides_no_delay_behind_losses():
    """Take no noisy delay for lost packets."""
    assert dropouts(parts("command-delay=7ms,encoder-noise=0.7mrad"))[0] == ()


@pytest.mark.parametrize("noise", [",encoder-noise=0.7mrad", ",kp-scale=4%"])
def test_lost_packets_of_all_joints(noise):
    """Find lost packets from positions alone, and their share."""
    (found,), _ = dropouts(parts(f"command-dropout=10%{noise}"))
    assert (found.effect, found.joint) == ("command-dropout", None)
    assert found.interval[0] * 0.9 <= 0.1 <= found.interval[1] * 1.1
    assert found.gap_after < found.gap_before


def test_lost_packets_of_one_joint():
    """Name the joint whose packets are lost."""
    told = parts("command-dropout=10%@J3", channels="command,position,torque,push")
    (found,), heard = dropouts(told)
    assert found.joint == "J3"
    assert [wrong is right for wrong, right in zip(told, heard, strict=True)] == [True, False, True]
    assert found.interval[0] * 0.9 <= 0.1 <= found.interval[1] * 1.1


def test_a_still_limb_heard_all_it_was_told():
    """Judge no limb anew in which no lost packet shows, where those of all joints are lost."""
    first, second, third = parts("command-dropout=10%")
    noise = np.random.default_rng(0)
    still = []
    for one in third.recordings:
        commands = replace(
            one.commands, target=np.zeros_like(one.commands.target) + one.commands.start
        )
        shown = replay(third.nominal, commands)[:3]
        measured = shown + np.where(np.isfinite(one.measured), 0.1 * MRAD, np.nan) * noise.normal(
            size=shown.shape
        )
        still.append(replace(one, commands=commands, measured=measured))
    quiet = replace(third, recordings=tuple(still))
    (found,), heard = dropouts((first, second, quiet))
    assert found.joint is None
    assert [a is b for a, b in zip((first, second, quiet), heard, strict=True)] == [
        False,
        False,
        True,
    ]


def test_packets_are_decoded_as_they_were_lost():
    """Tell every packet that shows, lost or not, as the counters that lost it say."""
    part = parts("command-dropout=20%")[0]
    fitter = Fitter(part, (), None)
    told = fitter.at((), np.zeros(0))
    heard = hear(fitter, [told], part.joints, told.cost)
    clear_ones = decisive(part, heard.path, heard.scale)
    for number, (lost, clear) in enumerate(zip(heard.path.lost, clear_ones, strict=True)):
        seed = int(np.random.default_rng([SEED, number, 0]).integers(1 << 53, size=1)[0])
        true = np.array([uniform(seed, k, 0) < 0.2 for k in range(len(lost))])
        assert clear.sum() > 40
        # A packet with as good as no news may be told wrong; 8 nats are one in 3000.
        assert (lost != true)[clear].mean() < 0.005


@pytest.mark.parametrize("name", ["kp100", "kp800"])
def test_the_steps_of_a_real_servo(name):
    """Measure the 4096 steps of a real servo's encoder from what it did."""
    if not REAL.is_dir():
        pytest.skip(f"no real recordings at {REAL}")
    real = registry.load("importer", "bam")().read(REAL)[name]
    (found,) = sensors(gather(real, mjcf_world(real), FLOOR), CATALOGUE)
    assert found.effect == "encoder-resolution"
    assert found.value == pytest.approx(2 * np.pi / 4096, abs=found.interval[1] - found.value)
