"""How clearly an effect of touch, stick or contact shows: readings of a case with and without it.

The same motions and noise are repeated without the effect. Touch readings follow from geometry. The
motion of joints and stick in a grasp does not, and engines differ in it by more than the sensors'
noise. So an effect shows there only as far as its change exceeds the difference between engines.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.catalogue import catalogue
from backends.spec import Spec
from backends.state import Array
from diagnosis.blind import rigs
from diagnosis.blind.draw import Case
from diagnosis.blind.faults import Fault
from diagnosis.blind.grasp import GRASP, HOLDS
from diagnosis.blind.make import Simulate, case_rng, engine_readings, hidden_world, motions
from diagnosis.blind.motion import Motion
from diagnosis.blind.rigs import RATE_HZ, TORQUE_NOISE
from diagnosis.grasp.forward_model import ends_m
from diagnosis.grasp.slip_model import GONE_M, SLIPPED_M
from diagnosis.motion.held import tip_gaps_m

ALIKE_S = 0.5
"""Readings count as independent after this time, because a grasp moves slowly [s]."""
FLIP_NATS = 1.0
"""Information of a taxel that responds differently [nats]."""
SKIN = ("touch", "contact")
SLIP_NOISE = (0.005, 0.05)
"""Standard deviation of the logarithms of these pulls due to the tracker's noise."""


@dataclass(frozen=True, kw_only=True)
class Grasps:
    """The grasps of a case, which can be played on any engine."""

    case: Case
    simulate: Simulate
    seed: int
    """Of the set."""

    def apart_nats(self, fault: Fault, engines: Sequence[str]) -> float:
        """Log-likelihood ratio with and without an effect, in the most informative channel.

        `engines` are all engines.
        """
        case = self.case
        less = replace(case, faults=tuple(f for f in case.faults if f is not fault))
        real, without = (self._signals(one, case.real) for one in (case, less))
        skin = next(name for name in SKIN if name in case.channels)
        if catalogue()[fault.effect].is_of("taxels"):
            return _skin_nats(skin, real[skin], without[skin])
        others = [self._signals(case, engine) for engine in engines if engine != case.real]
        noise = _noise(self._spec)
        found = [
            _nats(real[n] - without[n], noise[n], [real[n] - other[n] for other in others])
            for n in noise
            if n in real
        ]
        return max(
            [_slip_nats(real["slips"], without["slips"], [o["slips"] for o in others]), *found]
        )

    @property
    def _spec(self) -> Spec:
        return rigs.nominal(self.case.rig)

    def _motions(self) -> list[Motion]:
        world = hidden_world(self.case, self._spec)
        drawn = motions(self.case, self._spec, world, case_rng(self.case, self.seed))
        return [one for one in drawn if one.protocol in HOLDS]

    def _signals(self, case: Case, engine: str) -> dict[str, Array]:
        """What every sensor of a case reads on an engine, every `ALIKE_S`, shape (S, ...)."""
        moved = self._motions()
        both = engine_readings(
            lambda specs: self.simulate(engine, specs),
            hidden_world(case, self._spec),
            moved,
            case_rng(self.case, self.seed),
        )
        pairs = list(zip(moved, both, strict=True))
        slips = [_slip(m.pull_n, one["stick"]) for m, one in pairs if m.pull_n is not None]
        read = [one for m, one in pairs if m.protocol == GRASP]
        slipped = {"slips": np.array(slips).reshape(-1, len(SLIP_NOISE))}
        if not read:
            return slipped
        some = slice(None, None, round(ALIKE_S * RATE_HZ))
        rows = {k: np.concatenate([one[k][some] for one in read]) for k in read[0]}
        kept = {k: v for k, v in rows.items() if k in self.case.channels}
        stick = rows["stick"]
        return (
            slipped
            | kept
            | {
                "stick": ends_m(stick, self._spec.stick.length_m),
                "gap": tip_gaps_m(self._spec, rows["position"], stick),
            }
        )


def _slip(pull_n: Array, stick: Array) -> list[float]:
    """Logarithms of the pull at which a stick slips, and of what is added until it is gone."""
    low = stick[0, 2] - np.minimum.accumulate(stick[:, 2])
    still = low - low[np.argmax(pull_n > 0)]
    ends = [float(np.interp(at, still, pull_n)) for at in (SLIPPED_M, GONE_M)]
    return [float(np.log(max(ends[0], 1e-3))), float(np.log(max(ends[1] - ends[0], 1e-3)))]


def _slip_nats(real: Array, without: Array, others: Sequence[Array]) -> float:
    """By the tracker's noise, and by how far engines are apart, of slips (E, 2)."""
    apart = np.mean([(real - one) ** 2 for one in others], axis=(0, 1)) if len(real) else 0.0
    return float(((real - without) ** 2 / (np.square(SLIP_NOISE) + apart)).sum() / 2)


def _skin_nats(kind: str, one: Array, other: Array) -> float:
    """Of depths by what a tracker's noise makes of them, of answers by how many turn."""
    moved = np.abs(one - other).astype(float)
    if kind == "contact":
        return FLIP_NATS * float(moved.sum())
    return float((moved**2).sum() / (2 * rigs.TRACKER_M**2))


def _noise(spec: Spec) -> dict[str, float | Array]:
    """Standard deviation of what each sensor adds to a signal."""
    limit = np.array([drive.torque_limit_nm for drive in spec.drives])
    return {
        "position": rigs.NOISE_RAD,
        "torque": TORQUE_NOISE * limit,
        "stick": np.hypot(rigs.TRACKER_M, rigs.TRACKER_RAD * spec.stick.length_m / 2),
        "gap": rigs.TRACKER_M,
    }


def _nats(moved: Array, noise: float | Array, engines: Sequence[Array]) -> float:
    """By noise, and by how far engines are apart."""
    spread = np.mean([np.mean(one**2) for one in engines])
    return float((moved**2 / (np.square(noise) + spread)).sum() / 2)
