"""Who carries a joint's weight, and whether gravity pulls where the model says, by its sag."""

import numpy as np

from diagnosis.triage._sags import WRONG, Sags
from diagnosis.triage._signals import rms
from diagnosis.triage._tracks import BETTER, Fault, Track

ZEROS, FAR_RAD, SURE = np.radians(np.arange(-180, 181, 3)), np.pi / 4, 0.1
"""Zeros that are tried; a nearer one may be a tilt of gravity, which is an effect; the relative
misfit that names one."""
CARRIED = 0.2
"""Share of the expected sag up to which the weight is carried by something else."""


def weight(track: Track) -> Fault | None:
    """Another zero of both sides, or a weight that the PD law does not carry."""
    sags = Sags.of(track)
    wrong = sags.show_weight and sags.misfit() >= WRONG
    return (_zero(track, sags) or _carried(track, sags)) if wrong else None


def _zero(track: Track, sags: Sags) -> Fault | None:
    """Both sides far from the model's zero, or gravity that turns as far."""
    if track.slides:
        return None
    misfits = [sags.misfit(zero=zero) for zero in ZEROS]
    best = ZEROS[int(np.argmin(misfits))]
    better = sags.left(best) * BETTER < sags.left(biased=True)
    if min(misfits) > SURE or abs(best) < FAR_RAD or not better:
        return None
    far = f"{np.degrees(best):.0f} deg"
    return track.fault(
        "zero",
        f"positions and commands both stand {far} from the model's zero: so says the sag "
        "of the joint under its weight; or the robot is mounted so",
        f"subtract {far} from both, or turn gravity in the model",
    )


def _carried(track: Track, sags: Sags) -> Fault | None:
    """A weight that leaves no sag, where the nominal world moves as logged without weight."""
    sag, expected = rms(sags.errors), rms(sags.expected())
    if sags.beside.any() or sag > CARRIED * expected:
        return None
    if track.weightless().misfit * BETTER > track.misfit:
        return None
    return track.fault(
        "convention",
        f"at rest it is {1e3 * sag:.2g} mrad from its targets, where its weight "
        f"should hold it {1e3 * expected:.2g} mrad below",
        "the drive compensates gravity: say --gravity-compensation, or `gravity_compensation"
        ": true` under mechanism; or it has an integral: write its `ki`",
    )
