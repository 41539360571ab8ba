"""Which experiment would tell two worlds apart that a log cannot: tried in simulation.

Both fitted worlds go through what the log lacks, a channel or a protocol. Their distance counts
after the rival has given way: its nominal parameters and magnitude move, to first order, as far as
the log leaves them free. What remains is the rise of its cost if the other world is the real one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.attribute import Ranked
from diagnosis.candidates import nuisances
from diagnosis.evidence import FAR, USED, Evidence
from diagnosis.excitation import FREE, hand_joints
from diagnosis.fit import CORRELATED, CURVE, STEP, Fit, Fitter
from diagnosis.replay import CHANNELS, Commands, replay
from diagnosis.verdict import LimbVerdict, rules

LOGGING = {"motor": "log the motor angle", "torque": "log the drive torque"}
"""What to do for a channel that a log may lack."""
TOGETHER = "record all protocols with motor angle and drive torque"
ALIKE = "none known: in free air they are one and the same here"
PROBE = 0.05
"""Change of a nominal parameter, relative, that a joint's samples must show."""
WEAK = 1e-9
"""Keeps a magnitude that the log says nothing about solvable."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Something that the log lacks."""

    what: str
    """What to do, such as 'log the drive torque'."""
    channels: tuple[str, ...]
    """Channels that are compared."""
    commands: tuple[Commands, ...]
    """Episodes to replay."""


def experiments(evidence: Evidence) -> list[Experiment]:
    """What the evidence lacks: channels in its own episodes, protocols, and all of these."""
    have = _logged(evidence)
    own = tuple(recording.commands for recording in evidence.recordings)
    found = [
        Experiment(what=text, channels=(channel,), commands=own)
        for channel, text in LOGGING.items()
        if channel not in have
    ]
    done = {recording.protocol for recording in evidence.recordings}
    played = {name: _commands(evidence, name) for name in FREE if name not in done}
    found += [
        Experiment(what=f"record --protocol {name}", channels=have, commands=(commands,))
        for name, commands in played.items()
    ]
    everything = (*own, *played.values())
    return [*found, Experiment(what=TOGETHER, channels=USED, commands=everything)]


class Trials:
    """Rivals of one limb's verdict, put through the experiments."""

    def __init__(self, limb: LimbVerdict) -> None:
        self._fitter = limb.attribution.fitter
        self._chosen = limb.chosen.fit
        self._experiments = experiments(self._fitter.evidence)

    def apart(self, rival: Ranked) -> dict[str, float]:
        """Separation from a rival [standard deviations] by experiment, the best one first."""
        free = self._fitter.free(rival.fit.effects)
        known = np.diag([*np.ones(len(free)), *np.full(len(rival.fit.effects), WEAK)])
        log = self._slopes_on_log[:, free], self._give_on_log(rival.fit)
        known = known[np.r_[free, np.ones(len(rival.fit.effects), dtype=bool)]][
            :, np.r_[free, np.ones(len(rival.fit.effects), dtype=bool)]
        ]
        slopes = np.hstack(log)
        known = known + slopes.T @ slopes / CORRELATED
        found = {
            e.what: self._separation(e, slopes_at, rival.fit, free, known)
            for e, slopes_at in zip(self._experiments, self._slopes, strict=True)
        }
        return dict(sorted(found.items(), key=lambda pair: -pair[1]))
