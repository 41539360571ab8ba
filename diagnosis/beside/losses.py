"""Whether what was decoded as lost packets is that: losses are random, and joints share them.

A delay or stiction also makes targets come late, and a decoder names late ones lost. But those are
not random: they come with the size of the change or one after the other, and each limb has its own,
where a lost packet is lost by every joint, or by the one joint that has a bus of its own.
"""

from collections.abc import Sequence
from itertools import zip_longest

import numpy as np
from scipy.stats import beta, fisher_exact, mannwhitneyu

from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.fit import Fitter
from diagnosis.attribution.profile import Fit
from diagnosis.attribution.verdict import LimbVerdict
from diagnosis.beside.finding import Finding, gap, share
from diagnosis.beside.packets import Decoding, Path, arrived, decisive, decoding, news

ACCUSE_NATS, LEAST_LOST = 30.0, 5
"""Losses must lower the cost by this, and so many must be decisive."""
WHITE_SD = 2.0
"""Where no verdict leaves more than this, see `whiten.surprise`, no packets are looked for."""
CHANCE = 1e-3
"""Losses that depend on each other or on the size of a change are not random below this."""
AGREED = 0.5
"""Share of the losses which several limbs would show that they have to agree on."""


def dropouts(
    parts: Sequence[Evidence], limbs: Sequence[LimbVerdict] = ()
) -> tuple[tuple[Finding, ...], tuple[Evidence, ...]]:
    """Lost packets: of every joint, of one joint, or none; and what limbs say when they are known.

    `limbs` are the verdicts on `parts` without losses. Nothing is lost where all that is new in
    what they leave is white.
    """
    if limbs and not any(limb.chosen.surprise > WHITE_SD for limb in limbs):
        return (), tuple(parts)
    found = [_decoded(*one) for one in zip_longest(parts, limbs)]
    guilty = [d for d in found if d.lead(d.all) >= ACCUSE_NATS]
    alone = [d for d in found if d.single is not None and d.lead(d.single) >= ACCUSE_NATS]
    paths = [(d, d.all) for d in found]
    if len(guilty) <= 1 and len(alone) == 1:
        d, single = alone[0], alone[0].single
        paths = [(d, single)] if single is not None and single.nats < d.all.nats else paths
    losses = _finding(paths, sum(d.lead(path) for d, path in paths))
    if not losses:
        return (), tuple(parts)
    known = {
        id(d.part): arrived(d.part, path) for d, path in paths if np.concatenate(path.lost).any()
    }
    return losses, tuple(known.get(id(part), part) for part in parts)


def _decoded(part: Evidence, limb: LimbVerdict | None) -> Decoding:
    """Losses in the nominal world, as it is and refitted, and in the one of the verdict."""
    if limb is None:
        return decoding(part, [part.nominal])
    fitter, nominal, chosen = limb.attribution.fitter, limb.attribution.nominal, limb.chosen

    def world(fit: Fit) -> Spec:
        pairs = zip(fitter.nuisances, fit.deviations, strict=True)
        return fitter.evidence.world([*(n.at(d) for n, d in pairs), *fit.effects])

    def refit(evidence: Evidence) -> Spec:
        return world(Fitter(evidence, fitter.nuisances).nominal())

    explained = world(chosen.fit) if chosen.names else None
    return decoding(part, [world(nominal.fit)], explained, refit)


def _finding(paths: Sequence[tuple[Decoding, Path]], lead: float) -> tuple[Finding, ...]:
    """The finding that these paths together make, if they are of random losses."""
    clear = [decisive(d.part, path, d.scale) for d, path in paths]
    flat = np.stack([np.concatenate(c) for c in clear])
    lost = np.stack([np.concatenate(path.lost) for _, path in paths])
    moves = [np.concatenate([m.max(axis=1) for m in news(d.part, path)]) for d, path in paths]
    apart = np.concatenate([np.arange(len(c)) == 0 for c in clear[0]])
    random = all(_random(*row, apart) for row in zip(flat, lost, moves, strict=True))
    if lead < ACCUSE_NATS or not random or not _agree(flat, lost):
        return ()
    said, gone = flat.any(axis=0), (flat & lost).any(axis=0)
    count, losses = int(said.sum()), int(gone.sum())
    before, after = (
        float(np.sqrt(np.mean([_gap(d, p) ** 2 for d, p in pairs])))
        for pairs in ([(d, d.plain) for d, _ in paths], paths)
    )
    if losses < LEAST_LOST:
        return ()
    ends = beta.ppf([0.05, 0.95], losses + 0.5, count - losses + 0.5)
    joints = tuple(name for _, path in paths for name in path.lossy)
    return (
        Finding(
            effect="command-dropout",
            joint=joints[0] if len(joints) == 1 else None,
            joints=joints,
            value=losses / count,
            interval=(float(ends[0]), float(ends[1])),
            share=share(before, after),
            gap_before=before,
            gap_after=after,
            lead_nats=lead,
            evidence=f"{losses} of {count} packets whose loss would show were lost, at random",
        ),
    )


def _random(clear: Array, lost: Array, moves: Array, first: Array) -> bool:
    """Whether decisive packets are lost independently of the last one and of the target's move.

    All (T,); `first` marks where recordings begin.
    """
    after_loss = np.append(False, lost[:-1]) & ~first
    rows = [[np.sum(clear & (after_loss == a) & (lost == b)) for b in (0, 1)] for a in (0, 1)]
    if fisher_exact(rows).pvalue < CHANCE:
        return False
    gone, there = moves[clear & lost], moves[clear & ~lost]
    return not len(gone) or not len(there) or mannwhitneyu(gone, there).pvalue >= CHANCE


def _agree(clear: Array, lost: Array) -> bool:
    """Whether limbs (rows) that would show the same packet say the same of it."""
    shared = clear.sum(axis=0) > 1
    some = ((clear & lost).any(axis=0) & shared).sum()
    every = ((lost | ~clear).all(axis=0) & shared).sum()
    return bool(some == 0 or every >= AGREED * some)


def _gap(found: Decoding, path: Path) -> float:
    part = found.part
    left = [
        ((r.measured - s.transpose(1, 0, 2)) / part.sigma).ravel()
        for r, s in zip(part.recordings, path.shown, strict=True)
    ]
    flat = np.concatenate(left)
    return gap(flat[np.isfinite(flat)], 1.0)
