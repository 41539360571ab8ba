"""Which experiment would tell two worlds apart that a log cannot: tried in simulation.

Both fitted worlds go through what the log lacks, a channel or a protocol. Their distance counts
after the rival has given way: its nominal parameters and magnitude move, to first order, as far as
the log leaves them free. What remains is how much worse it would fit if the other world were real.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.attribute import Ranked
from diagnosis.attribution.candidates import nuisances
from diagnosis.attribution.evidence import FAR, USED, Evidence
from diagnosis.attribution.profile import GROW, LOOSE, STEP, grown
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import LimbVerdict
from diagnosis.recording.excitation import FREE, RATE_HZ, hand_joints
from diagnosis.replay.replay import CHANNELS, Commands, replay

LOGGING = {"motor": "log the motor angle", "torque": "log the drive torque"}
"""What to do for a channel that a log may lack."""
TOGETHER = "all of these together"
PROBE = 0.05
"""Change of a nominal parameter, relative, that shows whether a log tells anything of a joint."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Something that a log lacks."""

    what: str
    """What to do, such as 'log the drive torque'."""
    parts: tuple[tuple[int, Array], ...]
    """Episodes by number, and which channels and joints of each are compared, bool (C, J)."""


class Trials:
    """Rivals of one limb's verdict, put through the experiments that its log lacks.

    Of several settings, under the first.
    """

    def __init__(self, limb: LimbVerdict) -> None:
        self._fitter, self._fit = limb.attribution.fitter, limb.chosen.fit
        self._evidence = self._fitter.evidence.settings[0]
        self._episodes, self.experiments, self._log = _experiments(self._evidence)
        here = self._fit.deviations
        self._base = self._shown(self._fit.effects, here)
        self._slopes = self._differences(
            [(self._fit.effects, here + STEP * unit) for unit in np.eye(len(here))],
            self._base,
            STEP,
        )

    def separations(self, rival: Ranked) -> dict[str, float]:
        """Separation from a rival [standard deviations] by experiment, the widest first."""
        fit, free = rival.fit, self._fitter.free(rival.fit.effects)
        base = self._shown(fit.effects, fit.deviations)
        larger = [
            (*fit.effects[:k], grown(effect, 1 + GROW), *fit.effects[k + 1 :])
            for k, effect in enumerate(fit.effects)
        ]
        gives = self._differences([(e, fit.deviations) for e in larger], base, GROW)
        slopes = [np.concatenate([s[free], g]) for s, g in zip(self._slopes, gives, strict=True)]
        apart = [a - b for a, b in zip(self._base, base, strict=True)]
        prior = np.diag([*np.ones(free.sum()), *np.full(len(larger), LOOSE)])
        known = prior + _square(_pick(slopes, self._log))
        found = {
            e.what: _separation(_pick(apart, e), _pick(slopes, e), known) for e in self.experiments
        }
        return dict(sorted(found.items(), key=lambda pair: -pair[1]))

    def _shown(self, effects: Sequence[Effect], deviations: Array) -> list[Array]:
        """What is new in what a world shows in every episode, see `whiten`, each (C, T, J)."""
        fitter, rows = self._fitter, [CHANNELS.index(name) for name in USED]
        shifted = [n.at(d) for n, d in zip(fitter.nuisances, deviations, strict=True) if d != 0.0]
        evidence, own = self._evidence, len(self._evidence.recordings)
        world = evidence.world([*shifted, *effects])
        strides = [evidence.stride if k < own else 1 for k in range(len(self._episodes))]
        shown = [
            evidence.whitened(replay(world, c)[rows, ::stride])
            for c, stride in zip(self._episodes, strides, strict=True)
        ]
        return [np.clip(np.nan_to_num(s, nan=FAR), -FAR, FAR) for s in shown]

    def _differences(
        self, worlds: list[tuple[Sequence[Effect], Array]], base: list[Array], step: float
    ) -> list[Array]:
        """Slopes by episode, each (worlds, C, T, J)."""
        shown = [self._shown(effects, deviations) for effects, deviations in worlds]
        return [
            np.stack([(one[k] - b) / step for one in shown]) if shown else np.zeros((0, *b.shape))
            for k, b in enumerate(base)
        ]


