"""Friction and mass from how the stick moves in a grasp, where nothing pulls it out.

Worlds of other magnitudes are replayed side by side on an engine, and the residual decides. Engines
differ in that by more than sensors see, so every episode has to agree.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.grasp.forward_model import (
    FRICTION,
    MASS,
    SAME,
    SOFTNESS,
    judged,
    simulate_grasps,
)
from diagnosis.motion.batch import Simulate
from diagnosis.motion.held import Held
from diagnosis.verdict.in_hand import Report, missing
from diagnosis.verdict.result import CLOSE_NATS, cause

MOTION = {
    FRICTION: (-0.8, -0.6, -0.4, -0.2, 0.3, 0.8, 1.5),
    MASS: (-0.8, -0.5, -0.25, 0.4, 1.0, 2.0, 3.5),
}
"""Numbers that show in motion alone, and magnitudes to start from."""
YIELDING = {SOFTNESS: (0.03e-3, 0.1e-3, 0.3e-3, 0.6e-3)}
"""What shows there as well: a lighter stick may yield more, as on engines whose contacts are
tuned by the masses that meet."""
AGREE = (
    "not identifiable from this log; record --protocol grasp with the channel stick, --variants 2 "
    "or more: one episode may agree by chance"
)
FINER = (-0.8, -0.5, -0.25, 0.25, 0.5, 0.8)
"""Where later rounds look, as shares of the way from the best magnitude to its neighbours."""
ROUNDS = 2
EXPLAINED, TIE_SHARE = 0.9, 0.05
"""An effect must explain this share of the squared gap: less, and the engines differ. Effects are
tied that explain no less than the second of them below the best."""
STILL = 0.01
"""A gap this far under what engines differ by is none."""
ENGINE = (
    "not identifiable from this log: the stick moves differently from the nominal engine, by "
    "{:.2f} of what engines differ by among themselves, and neither explains it; record --protocol "
    "pull with the channels stick and pull"
)


@dataclass(frozen=True, kw_only=True)
class Swept:
    """One effect, replayed at many magnitudes."""

    effect: str
    magnitudes: Array
    """In order, 0 among them, shape (M,)."""
    nats: Array
    """Cost of each in every episode, shape (M, E)."""
    gaps: Array
    """Residuals over `ENGINES`, root mean square by magnitude, shape (M,)."""

    @property
    def best(self) -> int:
        """The cheapest magnitude over all episodes."""
        return int(np.argmin(self.nats.sum(axis=1)))

    @property
    def zero(self) -> int:
        """Where nothing is wrong."""
        return int(np.argmin(np.abs(self.magnitudes)))

    @property
    def share(self) -> float:
        """Share of the squared gap that it explains."""
        return 1.0 - float(self.gaps[self.best] / self.gaps[self.zero]) ** 2

    @property
    def agrees(self) -> bool:
        """Whether it makes every episode likelier, each at the size that the others choose."""
        total = self.nats.sum(axis=1)
        chosen = np.argmin(total[:, None] - self.nats, axis=0)
        gains = self.nats[self.zero] - self.nats[chosen, np.arange(self.nats.shape[1])]
        return bool((gains > 0).all())

    @property
    def interval(self) -> tuple[float, float]:
        """Magnitudes next to those that cost nearly as little."""
        total = self.nats.sum(axis=1)
        good = np.flatnonzero(total < total.min() + CLOSE_NATS)
        ends = max(good[0] - 1, 0), min(good[-1] + 1, len(total) - 1)
        return float(self.magnitudes[ends[0]]), float(self.magnitudes[ends[1]])


def motions(
    world: Spec, parts: Sequence[Held], kinds: Mapping[str, type[Effect]], simulate: Simulate
) -> Report:
    """The one effect that all episodes agree on and that explains the motion."""
    if not kinds:
        return Report()
    if len(parts) < 2:
        return Report(missing=missing(_moving(kinds), AGREE))
    singles = [_sweep(world, parts, name, kind, simulate) for name, kind in kinds.items()]
    base_gap = singles[0].gaps[singles[0].zero]
    if base_gap < STILL:
        return Report()
    agreed = sorted((s for s in singles if s.agrees), key=lambda s: -s.share)
    if agreed and agreed[0].share >= EXPLAINED and agreed[0].gaps[agreed[0].best] < SAME:
        best, *others = agreed
        found = cause(
            best.effect,
            (float(best.magnitudes[best.best]), *best.interval),
            kinds,
            share=best.share,
            evidence=f"every one of {len(parts)} grasps is replayed better: it takes "
            f"{100 * best.share:.0f} % of the gap",
            tied=tuple(s.effect for s in others if best.share - s.share < TIE_SHARE),
        )
        return Report(causes=(found,))
    return Report(missing=missing(_moving(kinds), ENGINE.format(base_gap)))


def _moving(kinds: Mapping[str, type[Effect]]) -> list[str]:
    """Those that show in motion alone."""
    return [name for name, kind in kinds.items() if _number(kind) in MOTION]


def _number(kind: type[Effect]) -> str:
    """The number of the spec that an effect changes."""
    return kind.spec_fields()[0]


def _sweep(
    world: Spec, parts: Sequence[Held], name: str, kind: type[Effect], simulate: Simulate
) -> Swept:
    """An effect at its first magnitudes, then twice more around the best."""
    done: dict[float, tuple[Array, float]] = {}
    asked = [0.0, *(MOTION | YIELDING)[_number(kind)]]
    for _ in range(1 + ROUNDS):
        worlds = [kind(magnitude=size).on_spec(world) for size in asked]
        for size, shown in zip(asked, simulate_grasps(simulate, worlds, parts), strict=True):
            done[size] = judged(shown, parts, world)
        asked = _closer(done)
    sizes = sorted(done)
    return Swept(
        effect=name,
        magnitudes=np.array(sizes),
        nats=np.stack([done[m][0] for m in sizes]),
        gaps=np.array([done[m][1] for m in sizes]),
    )


def _closer(done: Mapping[float, tuple[Array, float]]) -> list[float]:
    sizes = sorted(done)
    k = min(range(len(sizes)), key=lambda i: float(done[sizes[i]][0].sum()))
    near = [sizes[max(k - 1, 0)], sizes[min(k + 1, len(sizes) - 1)]]
    return [sizes[k] + abs(f) * (near[f > 0] - sizes[k]) for f in FINER if near[f > 0] != sizes[k]]
