"""Fingerprints of random effects, which no replay shows: noise, encoder steps, lost packets.

Noise is what third differences leave where the motion is quiet: it is there at rest as well, unlike
anything that moves. Steps quantise every reading. Lost packets are decoded (`losses`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from backends.effect import Effect
from backends.spec import Encoder
from backends.state import Array
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import UNKNOWN
from diagnosis.beside.sensing import Finding, together
from diagnosis.beside.slow import is_slow
from diagnosis.finding import Finding as Beside
from diagnosis.finding import gap, share
from diagnosis.replay.replay import replay as play

LEAST_STEP_RAD = 1e-5
"""Finer steps are how numbers are stored, not how an encoder reads."""
SAME_RAD = 1e-7
"""Readings this near are one: 32-bit floats."""
LEAST_LEVELS, ON_COMB = 6, 0.02
"""A quantised signal has so many levels; each lies within this share of a step of its place. By
chance six do with probability 3e-6."""
WINDOW = 24
"""Samples in a window of which the noise is taken."""
QUIET = 0.25
"""Noise is the variance that this share of all windows stays under, corrected for the choice."""
WHITE, DEGREES = (2.6, 4.2), 9.35
"""Fourth over third differences' variance of white noise is 70 / 20; smooth motion has less than 1.
Degrees of freedom in a window: 21 third differences with correlations -0.75, 0.3 and -0.05."""
LEAST_NOISE_RAD, LEAST_EXCESS = 2e-5, 1.25
"""Smallest noise, and smallest ratio to the nominal one, that is worth a finding. Quiet windows of
nominal worlds have under 0.001 mrad on every engine."""
RESAMPLES = 200


@dataclass(frozen=True, kw_only=True)
class Comb:
    """Quantised readings."""

    step_rad: float
    half_width_rad: float
    """Half of the interval of the step."""
    levels: int


@dataclass(frozen=True, kw_only=True)
class Noise:
    """White noise of readings."""

    std_rad: float
    interval_rad: tuple[float, float]
    lead_nats: float
    """Log-likelihood of the quiet windows' variance over that of the nominal noise."""


def sensors(
    parts: Sequence[Evidence], catalogue: Mapping[str, type[Effect]]
) -> tuple[Finding, ...]:
    """Noise and steps of the position sensors; in slow logs motion is as rough as noise.

    Readings that are noisier than the nominal sensor's by neither are an unknown gap: replays take
    noise as it is.
    """
    steps: list[Finding] = []
    noises: list[Finding] = []
    unknown: list[Finding] = []
    for part in parts:
        residuals = [r.measured[0] - play(part.nominal, r.commands)[0] for r in part.recordings]
        for j, body in enumerate(part.nominal.hand.driven):
            readings = np.concatenate([r.measured[0, :, j] for r in part.recordings])
            left = [residual[:, j] for residual in residuals]
            teeth, known = comb(readings), body.joint.encoder
            joint = body.joint.name
            found = [len(steps), len(noises)]
            if teeth is not None and "encoder-resolution" in catalogue:
                steps += _resolution(joint, teeth, known, np.concatenate(left))
            if "encoder-noise" in catalogue and not is_slow(part):
                noises += _noise(joint, left, teeth, known)
            if found == [len(steps), len(noises)] and not is_slow(part):
                unknown += _louder(joint, left, known)
    names = [name for part in parts for name in part.joints]
    return (*together(steps, names), *together(noises, names), *together(unknown, names))


def widened(part: Evidence, found: Sequence[Beside]) -> Evidence:
    """Evidence whose position residuals allow for half of the steps that were found.

    Their error is white where a joint moves and stays as long as it holds, so both parts of a
    residual allow for it, and for its largest size rather than its spread.
    """
    sigma, floor = part.sigma.copy(), part.floor.copy()
    for one in found:
        for j, name in enumerate(part.joints):
            if one.effect == "encoder-resolution" and name in one.joints:
                error = one.value / 2
                floor[0, 0, j] = np.hypot(floor[0, 0, j], error)
                sigma[0, 0, j] = np.hypot(sigma[0, 0, j], np.sqrt(2) * error)
    return replace(part, sigma=sigma, floor=floor)


def comb(readings: Array) -> Comb | None:
    """The quantisation of readings (n,) [rad], at any offset; None where there is none."""
    values = np.unique(readings)
    levels = values[np.diff(values, prepend=-np.inf) > SAME_RAD]
    if len(levels) < LEAST_LEVELS:
        return None
    apart = np.diff(levels)
    step = float(apart.min())
    if step < LEAST_STEP_RAD:
        return None
    place = np.concatenate([[0], np.cumsum(np.round(apart / step))])
    step, start = np.polyfit(place, levels, 1)
    off = levels - start - step * place
    if np.abs(off).max() > ON_COMB * step:
        return None
    width = 3 * max(float(off.std()), 1e-9) / float(place[-1])
    return Comb(step_rad=float(step), half_width_rad=width, levels=len(levels))


