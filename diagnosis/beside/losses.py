"""Whether what was decoded as lost packets is that: losses are random, and joints share them.

A delay or stiction also makes targets come late, and a decoder names late ones lost. But those are
not random: they come with the size of the change or one after the other, and each limb has its own,
where a lost packet is lost by every joint, or by the one joint that has a bus of its own. And what
a limb did with the packets that arrived, the nominal world or one with an effect then explains.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from scipy.stats import beta, fisher_exact, mannwhitneyu

from backends.state import Array
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.fit import CALM, Fitter
from diagnosis.attribution.profile import Fit
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import LimbVerdict
from diagnosis.beside.hearing import Heard, hear
from diagnosis.beside.packets import SHARES, counts, decisive, news
from diagnosis.beside.sensing import Finding
from diagnosis.finding import gap, share

ACCUSE_NATS = 30.0
"""Losses must lower the cost by this."""
LEAST_LOST, EXPLAINED = 5, 0.5
"""So many decisive losses explain at least this share of what no losses leave over the noise, and
fewer `exact_share`, or else they leave what is white. Beside an effect fewer losses of any kind are
moments that its world does not predict, as are those of a share below `LEAST_SHARE`."""
LEAST_SHARE = 0.01
"""Share of the packets that could show it, of which fewer losses are none beside an effect."""
CHANCE = 1e-3
"""Losses that depend on each other or on the size of a change are not random below this."""
AGREED = 0.5
"""Share of the losses which several limbs would show that they have to agree on."""


@dataclass(frozen=True, kw_only=True)
class Listener:
    """A limb, and the losses that are detected in it."""

    fitter: Fitter
    told: Fit
    """The best explanation by all commands."""
    all: Heard | None
    """Losses of all joints' packets together."""
    single: Heard | None
    """Losses of one joint's packets alone."""

    def lead(self, heard: Heard | None) -> float:
        """How far losses are ahead of none [nats]."""
        return self.told.cost - heard.nats if heard is not None else 0.0


def dropouts(
    parts: Sequence[Evidence], limbs: Sequence[LimbVerdict] = ()
) -> tuple[tuple[Finding, ...], tuple[Evidence, ...]]:
    """Lost packets: of every joint, of one joint, or none; and what limbs say when they are known.

    `limbs` are the verdicts on `parts` without losses. Few losses leave what looks white, so they
    are looked for whatever the verdict.
    """
    found = [_listened(*one) for one in zip_longest(parts, limbs)]
    guilty = [one for one in found if one.lead(one.all) >= ACCUSE_NATS]
    alone = [one for one in found if one.lead(one.single) >= ACCUSE_NATS]
    heard, joints = [one.all for one in found], [name for part in parts for name in part.joints]
    single = alone[0].single if len(guilty) <= 1 and len(alone) == 1 else None
    if single is not None and alone[0].lead(single) > alone[0].lead(alone[0].all):
        heard = [single if one is alone[0] else None for one in found]
        joints = list(single.path.lossy)
    pairs = [(one, h) for one, h in zip(found, heard, strict=True) if h is not None]
    losses = _finding(pairs, tuple(joints))
    if not losses:
        return (), tuple(parts)
    rows = zip(parts, heard, strict=True)
    return losses, tuple(part if h is None else h.evidence for part, h in rows)


def _listened(part: Evidence, limb: LimbVerdict | None) -> Listener:
    """What is heard from the nominal world on, refitted, and from the one of the verdict.

    With the verdict's own evidence: what no world foretells of a joint in its play is no loss.
    """
    fitter, fits = Fitter(part, (), None), [Fit(effects=(), deviations=np.zeros(0), cost=0.0)]
    if limb is not None:
        fitter = limb.attribution.whole
        if limb.chosen.unrest > CALM:
            forgiving = limb.attribution.forgiving(limb.chosen)
            fitter = Fitter(forgiving, fitter.nuisances, None)
        fits = [limb.attribution.nominal.fit, *([limb.chosen.fit] if limb.chosen.names else [])]
    starts = [fitter.at(fit.effects, fit.deviations) for fit in fits]
    told = min(starts, key=lambda fit: fit.cost)
    every = hear(fitter, starts, part.joints, told.cost)
    names = part.joints if len(part.joints) > 1 and every is not None else ()
    apart = [hear(fitter, starts, (name,), told.cost) for name in names]
    return Listener(
        fitter=fitter,
        told=told,
        all=every,
        single=min(filter(None, apart), key=lambda one: one.nats, default=None),
    )


def _finding(
    pairs: Sequence[tuple[Listener, Heard]], joints: tuple[str, ...]
) -> tuple[Finding, ...]:
    """The finding that these losses of `joints` make, if they are random and explain the log."""
    lead = sum(one.lead(heard) for one, heard in pairs)
    if lead < ACCUSE_NATS:
        return ()
    clear = [decisive(one.fitter.evidence, h.path, h.scale) for one, h in pairs]
    flat = np.stack([np.concatenate(c) for c in clear])
    lost = np.stack([np.concatenate(h.path.lost) for _, h in pairs])
    moves = [
        np.concatenate([m.max(axis=1) for m in news(one.fitter.evidence, h.path)])
        for one, h in pairs
    ]
    apart = np.concatenate([np.arange(len(c)) == 0 for c in clear[0]])
    random = all(_random(*row, apart) for row in zip(flat, lost, moves, strict=True))
    if not random or not _agree(flat, lost):
        return ()
    said, gone = flat.any(axis=0), (flat & lost).any(axis=0)
    count, losses = int(said.sum()), int(gone.sum())
    ends = beta.ppf([0.05, 0.95], losses + 0.5, count - losses + 0.5)
    named = sum(counts(one.fitter.evidence, h.path)[0] for one, h in pairs)
    least = max(LEAST_LOST, LEAST_SHARE * count)
    few = named < least and any(one.told.effects for one, _ in pairs)
    if not losses or few or ends[0] > SHARES[1]:
        return ()
    asked = EXPLAINED if losses >= LEAST_LOST else rules().exact_share
    if _explained(pairs) < asked and any(h.surprise() > rules().white_sd for _, h in pairs):
        return ()
    told = np.concatenate([_left(one.fitter, one.told) for one, _ in pairs])
    left = np.concatenate([_left(h.fitter, h.fit) for _, h in pairs])
    before, after = gap(told, 1.0), gap(left, 1.0)
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


def _explained(pairs: Sequence[tuple[Listener, Heard]]) -> float:
    """Share of what no losses leave, over what noise alone costs, that is gone with them."""
    noise = sum(len(one.fitter.evidence.tracks()) for one, _ in pairs) / 2
    told, heard = sum(one.told.cost for one, _ in pairs), sum(h.fit.cost for _, h in pairs)
    return (told - heard) / max(told - noise, 1.0)


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
    """Whether limbs (rows) that would show the same packet say the same of it, or of the next."""
    shared = clear.sum(axis=0) > 1
    near = lost | np.pad(lost, ((0, 0), (1, 0)))[:, :-1] | np.pad(lost, ((0, 0), (0, 1)))[:, 1:]
    some = ((clear & lost).any(axis=0) & shared).sum()
    every = ((near | ~clear).all(axis=0) & (clear & lost).any(axis=0) & shared).sum()
    return bool(every >= AGREED * some)


def _left(fitter: Fitter, fit: Fit) -> Array:
    """What a fit leaves on all samples, over the standard deviations."""
    return fitter.evidence.residual(fitter.effects(fit), None, False)