def _separation(apart: Array, slopes: Array, known: Array) -> float:
    """Root of what is left of a squared distance after a linear refit.

    `known` holds what log and prior say of the parameters, as an inverse covariance.
    """
    pull = slopes @ apart
    given = pull @ np.linalg.solve(known + _square(slopes), pull)
    return float(np.sqrt(max(apart @ apart - given, 0.0)))


def _square(slopes: Array) -> Array:
    return slopes @ slopes.T


def _pick(episodes: Sequence[Array], experiment: Experiment) -> Array:
    """What an experiment compares, the last three axes (C, T, J) made one."""
    parts = []
    for number, mask in experiment.parts:
        values = episodes[number]
        wide = np.broadcast_to(mask[:, None, :], values.shape[-3:])
        parts.append(values[..., wide])
    return np.concatenate(parts, axis=-1)


def _experiments(evidence: Evidence) -> tuple[list[Commands], list[Experiment], Experiment]:
    """Episodes to replay, the experiments that are lacking, and what the log has."""
    own = [recording.commands for recording in evidence.recordings]
    logged = [np.isfinite(r.measured).any(axis=1) for r in evidence.recordings]
    have, numbers = np.any(logged, axis=0), range(len(own))
    done = {recording.protocol for recording in evidence.recordings}
    lacking = []
    for channel, text in LOGGING.items():
        row = (np.array(USED) == channel)[:, None]
        parts = tuple((k, row & ~logged[k]) for k in numbers if (row & ~logged[k]).any())
        if parts:
            lacking.append(Experiment(what=text, parts=parts))
    played = {name: c for name in FREE if name not in done and (c := _played(evidence, name))}
    for number, name in enumerate(played, start=len(own)):
        lacking.append(Experiment(what=f"record --protocol {name}", parts=((number, have),)))
    if len(lacking) > 1:
        new = [(len(own) + k, np.ones_like(have)) for k in range(len(played))]
        lacking.append(Experiment(what=TOGETHER, parts=(*((k, ~logged[k]) for k in numbers), *new)))
    log = Experiment(what="the log", parts=tuple(zip(numbers, logged, strict=True)))
    return [*own, *played.values()], lacking, log


def _played(evidence: Evidence, protocol: str) -> Commands | None:
    """A protocol's commands at the log's rate; None where the joints have no bounds to move in."""
    joints, dt_s = hand_joints(evidence.nominal.hand), evidence.nominal.timing.drive_s
    ticks = np.median(np.diff(evidence.recordings[0].commands.ticks))
    motion = FREE[protocol](joints, min(1 / (ticks * dt_s), RATE_HZ))
    if not (np.isfinite(motion.target_rad).all() and np.isfinite(motion.push_nm).all()):
        return None
    return Commands(
        ticks=np.round(motion.t_s / dt_s).astype(np.int64),
        target=motion.target_rad,
        load=motion.push_nm,
        start=motion.target_rad[0],
    )


def tie(limb: LimbVerdict, rival: Ranked, trials: Trials) -> dict:
    """Two worlds that a log cannot tell apart, and the experiment that would.

    `experiment` is None where none separates them by what a verdict needs.
    """
    found, needed = trials.separations(rival), np.sqrt(2 * rules().tie_nats)
    single = {what: apart for what, apart in found.items() if what != TOGETHER}
    enough = [what for what, apart in (*single.items(), *found.items()) if apart >= needed]
    return {
        "effects": [limb.names[0], rival.names[0]],
        "joints": [limb.chosen.joints[0], rival.joints[0]],
        "apart_nats": rival.fit.cost - limb.chosen.fit.cost,
        "experiment": enough[0] if enough else None,
        "needed_sd": float(needed),
        "separations_sd": found,
    }


def told_of(evidence: Evidence, catalogue: Mapping[str, type[Effect]]) -> tuple[str, ...]:
    """Joints of which the samples tell anything: where some nominal parameter shows.

    It shows when a change of 5 % moves the readings by a standard deviation in all.
    """
    base, seen = evidence.innovations((), compress=False), set()
    for probe in nuisances(evidence.nominal, PROBE):
        if probe.joint is not None and probe.joint not in seen:
            moved = evidence.innovations([probe.at(1.0)], compress=False) - base
            if moved @ moved >= 1.0:
                seen.add(probe.joint)
    return tuple(joint for joint in evidence.joints if joint in seen)
