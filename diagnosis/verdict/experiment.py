"""The experiment that distinguishes tied causes: the protocol in which their worlds differ most."""

from collections.abc import Mapping, Sequence
from itertools import chain

import numpy as np

from backends.state import Array
from diagnosis.motion.columns import LIMIT
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import CHANNELS, Recording
from diagnosis.recording.excitation import FREE, Joints
from diagnosis.search.fit import Fit, Fitter

CLEAR = 2.0
"""Worlds that differ by so many floors are distinguished."""
PASSES = 2
"""A motion is expanded about its target, then about what comes of that."""
TORQUE = CHANNELS.index("torque")


def experiment(fitter: Fitter, chosen: Fit, tied: Sequence[Fit]) -> str:
    """What to record, as a clause, to tell a fit from others.

    With the channels of the log, or with torques as well where those show no difference.
    """
    worlds = chosen.u, [fit.u for fit in tied]
    apart = {name: _apart(fitter, _limb(fitter, name, chosen.u), *worlds) for name in FREE}
    for more, what in enumerate(("", " and log the torques that the drives ask for")):
        best = max(apart, key=lambda name: apart[name][more])
        if apart[best][more] >= CLEAR:
            floors = f"{apart[best][more]:.0f} times the noise floor"
            return f"record --protocol {best}{what}: there they differ by {floors}"
    causes = chain.from_iterable(fit.freed for fit in (chosen, *tied))
    loads = all(fitter.parameters[k].kind.is_of("body") for k in causes)
    first = "weigh these links" if loads else "log the motor's angle as well"
    return f"{first}: no protocol of joints alone shows the difference"


def _limb(fitter: Fitter, protocol: str, u: Mapping[int, float]) -> Limb:
    """The limb under a protocol within what the log commanded, along the motion with u."""
    limb = fitter.evidence.limb
    command = np.concatenate([one.command for one in limb.recordings])
    asked = FREE[protocol](
        Joints(
            names=limb.joints,
            center_rad=np.median(command, axis=0),
            range_rad=np.stack([command.min(axis=0), command.max(axis=0)], axis=1),
            limit_nm=limb.nominal[:, LIMIT],
        ),
        1.0 / limb.period_s,
    )
    measured = np.repeat(asked.target_rad[:, None], len(CHANNELS), axis=1)
    for _ in range(PASSES):
        along = Recording(
            protocol=protocol,
            time_s=asked.t_s,
            command=asked.target_rad,
            push=asked.push_nm,
            measured=measured,
            start=asked.target_rad[0],
        )
        limb = Limb(spec=limb.spec, recordings=(along,), rigid=limb.rigid)
        measured = np.nan_to_num(limb.simulate(*fitter.numbers(u), edges=limb.every_sample))
    return limb


def _apart(
    fitter: Fitter, limb: Limb, chosen: Mapping[int, float], tied: Sequence[Mapping[int, float]]
) -> tuple[float, float]:
    """How far the nearest of the tied worlds is [floors]: in channels as logged, and in torques."""
    shown = limb.simulate(*fitter.numbers(chosen))
    others = (limb.simulate(*fitter.numbers(u)) for u in tied)
    gaps = [np.nan_to_num((other - shown) / fitter.evidence.floor) for other in others]
    logged = fitter.evidence.logged.any(axis=2).T
    return min(_rms(gap[:, logged]) for gap in gaps), min(_rms(gap[:, TORQUE]) for gap in gaps)


def _rms(gap: Array) -> float:
    """The largest root mean square of a column of (N, M)."""
    return float(np.sqrt(np.mean(gap**2, axis=0)).max(initial=0.0))
