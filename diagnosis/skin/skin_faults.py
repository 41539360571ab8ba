"""Faults of a skin: threshold, drift, dead taxels, a halo; identified without any dynamics.

Where stick and joints are known, geometry says what every taxel should answer. Faults are added one
after the other, each the one that samples held out bear out most, and two are fitted together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from backends.touch import taxel_grid
from diagnosis.finding import TIE_NATS, TOUCH, UNKNOWN, Z90, Finding, Report, Spot, share
from diagnosis.logs.log import Log
from diagnosis.motion.held import CALMER, FLOOR_M, Held, blur_m, gaps_m, held, pressed_m, smoothed
from diagnosis.skin.forward_model import Faults, Pressed, joined, nats
from diagnosis.skin.taxel_fits import Fitting, Guess

THRESHOLD = "taxel-threshold"
EFFECTS = {
    THRESHOLD: "threshold_m",
    "taxel-drift": "drift_m_s",
    "taxel-dropout": "dead_share",
    "taxel-halo": "halo_m",
}
"""Effects and the numbers that they change."""
ANSWERS = (THRESHOLD, "taxel-halo")
"""Effects that change what counts and no depth."""
PERIOD_S = 0.2
"""Samples are thinned to this."""
BLOCK_S = 1.0
"""Blocks that judge each other in turn."""
FIRM_N = 12.0
"""No finger of a grasp presses harder."""
YIELD_M = FIRM_N * 0.072e-3
"""Nominal contacts yield up to this; a tip deeper in the stick, or away from it, is misplaced."""
OUT_M = 0.02e-3
"""A tip that is touched and further outside than this is misplaced. One that answers nowhere has
let go, unless it is further inside than this."""
SURE, MEDIAN = 3.0, 1.25
"""Standard deviations that noise may add, and that of a median over that of a mean."""
MOST = 2
"""Faults that are named at once: more of them imitate any other."""
ACCUSE_NATS = 6.0
"""A fault must raise the likelihood of the judging samples by this, and what is unknown as well."""
EXPLAINED = 0.9
"""Or faults must explain this share of the squared gap."""
SETTLED_GAP = 1.5
"""A gap that counts as none, for the geometry has errors that come again where it is the same."""
BLUR_M = 1e-5
"""The geometry is at least so uncertain."""
ASKEW = 1.12
"""Taxels beside the nearest point are inclined, and get half of the noise along them as well."""
MOVED_M = 5e-5
"""Blur while a misplaced tip is moved."""
GRASP = "not identifiable from this log; record --protocol grasp with the channels {}"
MISPLACED = (
    "not identifiable from this log: stick and joints put {} away from where they touch; correct "
    "the stick's radius, the joints' zero or the contact's softness first"
)


def identify_skin_faults(
    log: Log, nominal: Spec, catalogue: Mapping[str, type[Effect]], mended: bool = False
) -> Report:
    """The touch effects that a log shows, and which of them it cannot show.

    `mended`: stick or contacts of the nominal world are what this log itself shows of them. How
    deep they press is known no better than a sample then, so a threshold within that is none.
    """
    sought = [name for name in EFFECTS if name in catalogue]
    if not sought:
        return Report()
    parts = [part for part in held(log, nominal) if part.touch is not None]
    grid = np.stack([taxel_grid(t, nominal.hand.taxels)[0] for t in nominal.hand.fingertips])
    if not parts:
        return Report(missing=(_why(sought, GRASP.format("stick and contact")),))
    if parts[0].taxels != grid.shape[:2]:
        other = f"the log has {parts[0].taxels} taxels, the hand {grid.shape[:2]}"
        return Report(missing=(_why(sought, other),))
    binary = log.meta.channels["touch"].unit == "1"
    skins, start, wrong = _skins(nominal, parts, grid, binary)
    if mended and binary:
        skins.bare, start = start, _offset(skins.whole, start)
    mute = _mute(sought, binary, wrong)
    found, faults = _search(skins, start, [name for name in sought if name not in mute])
    if wrong and any(f.effect == UNKNOWN for f in found):
        return Report(missing=(_why(sought, MISPLACED.format(", ".join(wrong))),))
    known = nominal.hand.taxels
    beyond = [_beyond(f, getattr(known, EFFECTS.get(f.effect, ""), 0.0)) for f in found]
    return Report(
        findings=tuple(f for f in beyond if _is_new(f)),
        spots=_spots(nominal, skins.whole, start, faults),
        missing=tuple(_why(names, why) for why, names in _by_reason(mute).items()),
    )


def _why(names: Sequence[str], why: str) -> str:
    return f"{', '.join(names)}: {why}"


def _skins(
    nominal: Spec, parts: Sequence[Held], grid: Array, binary: bool
) -> tuple["Skins", Faults, list[str]]:
    """All samples, the nominal skin, and the fingers that the geometry misplaces."""
    noise, steps = np.max([blur_m(nominal, part) for part in parts], axis=0)
    if noise > BLUR_M:
        parts, noise = [smoothed(part) for part in parts], noise * CALMER * ASKEW
    blur = max(BLUR_M, float(np.hypot(noise, steps)))
    pressed = [_pressed(nominal, part, binary, blur) for part in parts]
    wrong = {nominal.hand.fingertips[f].finger for _, fingers in pressed for f in fingers}
    start = Faults(threshold_m=nominal.hand.taxels.threshold_m, blur_m=blur)
    return Skins(_split([data for data, _ in pressed]), grid), start, sorted(wrong)


def _mute(sought: Sequence[str], binary: bool, wrong: Sequence[str]) -> dict[str, str]:
    """Effects that such samples do not show, and why."""
    if not binary:
        return {name: GRASP.format("stick and contact") for name in sought if name in ANSWERS}
    if wrong and THRESHOLD in sought:
        return {THRESHOLD: MISPLACED.format(", ".join(wrong))}
    return {}


def _by_reason(mute: Mapping[str, str]) -> dict[str, list[str]]:
    return {why: [n for n, own in mute.items() if own == why] for why in mute.values()}


def _spots(nominal: Spec, skin: Fitting, start: Faults, faults: Faults) -> tuple[Spot, ...]:
    """The gap of every finger's skin, before and after."""
    return tuple(
        Spot(
            finger=tip.finger,
            family=TOUCH,
            gap_before=skin.gap(start, f),
            gap_after=skin.gap(faults, f),
        )
        for f, tip in enumerate(nominal.hand.fingertips)
    )


