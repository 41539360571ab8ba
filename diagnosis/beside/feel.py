"""What is wrong with a skin: threshold, drift, dead taxels, a halo; told without any dynamics.

Where stick and joints are known, geometry says what every taxel should answer. Faults are added one
after the other, each the one that samples held out bear out most.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from backends.touch import taxel_grid
from diagnosis.attribution.verdict import UNKNOWN, rules
from diagnosis.beside._skin import Faults, Pressed, joined, nats
from diagnosis.beside._taxel_fits import Fitting, Guess
from diagnosis.beside.finding import Finding, Report, confidence, share
from diagnosis.beside.held import CALMER, Held, blur_m, gaps_m, held, pressed_m, smoothed
from diagnosis.logs.log import Log

EFFECTS = {
    "taxel-threshold": "threshold_m",
    "taxel-drift": "drift_m_s",
    "taxel-dropout": "dead_share",
    "taxel-halo": "halo_m",
}
"""Effects and the numbers that they change."""
ANSWERS = ("taxel-threshold", "taxel-halo")
"""Effects that change what counts and no depth."""
PERIOD_S = 0.1
"""Samples are thinned to this."""
BLOCK_S = 1.0
"""Blocks that judge each other in turn."""
YIELD_M = 0.4e-3
"""Contacts yield up to this; a tip further from the stick, or deeper in it, is misplaced."""
OUT_M = 0.02e-3
"""A tip further outside than this is misplaced: it is touched."""
ACCUSE_NATS = 6.0
"""A fault must raise the likelihood of the judging samples by this."""
BLUR_M = 1e-5
"""The geometry is at least so uncertain."""
MOVED_M = 5e-5
"""Blur while a misplaced tip is moved."""
GRASP = "not identifiable from this log: record --protocol grasp with the channels {}"
MISPLACED = (
    "not identifiable from this log: stick and joints put {} elsewhere than where they touch; mend "
    "the stick's radius, the joints' zero or the contact's softness first"
)


def feel(log: Log, nominal: Spec, catalogue: Mapping[str, type[Effect]]) -> Report:
    """The touch effects that a log shows, and which of them it cannot show."""
    sought: list[str] = [name for name in EFFECTS if name in catalogue]
    parts = [part for part in held(log, nominal) if part.touch is not None]
    if not sought:
        return Report()
    if not parts:
        return Report(missing=(f"{', '.join(sought)}: {GRASP.format('stick and contact')}",))
    grid = np.stack([taxel_grid(t, nominal.hand.taxels)[0] for t in nominal.hand.fingertips])
    if parts[0].taxels != grid.shape[:2]:
        why = f"the log has {parts[0].taxels} taxels, the hand {grid.shape[:2]}"
        return Report(missing=(f"{', '.join(sought)}: {why}",))
    binary = log.meta.channels["touch"].unit == "1"
    mute = [] if binary else [name for name in sought if name in ANSWERS]
    missing: tuple[str, ...] = (
        (f"{', '.join(mute)}: {GRASP.format('stick and contact')}",) if mute else ()
    )
    blur = max(blur_m(nominal, part) for part in parts)
    if blur > BLUR_M:
        parts, blur = [smoothed(part) for part in parts], blur * CALMER
    pressed = [_pressed(nominal, part, binary) for part in parts]
    halves = _split([data for data, _ in pressed])
    wrong = sorted({nominal.hand.fingertips[f].finger for _, fingers in pressed for f in fingers})
    if wrong and binary and "taxel-threshold" in sought:
        mute.append("taxel-threshold")
        missing += (f"taxel-threshold: {MISPLACED.format(', '.join(wrong))}",)
    taxels = nominal.hand.taxels
    start = Faults(threshold_m=taxels.threshold_m, blur_m=max(BLUR_M, blur))
    found = _search(Skins(halves, grid), start, [n for n in sought if n not in mute])
    beyond = [_beyond(f, getattr(taxels, EFFECTS.get(f.effect, ""), 0.0)) for f in found]
    return Report(findings=tuple(f for f in beyond if _is_new(f)), missing=missing)


def _beyond(found: Finding, known: float) -> Finding:
    """A finding without what is nominal."""
    low, high = found.interval
    return replace(found, value=found.value - known, interval=(low - known, high - known))


def _is_new(found: Finding) -> bool:
    return found.effect == UNKNOWN or not found.interval[0] <= 0.0 <= found.interval[1]


def _pressed(nominal: Spec, part: Held, binary: bool) -> tuple[Pressed, list[int]]:
    """Thinned samples, and the fingers that the geometry puts elsewhere than they are."""
    step = max(round(PERIOD_S / float(np.median(np.diff(part.time_s)))), 1)
    part = part.every(np.arange(step, len(part.time_s), step))
    gap_m, touch = gaps_m(nominal, part), part.touch
    assert touch is not None
    data = Pressed(
        time_s=part.time_s,
        depth_m=pressed_m(nominal, part),
        reading=touch,
        touched=touch.any(axis=2) | (gap_m < OUT_M),
        binary=binary,
    )
    off = np.median(gap_m, axis=0)
    wrong = [f for f in range(len(off)) if not -YIELD_M <= off[f] <= OUT_M]
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
    """Two halves that judge each other: every second block of every episode."""
    turns = [np.floor(part.time_s / BLOCK_S) % 2 == 0 for part in parts]
    one = [part.some(turn) for part, turn in zip(parts, turns, strict=True)]
    other = [part.some(~turn) for part, turn in zip(parts, turns, strict=True)]
    return joined(one), joined(other)


class Skins:
    """All samples, and both halves that judge each other."""

    def __init__(self, halves: tuple[Pressed, Pressed], grid: Array) -> None:
        self._fits = [Fitting(half, grid) for half in halves]
        self.whole = Fitting(joined(halves), grid)

    def lead(self, effect: str, faults: Faults) -> float:
        """How much better an effect fitted to one half explains the other one [nats]."""
        gain = 0.0
        for fit, judge in (self._fits, self._fits[::-1]):
            guess = fit.guess(effect, faults)
            if guess is not None:
                gain += judge.nats(guess.faults) - judge.nats(faults)
        return gain


def _search(skins: Skins, start: Faults, sought: list[str]) -> tuple[Finding, ...]:
    """Faults one after the other, the clearest first, while halves ask for one."""
    found: list[tuple[Guess, float, tuple[str, ...]]] = []
    faults, skin = start, skins.whole
    while sought:
        leads = {name: skins.lead(name, faults) for name in sought}
        best = max(leads, key=lambda name: leads[name])
        guess = skin.guess(best, faults)
        if guess is None or leads[best] < ACCUSE_NATS:
            break
        lead = leads.pop(best)
        near = tuple(n for n, other in leads.items() if lead - other < rules().tie_nats)
        found.append((guess, min([lead, *(lead - other for other in leads.values())]), near))
        faults, sought = guess.faults, [name for name in sought if name != best]
    before, after = skin.gap(start), skin.gap(faults)
    explained = share(before, after) >= rules().explained_share
    if after > rules().settled_gap and not explained:
        return (_unknown(before, after, [g.effect for g, _, _ in found]),)
    return tuple(
        Finding(
            effect=guess.effect,
            joint=None,
            value=guess.value,
            interval=guess.interval,
            share=share(before, after),
            gap_before=before,
            gap_after=after,
            confidence=confidence(lead),
            ties=near,
            evidence=guess.evidence,
        )
        for guess, lead, near in found
    )


def _unknown(before: float, after: float, tried: list[str]) -> Finding:
    return Finding(
        effect=UNKNOWN,
        joint=None,
        value=0.0,
        interval=(0.0, 0.0),
        share=share(before, after),
        gap_before=before,
        gap_after=after,
        confidence=confidence(after**2 - 1),
        ties=tuple(tried),
        evidence="taxels answer elsewhere than where stick and joints say that they are pressed",
    )
