"""Fits of one fault of a skin at a time: its best size, interval and what the skin then is."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from backends.state import Array
from backends.touch import THRESHOLD_M
from diagnosis.skin.forward_model import SHARP, Faults, Pressed, alone, gap, nats
from diagnosis.skin.gains import SPREADS, evidence, gains, hysteresis
from diagnosis.verdict.result import CLOSE_NATS

THRESHOLDS_M = np.linspace(-0.19e-3, 1e-3, 25)
FINER = np.arange(-5, 6) / 5
"""Steps around the best threshold, in steps of the first grid."""
HALO_M = 0.02
"""The widest halo."""
HALOS_M, NEARER_M = np.arange(2e-3, 14.5e-3, 1e-3), np.arange(-7.5e-4, 8e-4, 2.5e-4)
"""Halos that a drift is tried beside, and those around the best of them."""
DRIFTS_M_S = np.concatenate([[0.0], np.geomspace(1e-6, 1.15e-3, 99)])
ROUGH_M_S = DRIFTS_M_S[::3]
"""Slopes for a first look."""
AROUND = np.geomspace(0.93, 1.08, 10)
"""Factors of the best of these that are tried next."""
APART, EDGE = 0.02, 2 * SHARP
"""Times apart by less than this share are one; slopes so much to both sides tell them apart."""
DEAD_SHARES = np.linspace(0.0, 1.0, 101)
TURNS = 2
"""How often two faults are fitted in turns."""
THRESHOLD, DRIFT, DEAD, HALO = "threshold_m", "drift_m_s", "dead_share", "halo_m"
GAIN, HYSTERESIS = "gain_spread", "hysteresis"
"""Faults of a skin, as the numbers of `backends.spec.Taxels` that they change."""
FIELDS = {
    THRESHOLD: ("threshold_m",),
    DRIFT: ("slope_m_s", "fastest_m_s"),
    DEAD: ("dead", "dead_share"),
    HALO: ("halo_m",),
    GAIN: ("gain",),
    HYSTERESIS: ("hysteresis",),
}
"""Numbers of `Faults` that a fault is."""
NEXT_M = 1e-5
"""Distances between taxels that differ by less are one."""


@dataclass(frozen=True, kw_only=True)
class Guess:
    """A fault of the size that fits best."""

    fault: str
    """One of `FIELDS`."""
    value: float
    """In all, with what is nominal."""
    interval: tuple[float, float]
    faults: Faults
    """The skin with it."""
    evidence: str = ""
    extreme: bool = False
    """Whether the size is at an end of what there is, so that another may be meant."""


class Fitting:
    """Fits of one fault at a time beside those that are there already."""

    def __init__(self, data: Pressed, grid: Array) -> None:
        self._data = data
        self._apart = np.linalg.norm(grid[:, :, None] - grid[:, None], axis=-1)

    def guess(self, fault: str, faults: Faults) -> Guess | None:
        """The best size of a fault; None where it is none."""
        fits = (self._threshold, self._drift, self._dead, self._halo, self._gain, self._hysteresis)
        return dict(zip(FIELDS, fits, strict=True))[fault](faults)

    def together(self, names: tuple[str, ...], start: Faults) -> Faults:
        """The skin with one fault or two at the sizes that fit best together.

        Who answers late and wide looks like who answers early and less wide, and a guess of the one
        alone takes a part of the other. So a threshold is tried at several sizes, or the halo that
        a drift spreads by, and the rest in turns.
        """
        tries = [self.alone(name, start, start) for name in names]
        if len(names) == 1:
            return tries[0]
        if THRESHOLD in names:
            (other,) = {*names} - {THRESHOLD}
            tries += [self.alone(other, s, s) for s in _with(THRESHOLD, start, THRESHOLDS_M[::2])]
        elif {*names} == {DRIFT, HALO}:
            tries.append(self._spreading(start))
        best = max(tries, key=self.nats)
        for fault in names[::-1] * TURNS:
            best = self.alone(fault, start, best)
        return best

    def beside(self, fault: str, start: Faults, faults: Faults) -> Guess | None:
        """The best size of a fault beside the other faults of a skin."""
        return self.guess(fault, _without(fault, start, faults))

    def alone(self, fault: str, start: Faults, faults: Faults) -> Faults:
        """The skin with one of its faults fitted again, or without it where there is none."""
        guess = self.beside(fault, start, faults)
        return guess.faults if guess is not None else _without(fault, start, faults)

    def nats(self, faults: Faults) -> float:
        """Log-likelihood of the samples [nats]."""
        return float(nats(self._data, faults, self._near(faults)).sum())

    def gap(self, faults: Faults, finger: int | None = None) -> float:
        """See `forward_model.gap`."""
        return gap(self._data, faults, self._near(faults), finger)

    def _near(self, faults: Faults) -> Array | None:
        return self._apart < faults.halo_m if faults.halo_m > 0 else None

    def _threshold(self, faults: Faults) -> Guess | None:
        rough = self._swept(THRESHOLD, faults, THRESHOLDS_M)
        values = rough.value + (THRESHOLDS_M[1] - THRESHOLDS_M[0]) * FINER
        guess = self._swept(THRESHOLD, faults, values[values >= THRESHOLDS_M[0] - NEXT_M / 10])
        text = f"taxels respond from {1e3 * (THRESHOLD_M + guess.value):.2f} mm of press on"
        extreme = guess.value < THRESHOLDS_M[0] + NEXT_M / 10
        none = guess.interval[0] <= faults.threshold_m <= guess.interval[1]
        return None if none else replace(guess, evidence=text, extreme=extreme)

    def _swept(
        self, fault: str, faults: Faults, values: Array, ends: tuple[Array, Array] | None = None
    ) -> Guess:
        """The best of some sizes of a fault that is one number of a skin; see `_best`."""
        skins = _with(fault, faults, values)
        return _best(fault, values, [self.nats(one) for one in skins], skins.__getitem__, ends)

    def _halo(self, faults: Faults) -> Guess | None:
        steps = np.unique(np.round(self._apart / NEXT_M)) * NEXT_M
        ends = np.append(steps[steps <= HALO_M], HALO_M)
        middles = (ends[:-1] + ends[1:]) / 2
        guess = self._swept(HALO, faults, middles, (ends[:-1], ends[1:]))
        text = f"taxels respond within {1e3 * guess.value:.1f} mm of a pressed one"
        none = guess.value == middles[0]
        return None if none else replace(guess, value=sum(guess.interval) / 2, evidence=text)

    def _gain(self, faults: Faults) -> Guess | None:
        found = None if self._data.binary else gains(self._data, faults)
        if found is None:
            return None
        more, sd = found

        def skin(best: int) -> Faults:
            most = float(SPREADS[best])
            return replace(faults, gain=1.0 + np.clip(more, -most, most))

        guess = _best(GAIN, SPREADS, evidence(more, sd), skin)
        count, most = np.isfinite(sd).sum(), f"{100 * guess.value:.0f} %"
        return replace(guess, evidence=f"{count} taxels read up to {most} more or less")

    def _hysteresis(self, faults: Faults) -> Guess | None:
        found = hysteresis(self._data, faults)
        if found is None:
            return None
        sizes, scores = found
        guess = _best(HYSTERESIS, sizes, scores, _with(HYSTERESIS, faults, sizes).__getitem__)
        text = f"readings of an easing press are up to {100 * guess.value:.0f} % larger"
        return replace(guess, evidence=text, extreme=guess.value > 1.0 - NEXT_M)

    def _drift(self, faults: Faults) -> Guess | None:
        coarse, _ = self._drifts(faults, DRIFTS_M_S)
        near = int(np.argmax(coarse))
        if near == 0:
            return None
        tried = np.unique([*DRIFTS_M_S[: near + 1], *(DRIFTS_M_S[near + 1] * AROUND)])
        scores, mean = self._drifts(faults, tried)
        fastest, ends = tried[1:], (tried[:-1], np.append(tried[2:], tried[-1]))

        def skin(best: int) -> Faults:
            return replace(faults, slope_m_s=mean[best], fastest_m_s=float(fastest[best]))

        guess = _best(DRIFT, fastest, scores, skin, ends)
        text = f"readings grow by up to {1e3 * guess.value:.3g} mm/s, pressed or not"
        return replace(guess, evidence=text, extreme=guess.value > DRIFTS_M_S[-2])

    def _spreading(self, start: Faults) -> Faults:
        """A drift and the halo that it spreads by, roughly."""

        def drift(halo_m: float) -> Faults:
            skin = replace(start, halo_m=float(halo_m))
            scores, mean = self._drifts(skin, ROUGH_M_S)
            best = int(np.argmax(scores))
            return replace(skin, slope_m_s=mean[best], fastest_m_s=float(ROUGH_M_S[best + 1]))

        best = max(map(drift, HALOS_M), key=self.nats)
        return max(map(drift, best.halo_m + NEARER_M), key=self.nats)

    def _drifts(self, faults: Faults, slopes_m_s: Array) -> tuple[Array, Array]:
        """Log-evidence of the fastest drift (D - 1,) and the mean slopes that go with it.

        What never answered is slow, or one of the dead.
        """
        evidence, mean = self._drifting(faults, slopes_m_s)
        if faults.dead_share > 0:
            with np.errstate(divide="ignore"):  # where all are dead
                living = np.log1p(-faults.dead_share)
            dead = np.log(faults.dead_share) + self._silent(faults)
            evidence = np.logaddexp(living + evidence, dead)
        return evidence.sum(axis=(1, 2)), mean

    def _drifting(self, faults: Faults, slopes_m_s: Array) -> tuple[Array, Array]:
        """Log-evidence of every taxel that lives and its mean slope, (D - 1, F, K).

        Slopes are spread evenly between none and the fastest, which is any of `slopes_m_s` (D,)
        but the first. Beside a halo a taxel has drifted so far once all that it takes along answer.
        """
        near = self._near(faults)
        data = self._data if near is None else alone(self._data, faults, near)
        every = slopes_m_s
        if data.binary:  # and those on both sides of what reaches the level, from none, at a sample
            times_s = np.unique(np.round(data.time_s, 2))
            times_s = times_s[times_s > 0]
            times_s = times_s[np.diff(times_s, append=np.inf) > APART * times_s]
            crossing = np.outer(faults.level_m / times_s, (1 - EDGE, 1 + EDGE)).ravel()
            every = np.unique([*slopes_m_s, *crossing])
        every = every[every <= slopes_m_s[-1]]
        slope = every[:, None, None]
        each = np.stack([nats(data, replace(faults, slope_m_s=a)).sum(axis=0) for a in slope])
        top = each.max(axis=0)
        likely, width = np.exp(each - top), np.diff(slope, axis=0)
        area, moment = (
            np.cumsum(width * (v[1:] + v[:-1]) / 2, axis=0) for v in (likely, likely * slope)
        )
        asked = np.searchsorted(every, slopes_m_s[1:]) - 1
        area, moment = area[asked], moment[asked]
        return np.log(area / slopes_m_s[1:, None, None]) + top, moment / area

    def _silent(self, faults: Faults, dead: bool = True) -> Array:
        """Log-likelihood of every taxel where all are dead, or none, shape (F, K)."""
        skin = replace(faults, dead=np.full(self._apart.shape[:2], dead))
        return nats(self._data, skin, self._near(faults)).sum(axis=0)

    def _dead(self, faults: Faults) -> Guess | None:
        dead = self._silent(faults)
        if faults.fastest_m_s > 0:  # a living taxel would drift
            slopes = np.append(DRIFTS_M_S[faults.fastest_m_s > DRIFTS_M_S], faults.fastest_m_s)
            alive = self._drifting(faults, slopes)[0][-1]
        else:
            alive = self._silent(faults, dead=False)
        shares = DEAD_SHARES[:, None, None]
        with np.errstate(divide="ignore"):
            each = np.logaddexp(np.log(1 - shares) + alive, np.log(shares) + dead)

        def skin(best: int) -> Faults:
            share = float(DEAD_SHARES[best])
            silent = dead - alive > np.log(1 / max(share, 1e-9))
            return replace(faults, dead=silent, dead_share=share)

        guess = _best(DEAD, DEAD_SHARES, each.sum(axis=(1, 2)), skin)
        count = int(guess.faults.dead.sum())
        known = int((np.abs(dead - alive) > 1.0).sum())
        text = f"{count} of {known} taxels that should respond never do"
        return replace(guess, evidence=text) if guess.value and count else None


def _without(fault: str, start: Faults, faults: Faults) -> Faults:
    """A skin without one of its faults: with that of the one to start from."""
    return replace(faults, **{name: getattr(start, name) for name in FIELDS[fault]})


def _with(fault: str, faults: Faults, sizes: Array) -> list[Faults]:
    """A skin with each of some sizes of a fault that is one of its numbers."""
    every: list[dict[str, Any]] = [{fault: float(size)} for size in sizes]
    return [replace(faults, **one) for one in every]


def _best(
    fault: str,
    values: Array,
    scores: Sequence[float] | Array,
    skin: Callable[[int], Faults],
    ends: tuple[Array, Array] | None = None,
) -> Guess:
    """The best of some sizes (D,) with its 90 % interval, and its skin, by its number.

    `ends`: of what each size stands for; by default, of sizes that are evenly apart. Shares and
    lengths are not negative.
    """
    half = (values[1] - values[0]) / 2
    low, high = ends or (values - half, values + half)
    if values[0] >= 0.0:
        low = np.maximum(low, 0.0)
    best = int(np.argmax(scores))
    good = np.flatnonzero(np.asarray(scores) > scores[best] - CLOSE_NATS)
    interval = float(low[good[0]]), float(high[good[-1]])
    return Guess(fault=fault, value=float(values[best]), interval=interval, faults=skin(best))