def _beyond(found: Finding, known: float) -> Finding:
    """A finding without what is nominal."""
    low, high = found.interval
    return replace(found, value=found.value - known, interval=(low - known, high - known))


def _offset(skin: Fitting, start: Faults) -> Faults:
    """The skin that all faults are sought beside, with a threshold within the geometry's error.

    That is the blur of samples, and what a radius is known by.
    """
    guess, error_m = skin.guess(THRESHOLD, start), np.hypot(start.blur_m, Z90 * FLOOR_M)
    small = guess is not None and abs(guess.value - start.threshold_m) < error_m
    return guess.faults if guess is not None and small else start


def _is_new(found: Finding) -> bool:
    """Whether it is more than what is nominal, and a threshold more than sticks are thick alike."""
    if found.effect == THRESHOLD and abs(found.value) < FLOOR_M:
        return False
    return found.effect == UNKNOWN or not found.interval[0] <= 0.0 <= found.interval[1]


def _pressed(nominal: Spec, part: Held, binary: bool, blur: float) -> tuple[Pressed, list[int]]:
    """Thinned samples, and the fingers that the geometry puts elsewhere than they are."""
    step = max(round(PERIOD_S / float(np.median(np.diff(part.time_s)))), 1)
    part = part.every(np.arange(step, len(part.time_s), step))
    gap_m, touch = gaps_m(nominal, part), part.touch
    assert touch is not None
    data = Pressed(
        time_s=part.time_s,
        depth_m=pressed_m(nominal, part),
        reading=touch,
        touched=touch.any(axis=2) | (gap_m < -OUT_M - SURE * blur),
        binary=binary,
    )
    off, slack = np.median(gap_m, axis=0), SURE * MEDIAN * blur / np.sqrt(len(gap_m))
    deepest_m = YIELD_M + FIRM_N * nominal.contact.compliance_m_n
    wrong = [f for f in range(len(off)) if not -deepest_m - slack <= off[f] <= OUT_M + slack]
    for f in wrong:
        data.depth_m[:, f] = _moved(nominal, part, data, f, float(off[f]))
    return data, wrong


def _moved(nominal: Spec, part: Held, data: Pressed, finger: int, off_m: float) -> Array:
    """Depths of one finger (S, K), the tip moved along its normal to where it fits best."""
    faults = Faults(threshold_m=nominal.hand.taxels.threshold_m, blur_m=MOVED_M)
    best_m, width_m = off_m / 2, abs(off_m) / 2 + YIELD_M
    for _ in range(3):
        tries = {}
        for shift_m in best_m + width_m * np.linspace(-1, 1, 13):
            radius_m = max(nominal.stick.radius_m + shift_m, 1e-4)
            world = replace(nominal, stick=replace(nominal.stick, radius_m=radius_m))
            depth = data.depth_m.copy()
            depth[:, finger] = pressed_m(world, part)[:, finger]
            score = float(nats(replace(data, depth_m=depth), faults)[:, finger].sum())
            tries[float(shift_m)] = score, depth[:, finger]
        best_m, width_m = max(tries, key=lambda shift: tries[shift][0]), width_m / 6
    return tries[best_m][1]


