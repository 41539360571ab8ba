"""Faults of a skin (threshold, drift, dead taxels, halo, gains, hysteresis), without dynamics.

Where stick and joints are known, geometry says what every taxel should answer.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from backends.catalogue import Catalogue, of_part
from backends.spec import Spec, Taxels
from backends.touch import taxel_grid
from diagnosis.logs.log import Log
from diagnosis.motion.held import FLOOR_M, held
from diagnosis.skin.forward_model import Faults
from diagnosis.skin.samples import samples
from diagnosis.skin.search import SkinFit, search
from diagnosis.skin.taxel_fits import FIELDS, GAIN, HALO, HYSTERESIS, THRESHOLD, Fitting
from diagnosis.verdict.in_hand import TOUCH, Report, Spot, missing
from diagnosis.verdict.result import UNKNOWN, Z90, Cause, cause

ANSWERS = (THRESHOLD, HALO)
"""Faults that change what counts and no depth."""
DEPTHS = (GAIN, HYSTERESIS)
"""Faults that a log of yes and no cannot tell from others."""
GRASP = "not identifiable from this log; record --protocol grasp with the channels {}"
MISPLACED = (
    "not identifiable from this log: stick and joints put {} away from where they touch; correct "
    "the stick's radius, the joints' zero or the contact's softness first"
)
NO_MODEL = "not looked for: the model of a skin here does not have it"
STRANGE = "the taxels that respond are not those that stick and joints press"


def identify_skin_faults(
    log: Log, nominal: Spec, catalogue: Catalogue, mended: bool = False
) -> Report:
    """The effects on taxels that a log shows, and which of them it cannot show.

    `mended`: stick or contacts of the nominal world are what this log itself shows of them. How
    deep they press is known no better than a sample then, so a threshold within that is none.
    """
    every = {number.split(".")[1]: n for number, n in of_part(catalogue, "taxels").items()}
    report = Report(missing=missing([n for k, n in every.items() if k not in FIELDS], NO_MODEL))
    names = {fault: every[fault] for fault in FIELDS if fault in every}
    if not names:
        return report
    parts = [part for part in held(log, nominal) if part.touch is not None]
    grid = np.stack([taxel_grid(t, nominal.hand.taxels)[0] for t in nominal.hand.fingertips])
    if not parts:
        why = GRASP.format("stick and contact")
        return report + Report(missing=missing(names.values(), why))
    if parts[0].taxels != grid.shape[:2]:
        why = f"the log has {parts[0].taxels} taxels, the hand {grid.shape[:2]}"
        return report + Report(missing=missing(names.values(), why))
    binary = log.is_binary
    data, skin, misplaced = samples(nominal, parts, binary)
    if misplaced:
        why = MISPLACED.format(", ".join(misplaced))
        return report + Report(missing=missing(names.values(), why))
    fitting, starts = Fitting(data, grid), [skin]
    if mended and binary:
        starts.insert(0, _offset(fitting, skin))
    unseen, channels = (DEPTHS, "stick and touch") if binary else (ANSWERS, "stick and contact")
    found = search(fitting, starts, [fault for fault in names if fault not in unseen])
    deaf = [names[fault] for fault in unseen if fault in names]
    return report + Report(
        causes=tuple(_causes(found, names, nominal.hand.taxels, catalogue)),
        spots=tuple(
            Spot(
                finger=tip.finger,
                family=TOUCH,
                gap_before=fitting.gap(found.nominal.skin, f),
                gap_after=fitting.gap(found.chosen.skin, f),
            )
            for f, tip in enumerate(nominal.hand.fingertips)
        ),
        missing=missing(deaf, GRASP.format(channels)),
    )


def _offset(skin: Fitting, start: Faults) -> Faults:
    """The skin that all faults are sought beside, with a threshold within the geometry's error.

    That is the blur of samples, and what a radius is known by.
    """
    guess, error_m = skin.guess(THRESHOLD, start), np.hypot(start.blur_m, Z90 * FLOOR_M)
    small = guess is not None and abs(guess.value - start.threshold_m) < error_m
    return guess.faults if guess is not None and small else start


def _causes(
    found: SkinFit, names: Mapping[str, str], nominal: Taxels, catalogue: Catalogue
) -> Iterator[Cause]:
    """What is more than nominal, and a threshold more than sticks are thick alike."""
    if found.is_unknown:
        yield cause(UNKNOWN, (0.0, 0.0, 0.0), catalogue, share=found.share, evidence=STRANGE)
        return
    others = {name for one in found.tied for name in one.names} - set(found.chosen.names)
    for guess in found.chosen.guesses:
        known = getattr(nominal, guess.fault)
        value, low, high = (v - known for v in (guess.value, *guess.interval))
        within = guess.fault == THRESHOLD and abs(value) < FLOOR_M
        if not (within or low <= 0.0 <= high):
            yield cause(
                names[guess.fault],
                (value, low, high),
                catalogue,
                share=found.share,
                evidence=guess.evidence,
                tied=tuple(names[fault] for fault in sorted(others)),
            )
