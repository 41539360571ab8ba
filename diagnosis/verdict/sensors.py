"""Causes beside the verdict: what sensors add by themselves, and packets that were lost."""

from collections.abc import Iterator, Sequence

import numpy as np

from backends.catalogue import Catalogue, of_part
from backends.effect import Effect, NumberEffect
from backends.state import Array
from diagnosis.evidence.evidence import Evidence
from diagnosis.motion.columns import COLUMNS, table
from diagnosis.motion.limb import BLOCK_S
from diagnosis.motion.recordings import noise_of, stood_s, white_noise
from diagnosis.verdict.ordinary import Ordinary
from diagnosis.verdict.result import UNKNOWN, Cause, cause, missing

NOISE_RAD, NOISE_SHARE = 8e-4, 2.5e-3
"""Noise of ordinary sensors; more is a finding: of a hinge's [rad], and of a slide's, over its
travel, as of a linear potentiometer."""
BEYOND = 1.5
"""So many times what the mechanism's own sensors are known to have is a finding; and noise of so
many steps, for the third differences of rounded readings alone may look like 1.3 of them."""
REST_S, LEAST_RESTS = 0.3, 20
"""Targets that stood still for so long are at rest; noise is judged on so many samples there."""
SHARE_OFF = 0.1
"""A measured noise or step is right to this share."""
NOISE, RESOLUTION = "encoder.noise_rad", "encoder.resolution_rad"
LOSS, STEP = "command.loss_share", "command.resolution_rad"
SENSED = (NOISE, RESOLUTION, LOSS, STEP)
"""Numbers that sensors and packets show by themselves."""
WHY = "not looked for: neither replays, sensors nor grasps here show it"


def sensor_causes(
    evidence: Evidence, residual: Array, ordinary: Ordinary, catalogue: Catalogue
) -> Iterator[Cause]:
    """Noise and steps beyond the ordinary, by joint; a step explains the noise that it makes."""
    left = np.zeros(evidence.logged.shape)
    left[evidence.logged] = residual
    known = table(evidence.limb.spec, evidence.limb.rigid)
    slides = [body.joint.slides for body in evidence.limb.spec.hand.driven]
    for j in range(len(evidence.joints)):
        size = evidence.size[j]
        own_noise, own_step = (known[j, COLUMNS.index(n)] for n in (NOISE, RESOLUTION))
        step, noise = float(evidence.step[j]), float(evidence.noise[0, j])
        if evidence.limb.period_s >= BLOCK_S:  # rows are far apart: motion looks like noise
            left_noise = float(white_noise(left[j, 0]) * evidence.floor[0, j])
            noise = min(noise, left_noise, _noise_at_rest(evidence, j))
        off = 1 - SHARE_OFF, 1 + SHARE_OFF
        if step > max(ordinary.step_rad * size, BEYOND * own_step):
            sizes = [x * step for x in (1.0, *off)]
            yield sensor_cause(evidence, RESOLUTION, (j,), sizes, catalogue)
        elif noise > max(
            NOISE_SHARE * size if slides[j] else NOISE_RAD, BEYOND * own_noise, BEYOND * step
        ):
            more = float(np.sqrt(max(noise**2 - own_noise**2, 0.0)))
            sizes = [x * more for x in (1.0, *off)]
            yield sensor_cause(evidence, NOISE, (j,), sizes, catalogue)


def _noise_at_rest(evidence: Evidence, j: int) -> float:
    """White noise of a position where all targets rest; 0 where they hardly do."""
    third = []
    for recording in evidence.limb.recordings:
        stood, time_s = stood_s(recording.time_s, recording.asked)[3:], recording.time_s
        whole = (stood > REST_S) & (stood >= time_s[3:] - time_s[:-3])
        third.append(np.diff(recording.measured[:, 0, j], n=3)[whole])
    found = np.abs(np.concatenate(third))
    return float(noise_of(found)) if len(found) >= LEAST_RESTS else 0.0


def sensor_cause(
    said: Evidence, number: str, places: Sequence[int], sizes: Sequence[float], known: Catalogue
) -> Cause:
    """The effect that changes a number of the spec on some joints; `unknown` without one."""
    name = of_part(known, "encoder", "command").get(number, UNKNOWN)
    joints = tuple(said.joints[j] for j in places)
    return cause(name, sizes, known, joints=joints, at=said.place(*places))


def not_looked_for(catalogue: Catalogue) -> tuple[str, ...]:
    """What to say of the effects of a catalogue that nothing looks for; nothing of none."""
    return missing((name for name, kind in catalogue.items() if not _is_sought(kind)), WHY).missing


def _is_sought(kind: type[Effect]) -> bool:
    if kind.shows_in_hand() or set(kind.spec_fields()) & set(SENSED):
        return True
    replayed = not issubclass(kind, NumberEffect) or kind.number in COLUMNS
    return replayed and kind.least is not None
