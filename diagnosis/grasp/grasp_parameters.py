"""What is wrong with stick and contact, from episodes with the stick in the hand.

Radius and softness show in geometry (`yields`), friction and mass where the stick is pulled out
(`slips`). Where it is not, they show in how the stick moves: worlds of other magnitudes are
replayed side by side on an engine, and the residual decides. Engines differ in that by more than
sensors see, so every episode has to agree.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.finding import STICK, TIE_NATS, Finding, Report
from diagnosis.grasp import pull_test
from diagnosis.grasp.contact_geometry import RADIUS, SOFTNESS, shapes
from diagnosis.grasp.grasp_likelihood import SAME, judged
from diagnosis.grasp.simulate_grasps import Simulate, simulate_grasps
from diagnosis.logs.log import Log
from diagnosis.motion.held import Held, held

MOTION = {
    "contact-friction": (-0.8, -0.6, -0.4, -0.2, 0.3, 0.8, 1.5),
    "stick-mass": (-0.8, -0.5, -0.25, 0.4, 1.0, 2.0, 3.5),
}
"""Effects that show in motion alone, and magnitudes to start from."""
YIELDING = {SOFTNESS: (0.03e-3, 0.1e-3, 0.3e-3, 0.6e-3)}
"""What shows there as well: a lighter stick may yield more, as on engines whose contacts are
tuned by the masses that meet."""
NEEDS = "not identifiable from this log; record --protocol grasp with the channel stick"
PULLS = (
    "not identifiable from this log; record --protocol grasp,pull --variants 2 with the channels "
    "stick and pull"
)
AGREE = f"{NEEDS}, --variants 2 or more: one episode may agree by chance"
ACCUSE_NATS = 30.0
"""All episodes together must favour an effect by this."""
CLOSE_NATS = 1.35
"""Half of the 90 % point of a squared normal number: ends of an interval."""
FINER = (-0.8, -0.5, -0.25, 0.25, 0.5, 0.8)
"""Where later rounds look, as shares of the way from the best magnitude to its neighbours."""
ROUNDS = 2
EXPLAINED = 0.9
"""An effect must explain this share of the squared gap: less, and the engines differ."""
WHOLE = 0.95
"""An effect that explains this share of the squared gap by itself leaves nothing to the shapes."""
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
    def lead(self) -> float:
        """What it gains in all episodes, each at the size that the others choose [nats].

        0 where one of them does not agree.
        """
        total = self.nats.sum(axis=1)
        chosen = np.argmin(total[:, None] - self.nats, axis=0)
        gains = self.nats[self.zero] - self.nats[chosen, np.arange(self.nats.shape[1])]
        return float(gains.sum()) if (gains > 0).all() else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Magnitudes next to those that cost nearly as little."""
        total = self.nats.sum(axis=1)
        good = np.flatnonzero(total < total.min() + CLOSE_NATS)
        ends = max(good[0] - 1, 0), min(good[-1] + 1, len(total) - 1)
        return float(self.magnitudes[ends[0]]), float(self.magnitudes[ends[1]])


def identify_grasp_parameters(
    log: Log,
    nominal: Spec,
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate | None,
) -> Report:
    """The effects of stick and contact that a log shows, and why it cannot show others.

    `simulate` puts worlds on the nominal engine; without it nothing is looked for.
    """
    sought = [name for name in (RADIUS, SOFTNESS, *MOTION) if name in catalogue]
    if simulate is None:
        return Report(missing=(f"{', '.join(sought)}: {NEEDS}",) if sought else ())
    parts = [part for part in held(log, nominal) if part.protocol == "grasp"]
    if not sought:
        return Report()
    if not parts:
        still = [name for name in sought if name not in MOTION]
        moving = [name for name in sought if name in MOTION]
        asked = ((still, NEEDS), (moving, PULLS))
        return Report(missing=tuple(f"{', '.join(names)}: {why}" for names, why in asked if names))
    pulls = [part for part in held(log, nominal, ("pull",)) if part.pull_n.any()]
    pulled = pull_test.pull_fit(nominal, pulls, simulate) if pulls else None
    if pulled is not None:
        return _pulled_out(nominal, parts, pulls, pulled, catalogue, simulate)
    moved = {name: catalogue[name] for name in MOTION if name in catalogue}
    yielding = {name: catalogue[name] for name in YIELDING if name in catalogue and moved}
    alone = motions(nominal, parts, moved | yielding, simulate)
    if any(one.share >= WHOLE for one in alone.findings):
        return alone
    shape = shapes(nominal, parts, catalogue, simulate)
    again = motions(shape.world, parts, moved, simulate) if shape.world != nominal else alone
    return Report(
        findings=(*shape.findings, *again.findings),
        spots=shape.spots,
        missing=(*shape.missing, *again.missing),
        world=shape.world,
    )


