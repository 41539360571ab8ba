"""What is wrong with a skin: threshold, drift, dead taxels, a halo; told without any dynamics.

Where stick and joints are known, geometry says what every taxel should answer. Faults are added one
after the other, each the one that samples held out bear out most.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from backends.touch import taxel_grid
from diagnosis._skin import Faults, Pressed, gap, joined, nats
from diagnosis.finding import Finding, Report, confidence, share
from diagnosis.held import CALMER, Held, blur_m, gaps_m, held, pressed_m, smoothed
from diagnosis.log import Log
from diagnosis.verdict import UNKNOWN, rules

EFFECTS = ("taxel-threshold", "taxel-drift", "taxel-dropout", "taxel-halo")
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
CLOSE_NATS = 1.35
"""Half of the 90 % point of a squared normal number: ends of an interval."""
BLUR_M = 1e-5
"""The geometry is at least so uncertain."""
THRESHOLDS_M = np.linspace(-0.19e-3, 1e-3, 25)
FINER = np.arange(-5, 6) / 5
"""Steps around the best threshold, in steps of the first grid."""
HALO_M = 0.02
"""The widest halo."""
DRIFTS_M_S = np.concatenate([[0.0], np.geomspace(1e-6, 1e-3, 97)])
DEAD_SHARES = np.linspace(0.0, 1.0, 101)
MOVED_M = 5e-5
"""Blur while a misplaced tip is moved."""
NEXT_M = 1e-5
"""Distances between taxels that differ by less are one."""
GRASP = "not identifiable from this log: record --protocol grasp with the channels {}"
MISPLACED = (
    "not identifiable from this log: stick and joints put {} elsewhere than where they touch; mend "
    "the stick's radius, the joints' zero or the contact's softness first"
)


@dataclass(frozen=True, kw_only=True)
class Guess:
    """A fault of the size that fits best."""

    effect: str
    value: float
    interval: tuple[float, float]
    faults: Faults
    """The skin with it."""
    evidence: str


def feel(log: Log, nominal: Spec, catalogue: Mapping[str, type[Effect]]) -> Report:
    """The touch effects that a log shows, and which of them it cannot show."""
    sought = [name for name in EFFECTS if name in catalogue]
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
    start = Faults(threshold_m=nominal.hand.taxels.threshold_m, blur_m=max(BLUR_M, blur))
    found = _search(Skins(halves, grid), start, [n for n in sought if n not in mute])
    return Report(findings=found, missing=missing)


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


class Fitting:
    """Fits of one fault at a time beside those that are there already."""

    def __init__(self, data: Pressed, grid: Array) -> None:
        self._data = data
        self._apart = np.linalg.norm(grid[:, :, None] - grid[:, None], axis=-1)

    def guess(self, effect: str, faults: Faults) -> Guess | None:
        """The best size of an effect; None where it is none."""
        return {
            "taxel-threshold": self._threshold,
            "taxel-drift": self._drift,
            "taxel-dropout": self._dead,
            "taxel-halo": self._halo,
        }[effect](faults)

    def nats(self, faults: Faults) -> float:
        """Log-likelihood of the samples [nats]."""
        return float(nats(self._data, faults, self._near(faults)).sum())

    def gap(self, faults: Faults) -> float:
        """See `_skin.gap`."""
        return gap(self._data, faults, self._near(faults))

    def _near(self, faults: Faults) -> list[Array] | None:
        return [d < faults.halo_m for d in self._apart] if faults.halo_m > 0 else None

    def _threshold(self, faults: Faults) -> Guess | None:
        best, low, high = self._best_threshold(faults, THRESHOLDS_M)
        finer = best + (THRESHOLDS_M[1] - THRESHOLDS_M[0]) * FINER
        best, low, high = self._best_threshold(faults, finer)
        if low <= faults.threshold_m <= high:
            return None
        size, ends = best - faults.threshold_m, np.array([low, high]) - faults.threshold_m
        return Guess(
            effect="taxel-threshold",
            value=size,
            interval=(float(ends[0]), float(ends[1])),
            faults=replace(faults, threshold_m=best),
            evidence=f"taxels answer from {1e3 * size:+.2f} mm of press beyond the nominal on",
        )

    def _best_threshold(self, faults: Faults, values: Array) -> tuple[float, float, float]:
        tries = [self.nats(replace(faults, threshold_m=float(t))) for t in values]
        return profile(values, np.array(tries))

    def _halo(self, faults: Faults) -> Guess | None:
        steps = np.unique(np.round(self._apart / NEXT_M)) * NEXT_M
        ends = np.append(steps[steps <= HALO_M], HALO_M)
        middles = (ends[:-1] + ends[1:]) / 2
        tries = [replace(faults, halo_m=float(m)) for m in middles]
        scores = np.array([self.nats(t) for t in tries])
        best = int(np.argmax(scores))
        if best == 0:
            return None
        good = np.flatnonzero(scores > scores[best] - CLOSE_NATS)
        return Guess(
            effect="taxel-halo",
            value=float(middles[best]),
            interval=(float(ends[good[0]]), float(ends[good[-1] + 1])),
            faults=tries[best],
            evidence=f"taxels answer within {1e3 * middles[best]:.1f} mm of a pressed one",
        )

    def _drift(self, faults: Faults) -> Guess | None:
        evidence, mean = self._drifting(faults)
        best, low, high = profile(DRIFTS_M_S[1:], evidence.sum(axis=(1, 2)))
        k = int(np.searchsorted(DRIFTS_M_S[1:], best))
        if k == 0:
            return None
        return Guess(
            effect="taxel-drift",
            value=best,
            interval=(low, high * DRIFTS_M_S[2] / DRIFTS_M_S[1]),
            faults=replace(faults, slope_m_s=mean[k], fastest_m_s=best),
            evidence=f"readings grow by up to {1e3 * best:.3g} mm/s, pressed or not",
        )

    def _drifting(self, faults: Faults) -> tuple[Array, Array]:
        """Log-evidence of every taxel and its mean slope, by the fastest drift, (D, F, K).

        Slopes are spread evenly between none and the fastest.
        """
        near, slope = self._near(faults), DRIFTS_M_S[:, None, None]
        each = np.stack(
            [nats(self._data, replace(faults, slope_m_s=a), near).sum(axis=0) for a in slope]
        )
        top = each.max(axis=0)
        likely, width = np.exp(each - top), np.diff(slope, axis=0)
        area, moment = (
            np.cumsum(width * (v[1:] + v[:-1]) / 2, axis=0) for v in (likely, likely * slope)
        )
        return np.log(area / slope[1:]) + top, moment / area

    def _dead(self, faults: Faults) -> Guess | None:
        none = np.zeros(self._apart.shape[:2], dtype=bool)
        near = self._near(faults)
        dead = nats(self._data, replace(faults, dead=~none), near).sum(axis=0)
        if faults.fastest_m_s > 0:  # a living taxel would drift
            fastest = int(np.searchsorted(DRIFTS_M_S[1:], faults.fastest_m_s))
            alive = self._drifting(faults)[0][fastest]
        else:
            alive = nats(self._data, replace(faults, dead=none), near).sum(axis=0)
        shares = DEAD_SHARES[:, None, None]
        with np.errstate(divide="ignore"):
            each = np.logaddexp(np.log(1 - shares) + alive, np.log(shares) + dead)
        best, low, high = profile(DEAD_SHARES, each.sum(axis=(1, 2)))
        silent = dead - alive > np.log(1 / max(best, 1e-9))
        if best == 0.0 or not silent.any():
            return None
        known = int((np.abs(dead - alive) > 1.0).sum())
        return Guess(
            effect="taxel-dropout",
            value=best,
            interval=(max(low, 0.0), min(high, 1.0)),
            faults=replace(faults, dead=silent),
            evidence=f"{int(silent.sum())} of {known} taxels that should answer never do",
        )


def profile(values: Array, scores: Array) -> tuple[float, float, float]:
    """The best of some values and its 90 % interval."""
    best = int(np.argmax(scores))
    good = np.flatnonzero(scores > scores[best] - CLOSE_NATS)
    half = (values[1] - values[0]) / 2
    return float(values[best]), float(values[good[0]] - half), float(values[good[-1]] + half)
