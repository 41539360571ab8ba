"""What a position sensor adds by itself: white noise, and steps. No replay is needed."""

from collections.abc import Iterator, Mapping

import numpy as np

from backends.effect import UNITS, Effect
from diagnosis.evidence.evidence import Evidence
from diagnosis.motion.columns import COLUMNS, table
from diagnosis.verdict.result import UNKNOWN, Cause

NOISE_RAD, STEP_RAD = 8e-4, 7e-4
"""Noise and steps of ordinary sensors; more is a finding [rad; of a slide, of its travel]."""
BEYOND = 1.5
"""So many times what the mechanism's own sensors are known to have is a finding."""
SHARE_OFF = 0.1
"""A measured noise or step is right to this share."""
NOISE, RESOLUTION = "encoder.noise_rad", "encoder.resolution_rad"


def sensor_findings(evidence: Evidence, catalogue: Mapping[str, type[Effect]]) -> Iterator[Cause]:
    """Noise and steps beyond the ordinary, by joint; a step explains the noise that it makes."""
    names = {getattr(kind, "number", None): name for name, kind in catalogue.items()}
    known = table(evidence.limb.spec, evidence.limb.rigid)
    for j, joint in enumerate(evidence.joints):
        size = evidence.size[j]
        own_noise, own_step = (known[j, COLUMNS.index(n)] for n in (NOISE, RESOLUTION))
        step, noise = float(evidence.step[j]), float(evidence.noise[0, j])
        if step > max(STEP_RAD * size, BEYOND * own_step):
            number, value = RESOLUTION, step
        elif noise > max(NOISE_RAD * size, BEYOND * own_noise):
            number, value = NOISE, float(np.sqrt(max(noise**2 - own_noise**2, 0.0)))
        else:
            continue
        name = names.get(number, UNKNOWN)
        unit = catalogue[name].unit if name in catalogue else "rad"
        if value > 0.0:
            shown = value / UNITS[unit][1]
            yield Cause(
                effect=name,
                joint=joint,
                joints=(joint,),
                value=shown,
                low=(1 - SHARE_OFF) * shown,
                high=(1 + SHARE_OFF) * shown,
                unit=unit,
                share=0.0,
            )
