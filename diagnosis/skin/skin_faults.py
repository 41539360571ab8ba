"""Faults of a skin (threshold, drift, dead taxels, halo, gains, hysteresis), without dynamics.

Where stick and joints are known, geometry says what every taxel should answer. All sets of as many
faults are fitted to all samples, and the smallest is named that takes its share of the squared gap
beyond one floor (`verdict.ordinary`) and leaves no more than a floor and the law's own error. The
law of the answers is exact: likelihoods name as well what leaves less than shows in a gap
(`verdict.exact`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from backends.catalogue import Catalogue, of_part
from backends.spec import Spec, Taxels
from backends.touch import taxel_grid
from diagnosis.logs.log import Log
from diagnosis.motion.held import FLOOR_M, held
from diagnosis.skin.forward_model import Faults
from diagnosis.skin.samples import samples
from diagnosis.skin.taxel_fits import FIELDS, GAIN, HALO, HYSTERESIS, THRESHOLD, Fitting, Guess
from diagnosis.verdict.exact import ACCUSE_NATS, TIE_NATS
from diagnosis.verdict.ordinary import SHARE, SIMULATORS, Gap, allowed, share_of
from diagnosis.verdict.result import TOUCH, UNKNOWN, Z90, Cause, Report, Spot, cause, missing

MOST = 2
"""Faults that are named at once: more of them imitate any other."""
LAW = replace(SIMULATORS, floors=1.0)
"""The right faults leave a floor, and what their law is off by."""
HEALTHY = 1.5
"""A good skin leaves this gap: the geometry has errors that come again where it is the same."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class SkinFit(Gap):
    """A set of faults at the sizes that fit best together."""

    guesses: tuple[Guess, ...] = ()
    skin: Faults
    nats: float
    """Log-likelihood of the samples."""
    tied: tuple[str, ...] = ()
    """Faults of sets of the same size that this log cannot tell from it."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the faults."""
        return tuple(guess.fault for guess in self.guesses)

    @property
    def is_unknown(self) -> bool:
        """Whether no set explains an odd gap, or its size is at the end of what there is."""
        odd = not self.guesses and self.worst > HEALTHY
        return odd or any(guess.extreme for guess in self.guesses)


def identify_skin_faults(
    log: Log, nominal: Spec, catalogue: Catalogue, mended: bool = False
) -> Report:
    """The effects on taxels that a log shows, and which of them it cannot show.

    `mended`: stick or contacts of the nominal world are what this log itself shows of them. How
    deep they press is known no better than a sample then, so a threshold within that is none.
    """
    every = {number.split(".")[1]: n for number, n in of_part(catalogue, "taxels").items()}
    lacking = missing([n for k, n in every.items() if k not in FIELDS], NO_MODEL)
    names = {fault: every[fault] for fault in FIELDS if fault in every}
    parts = [part for part in held(log, nominal) if part.touch is not None]
    grid = np.stack([taxel_grid(t, nominal.hand.taxels)[0] for t in nominal.hand.fingertips])
    binary = log.is_binary
    if not names:
        return lacking
    if not parts:
        why = GRASP.format("stick and contact")
    elif parts[0].taxels != grid.shape[:2]:
        why = f"the log has {parts[0].taxels} taxels, the hand {grid.shape[:2]}"
    else:
        data, skin, misplaced = samples(nominal, parts, binary)
        why = MISPLACED.format(", ".join(misplaced)) if misplaced else ""
    if why:
        return lacking + missing(names.values(), why)
    fitting, starts = Fitting(data, grid), [skin]
    if mended and binary:
        starts.insert(0, _offset(fitting, skin))
    unseen, channels = (DEPTHS, "stick and touch") if binary else (ANSWERS, "stick and contact")
    bare, found = search(fitting, starts, [fault for fault in names if fault not in unseen])
    deaf = [names[fault] for fault in unseen if fault in names]
    shown = Report(
        causes=tuple(_causes(bare, found, names, nominal.hand.taxels, catalogue)),
        spots=tuple(
            Spot(
                finger=tip.finger,
                family=TOUCH,
                gap_before=fitting.gap(bare.skin, f),
                gap_after=fitting.gap(found.skin, f),
            )
            for f, tip in enumerate(nominal.hand.fingertips)
        ),
    )
    return lacking + shown + missing(deaf, GRASP.format(channels))


def _offset(skin: Fitting, start: Faults) -> Faults:
    """The skin that all faults are sought beside, with a threshold within the geometry's error.

    That is the blur of samples, and what a radius is known by.
    """
    guess, error_m = skin.guess(THRESHOLD, start), np.hypot(start.blur_m, Z90 * FLOOR_M)
    small = guess is not None and abs(guess.value - start.threshold_m) < error_m
    return guess.faults if guess is not None and small else start


def search(
    fitting: Fitting, starts: Sequence[Faults], sought: Sequence[str]
) -> tuple[SkinFit, SkinFit]:
    """The skin without faults, and the smallest set that explains its samples, or none.

    `starts`: the skin beside which faults are sought, and others that a lone one may be fitted to.
    """
    bare = now = _fit(fitting, starts[0])
    for count in range(1, MOST + 1):
        if count > 1 and not now.guesses and now.worst <= LAW.floors:
            break
        sets = sorted(_sets(fitting, starts, sought, count), key=lambda one: -one.nats)
        if not sets:
            continue
        best, takes = sets[0], not now.guesses and share_of(sets[0], bare) >= SHARE
        worth = takes or best.nats - now.nats >= ACCUSE_NATS
        if worth and best.worst <= allowed(bare.worst, LAW):
            alike = (one for one in sets[1:] if best.nats - one.nats < TIE_NATS)
            tied = {name for one in alike for name in one.names} - {*best.names}
            now = replace(best, tied=tuple(sorted(tied)))
    return bare, now


def _sets(
    fitting: Fitting, starts: Sequence[Faults], sought: Sequence[str], count: int
) -> Iterator[SkinFit]:
    """All sets of so many faults that are some."""
    for names in combinations(sought, count):
        fits = [(fitting.together(names, start), start) for start in starts[: 3 - count]]
        skin, start = max(fits, key=lambda fit: fitting.nats(fit[0]))
        guesses = [guess for name in names if (guess := fitting.beside(name, start, skin))]
        if len(guesses) == count:
            yield replace(_fit(fitting, skin), guesses=tuple(guesses))


def _fit(fitting: Fitting, skin: Faults) -> SkinFit:
    gap2 = np.array([fitting.gap(skin) ** 2])
    return SkinFit(skin=skin, gap2=gap2, nats=fitting.nats(skin))


def _causes(
    bare: SkinFit, found: SkinFit, names: Mapping[str, str], nominal: Taxels, catalogue: Catalogue
) -> Iterator[Cause]:
    """What is more than nominal, and a threshold more than sticks are thick alike."""
    share = max(share_of(found, bare), 0.0)
    if found.is_unknown:
        yield cause(UNKNOWN, (0.0, 0.0, 0.0), catalogue, share=share, evidence=STRANGE)
        return
    for guess in found.guesses:
        known = getattr(nominal, guess.fault)
        value, low, high = (v - known for v in (guess.value, *guess.interval))
        within = guess.fault == THRESHOLD and abs(value) < FLOOR_M
        if not (within or low <= 0.0 <= high):
            said, tied = guess.evidence, tuple(names[fault] for fault in found.tied)
            effect, sizes = names[guess.fault], (value, low, high)
            yield cause(effect, sizes, catalogue, share=share, evidence=said, tied=tied)