def _pulled_out(
    nominal: Spec,
    parts: Sequence[Held],
    pulls: Sequence[Held],
    first: pull_test.PullFit,
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate,
) -> Report:
    """Shapes in a world that slips as the stick did; then what pulls tell in a world so shaped.

    Soft contacts yield along the stick as well, and bear as much as they are soft: they look light
    where the stick creeps rather than slips by Newton's law.
    """
    shape = shapes(pull_test.corrected(nominal, first), parts, catalogue, simulate, first.is_firm)
    if shape.soft and not first.is_lawful:
        first = replace(first, mass=0.0)
        shape = shapes(pull_test.corrected(nominal, first), parts, catalogue, simulate)
    again = pull_test.pull_fit(shape.world, pulls, simulate, shape.soft)
    last = again.beside(first) if again else first
    if shape.soft:
        std = float(np.hypot(last.friction_std, pull_test.SOFT_FLOOR))
        left = last.left if last.is_lawful else np.inf
        last = replace(last, left=left, friction_std=std)
    sought = [name for name in MOTION if name in catalogue]
    return Report(
        findings=(*shape.findings, *last.findings(catalogue)),
        spots=shape.spots,
        missing=(*shape.missing, *(last.missing if pull_test.MASS in sought else ())),
        world=shape.world,
    )


def motions(
    world: Spec, parts: Sequence[Held], kinds: Mapping[str, type[Effect]], simulate: Simulate
) -> Report:
    """The one effect that all episodes agree on and that explains the motion."""
    if not kinds:
        return Report()
    if len(parts) < 2:
        return Report(missing=(f"{', '.join(k for k in kinds if k in MOTION)}: {AGREE}",))
    singles = [_sweep(world, parts, name, kind, simulate) for name, kind in kinds.items()]
    base_gap = singles[0].gaps[singles[0].zero]
    if base_gap < STILL:
        return Report()
    agreed = {s.effect: s.lead for s in singles}
    best = max(singles, key=lambda s: agreed[s.effect])
    explained = best.share >= EXPLAINED and best.gaps[best.best] < SAME
    if best.lead >= ACCUSE_NATS and explained:
        behind = {n: best.lead - lead for n, lead in agreed.items() if n != best.effect}
        ties = [(n, nats) for n, nats in behind.items() if nats < TIE_NATS]
        return Report(findings=(_finding(best, base_gap, ties),))
    text = f"{', '.join(k for k in kinds if k in MOTION)}: {ENGINE.format(base_gap)}"
    return Report(missing=(text,))


def _finding(swept: Swept, before: float, ties: Sequence[tuple[str, float]]) -> Finding:
    after = float(swept.gaps[swept.best])
    return Finding(
        effect=swept.effect,
        joint=None,
        family=STICK,
        value=float(swept.magnitudes[swept.best]),
        interval=swept.interval,
        share=swept.share,
        gap_before=before,
        gap_after=after,
        lead_nats=swept.lead,
        ties=tuple(ties),
        evidence=f"every one of {swept.nats.shape[1]} grasps is replayed better, by "
        f"{swept.lead:.0f} nats in all",
    )


def _sweep(
    world: Spec, parts: Sequence[Held], name: str, kind: type[Effect], simulate: Simulate
) -> Swept:
    """An effect at its first magnitudes, then twice more around the best."""
    done: dict[float, tuple[Array, float]] = {}
    asked = [0.0, *(MOTION | YIELDING)[name]]
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