def _split(parts: Sequence[Pressed]) -> tuple[Pressed, Pressed]:
    """Two halves that judge each other: every second block, of the next episode the others.

    So each has seen what the other one has at that time, as drift has it.
    """
    turns = [np.floor(p.time_s / BLOCK_S + k) % 2 == 0 for k, p in enumerate(parts)]
    one = [part.some(turn) for part, turn in zip(parts, turns, strict=True)]
    other = [part.some(~turn) for part, turn in zip(parts, turns, strict=True)]
    return joined(one), joined(other)


class Skins:
    """All samples, and both halves that judge each other."""

    def __init__(self, halves: tuple[Pressed, Pressed], grid: Array) -> None:
        self._fits = [Fitting(half, grid) for half in halves]
        self.whole = Fitting(joined(halves), grid)
        self.bare: Faults | None = None
        """Another skin that a fault may be fitted to."""

    def lead(self, effect: str, start: Faults, faults: Faults, first: str | None = None) -> float:
        """How much better an effect fitted to one half explains the other one [nats].

        Beside the fault that is there `first`, which is fitted again with it, and without.
        """
        gain = 0.0
        for fit, judge in (self._fits, self._fits[::-1]):
            alone = faults if first is None else fit.alone(first, start, faults)
            skin = self.fitted(effect, start, faults, first, fit)
            gain += judge.nats(skin) - judge.nats(alone)
        return gain

    def fitted(
        self,
        effect: str,
        start: Faults,
        faults: Faults,
        first: str | None = None,
        fit: Fitting | None = None,
    ) -> Faults:
        """The skin with an effect, and with the first one refitted, to all samples.

        Or to those of `fit`. A lone effect may explain what a small offset seems to.
        """
        fit = fit or self.whole
        if first is not None:
            return fit.both((first, effect), start, faults)
        skins = [faults] if self.bare is None or self.bare is faults else [faults, self.bare]
        guesses = (fit.guess(effect, skin) for skin in skins)
        return max((faults, *(g.faults for g in guesses if g is not None)), key=fit.nats)

    def foretold(self, faults: Faults) -> float:
        """Cross-validated gain of each half on what faults leave of the other one [nats]."""
        one, other = self._fits
        return one.foretold(other, faults) + other.foretold(one, faults)


Found = tuple[Guess, float, tuple[tuple[str, float], ...]]
"""A guess, its lead [nats], and what is as near to it as its own lead."""


def _search(skins: Skins, start: Faults, sought: list[str]) -> tuple[tuple[Finding, ...], Faults]:
    """Faults one after the other, the clearest first, while halves ask for one; the skin then."""
    found: list[Found] = []
    faults, skin = start, skins.whole
    while sought and len(found) < MOST:
        first = found[0][0].effect if found else None
        leads = {name: skins.lead(name, start, faults, first) for name in sought}
        best = max(leads, key=lambda name: leads[name])
        fitted = skins.fitted(best, start, faults, first)
        guess = skin.beside(best, start, fitted)
        if guess is None or leads[best] < ACCUSE_NATS:
            break
        lead = leads.pop(best)
        behind = {name: lead - other for name, other in leads.items()}
        near = tuple((n, nats) for n, nats in behind.items() if nats < TIE_NATS)
        anew = [(skin.beside(o.effect, start, guess.faults), nats, ties) for o, nats, ties in found]
        found = [(one, nats, ties) for one, nats, ties in anew if one is not None]
        found.append((guess, min([lead, *behind.values()]), near))
        faults, sought = guess.faults, [name for name in sought if name != best]
    before, after = skin.gap(start), skin.gap(faults)
    explained = share(before, after) >= EXPLAINED
    strained = any(guess.extreme for guess, _, _ in found)
    left = skins.foretold(faults)
    if strained or left >= ACCUSE_NATS or (after > SETTLED_GAP and not explained):
        return (_unknown(before, after, left),), faults
    named = tuple(
        Finding(
            effect=guess.effect,
            joint=None,
            family=TOUCH,
            value=guess.value,
            interval=guess.interval,
            share=share(before, after),
            gap_before=before,
            gap_after=after,
            lead_nats=lead,
            ties=near,
            evidence=guess.evidence,
        )
        for guess, lead, near in found
    )
    return named, faults


def _unknown(before: float, after: float, left: float) -> Finding:
    return Finding(
        effect=UNKNOWN,
        joint=None,
        family=TOUCH,
        value=0.0,
        interval=(0.0, 0.0),
        share=share(before, after),
        gap_before=before,
        gap_after=after,
        lead_nats=max(after**2 - 1, left),
        evidence="the taxels that respond are not those that stick and joints press",
    )
