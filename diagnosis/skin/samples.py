"""The samples of a skin: how deep geometry says that every taxel is pressed, and what it read."""

from collections.abc import Sequence

import numpy as np

from backends.spec import Spec
from diagnosis.motion.held import CALMER, Held, blur_m, gaps_m, pressed_m, smoothed
from diagnosis.skin.forward_model import Faults, Pressed, joined

PERIOD_S = 0.2
"""Samples are thinned to this."""
FINER_S = 0.01
"""What was pressed before a sample is followed in steps of this."""
FIRM_N = 12.0
"""No finger of a grasp presses harder."""
YIELD_M = FIRM_N * 0.072e-3
"""Nominal contacts yield up to this; a tip deeper in the stick, or away from it, is misplaced."""
OUT_M = 0.02e-3
"""A tip that is touched and further outside than this is misplaced. One that answers nowhere has
let go, unless it is further inside than this."""
SURE, MEDIAN = 3.0, 1.25
"""Standard deviations that noise may add, and that of a median over that of a mean."""
BLUR_M = 1e-5
"""The geometry is at least so uncertain."""
ASKEW = 1.12
"""Taxels beside the nearest point are inclined, and get half of the noise along them as well."""


def samples(
    nominal: Spec, parts: Sequence[Held], binary: bool
) -> tuple[Pressed, Faults, tuple[str, ...]]:
    """Thinned samples of some episodes, `binary` where taxels answer yes or no; the nominal skin.

    And the fingers that the geometry puts elsewhere than they are.
    """
    noise, steps = np.max([blur_m(nominal, part) for part in parts], axis=0)
    if noise > BLUR_M:
        parts, noise = [smoothed(part) for part in parts], noise * CALMER * ASKEW
    blur = max(BLUR_M, float(np.hypot(noise, steps)))
    pressed = [_pressed(nominal, part, binary, blur) for part in parts]
    misplaced = sorted({finger for _, fingers in pressed for finger in fingers})
    skin = Faults(threshold_m=nominal.hand.taxels.threshold_m, blur_m=blur)
    return joined([data for data, _ in pressed]), skin, tuple(misplaced)


def _pressed(nominal: Spec, part: Held, binary: bool, blur: float) -> tuple[Pressed, list[str]]:
    """Thinned samples, and the fingers that the geometry puts elsewhere than they are."""
    period_s = float(np.median(np.diff(part.time_s)))
    finer = max(round(FINER_S / period_s), 1)
    step = max(round(PERIOD_S / period_s / finer), 1) * finer
    apart = step if binary else finer
    seen = part.every(np.arange(0, len(part.time_s), apart))
    rows = np.arange(step, len(part.time_s), step) // apart
    gap_m, depth_m, reading = gaps_m(nominal, seen), pressed_m(nominal, seen), seen.touch
    assert reading is not None
    touched = reading.any(axis=2) | (gap_m < -OUT_M - SURE * blur)
    data = Pressed(
        time_s=seen.time_s[rows],
        depth_m=depth_m[rows],
        reading=reading[rows],
        touched=touched[rows],
        binary=binary,
        history=() if binary else ((np.maximum(depth_m, 0.0) * touched[..., None], rows),),
    )
    off, slack = np.median(gap_m[rows], axis=0), SURE * MEDIAN * blur / np.sqrt(len(rows))
    deepest_m = YIELD_M + FIRM_N * nominal.contact.compliance_m_n
    wrong = (off < -deepest_m - slack) | (off > OUT_M + slack)
    return data, [
        tip.finger for tip, out in zip(nominal.hand.fingertips, wrong, strict=True) if out
    ]