def white_noise(residuals: Sequence[Array], nominal_rad: float, seed: int = 0) -> Noise | None:
    """White noise in episodes' residuals, each (T,) [rad]; None where what is left is not white."""
    squares = [_windows(r) for r in residuals if len(r) >= WINDOW]
    if not squares:
        return None
    third, fourth = np.concatenate(squares, axis=1)
    quiet = third <= np.median(third)
    if not third[quiet].any():
        return None
    whiteness = fourth[quiet].mean() / third[quiet].mean()
    if not WHITE[0] < whiteness < WHITE[1]:
        return None
    draws = np.random.default_rng(seed).integers(len(third), size=(RESAMPLES, len(third)))
    std, ends = float(_quiet_std(third)), np.percentile(_quiet_std(third[draws]), [5, 95])
    ratio = (std / max(nominal_rad, LEAST_NOISE_RAD)) ** 2
    lead = QUIET * len(third) * DEGREES / 2 * (ratio - 1 - np.log(max(ratio, 1e-12)))
    return Noise(
        std_rad=std,
        interval_rad=(float(ends[0]), float(ends[1])),
        lead_nats=float(lead) if ratio > 1 else 0.0,
    )


def _windows(residual: Array) -> Array:
    """Mean squared third and fourth differences by window, (2, W)."""
    count = len(residual) // WINDOW
    windows = residual[: count * WINDOW].reshape(count, WINDOW)
    return np.stack([(np.diff(windows, n=n, axis=1) ** 2).mean(axis=1) for n in (3, 4)])


def _quiet_std(third: Array) -> Array:
    """Standard deviation of white noise from squared third differences (..., W)."""
    usual = chi2.ppf(QUIET, DEGREES) / DEGREES
    return np.sqrt(np.quantile(third, QUIET, axis=-1) / usual / 20)


def _resolution(joint: str, teeth: Comb, known: Encoder, residual: Array) -> list[Finding]:
    excess = teeth.step_rad - known.resolution_rad
    if excess < max(LEAST_STEP_RAD, 3 * teeth.half_width_rad):
        return []
    before, after = _gaps(residual, known, teeth.step_rad, known.noise_rad)
    return [
        Finding(
            effect="encoder-resolution",
            joint=joint,
            joints=(joint,),
            value=excess,
            interval=(excess - teeth.half_width_rad, excess + teeth.half_width_rad),
            share=share(before, after),
            gap_before=before,
            gap_after=after,
            lead_nats=float(-np.log(2 * ON_COMB) * (teeth.levels - 2)),
            evidence=f"all readings lie on {teeth.levels} levels, "
            f"{1e3 * teeth.step_rad:.4g} mrad apart",
        )
    ]


def _noise(
    joint: str, residuals: Sequence[Array], teeth: Comb | None, known: Encoder
) -> list[Finding]:
    found = white_noise(residuals, known.noise_rad)
    if found is None:
        return []
    step = known.resolution_rad if teeth is None else teeth.step_rad
    if found.std_rad < step / 2:
        return []  # the comb hides it
    std, *ends = (
        float(np.sqrt(max(s**2 - step**2 / 12, 0.0))) for s in (found.std_rad, *found.interval_rad)
    )
    if std < max(LEAST_EXCESS * known.noise_rad, known.noise_rad + LEAST_NOISE_RAD):
        return []
    before, after = _gaps(np.concatenate(residuals), known, step, std)
    return [
        Finding(
            effect="encoder-noise",
            joint=joint,
            joints=(joint,),
            value=std - known.noise_rad,
            interval=(max(ends[0] - known.noise_rad, 0.0), ends[1] - known.noise_rad),
            share=share(before, after),
            gap_before=before,
            gap_after=after,
            lead_nats=found.lead_nats,
            evidence=f"readings have white noise of {1e3 * std:.3g} mrad where nothing moves",
        )
    ]


def _louder(joint: str, residuals: Sequence[Array], known: Encoder) -> list[Finding]:
    """White readings that are noisier than the nominal sensor's, by more than the model's floor."""
    expected = float(np.hypot(known.noise_rad, known.resolution_rad / np.sqrt(12)))
    sigma = float(np.hypot(expected, rules().floor_position_rad))
    found = white_noise(residuals, expected)
    if found is None or found.interval_rad[0] < max(LEAST_EXCESS * expected, sigma):
        return []
    left = gap(np.concatenate(residuals), sigma)
    return [
        Finding(
            effect=UNKNOWN,
            joint=joint,
            joints=(joint,),
            value=0.0,
            interval=(0.0, 0.0),
            share=0.0,
            gap_before=left,
            gap_after=left,
            lead_nats=found.lead_nats,
            evidence=f"readings have white noise of {1e3 * found.std_rad:.3g} mrad, more than the "
            f"sensor's {1e3 * expected:.3g} mrad",
        )
    ]


def _gaps(residual: Array, known: Encoder, step: float, noise: float) -> tuple[float, float]:
    """Gaps with the nominal sensor's errors and with those found."""
    floor = rules().floor_position_rad
    pairs = ((known.resolution_rad, known.noise_rad), (step, noise))
    before, after = (gap(residual, float(np.sqrt(floor**2 + s**2 / 12 + n**2))) for s, n in pairs)
    return before, after
