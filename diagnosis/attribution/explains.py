"""Whether a fit explains a log: what it leaves is noise and the model's own error, no law."""

import numpy as np

from backends.effect import Effect
from diagnosis.attribution.attribute import Attribution, Ranked
from diagnosis.attribution.candidates import is_modelled
from diagnosis.attribution.evidence import compressed
from diagnosis.attribution.fit import CALM
from diagnosis.attribution.rules import Rules


def explains(found: Attribution, candidate: Ranked, rule: Rules) -> bool:
    """Whether what a candidate leaves is white, or little of what there is beyond noise.

    Of a law that is a model: little of what there is beyond the floor, and most of it taken.
    Nominal parameters must stay within their prior limit: one beyond it is a stand-in for what no
    effect explains, as is an effect as large as it can be. A pair can adapt to much, so it must
    take most of the gap even so. And what is left follows no other law: none in the motion, and
    within the floor none of one protocol.
    """
    if candidate.bent > belief(candidate, rule) and not _is_restless(found, candidate):
        return False
    if any(map(_ends, candidate.fit.effects)):
        return False
    white, alone = is_white(found, candidate, rule), len(candidate.names) < 2
    share, least = _asked(found, candidate, rule, white)
    left, had = (excess(one.gap, least) for one in (candidate, found.nominal))
    enough = (white and alone) or left <= (1 - share) * had + candidate.unrest**2
    if not enough or not _is_lawless(found, candidate, rule):
        return False
    return candidate.gap > 1.0 or _is_even(found, candidate, rule)


def is_plain(found: Attribution, ranked: Ranked, rule: Rules) -> bool:
    """Whether a fit leaves nothing to explain: its innovations are noise.

    It is white, follows no law, and no more than a few samples are out of all proportion.
    """
    if not is_white(found, ranked, rule):
        return False
    new = found.whole.innovations(ranked.fit.effects, ranked.fit.deviations)
    wild = int((np.abs(new) > compressed(rule.wild_sd)).sum())
    lawless = _is_lawless(found, ranked, rule) and _is_even(found, ranked, rule)
    return wild < rule.wild_count and lawless


def is_white(found: Attribution, ranked: Ranked, rule: Rules) -> bool:
    """Whether the innovations are white: on held-out samples, or in every protocol of a full fit.

    Half of the samples may not tell every parameter, and what they leave open shows on the others.
    """
    held_out = ranked.surprise <= rule.white_sd
    return held_out or found.leftover(ranked).unevenness <= rule.white_sd


def belief(ranked: Ranked, rule: Rules) -> float:
    """How many of its standard deviations a nominal parameter may be off beside these effects."""
    return rule.bent_stds if len(ranked.names) == 1 else rule.pair_stds


def excess(gap: float, least: float = 1.0) -> float:
    """What a gap has above the least, squared: above the floor."""
    return max(gap**2 - least**2, 0.0)


def _asked(found: Attribution, candidate: Ranked, rule: Rules, white: bool) -> tuple[float, float]:
    """Which share of the gap beyond which level a candidate must take."""
    quiet, within = found.fitter.evidence.quiet, candidate.gap <= 1.0
    modelled = any(map(is_modelled, candidate.fit.effects))
    if white or (modelled and within):
        return rule.within_share, quiet
    if modelled:
        return rule.explained_share, 1.0
    return rule.explained_share if within else rule.exact_share, quiet


def _is_restless(found: Attribution, candidate: Ranked) -> bool:
    """Whether a joint's play may bend parameters by chance; a little known play does not."""
    return candidate.unrest > CALM + min(found.nominal.unrest, CALM)


def _ends(effect: Effect) -> bool:
    """Whether a magnitude is where its bounds end, other than at nothing."""
    return any(end and np.isclose(effect.magnitude, end, rtol=1e-3) for end in effect.bounds)


def _is_lawless(found: Attribution, ranked: Ranked, rule: Rules) -> bool:
    """Whether what a fit leaves does not follow the motion.

    Who stands in for another law fits what is common to both, and leaves traces under the floor.
    Beyond the floor a small share of what it takes may be left, and of a restless joint as much as
    that strays.
    """
    loose = ranked.gap > rule.settled_gap
    share = min(np.inf if loose else ranked.unrest**2, 1 - rule.explained_share)
    most = rule.law_nats + share * (found.nominal.fit.cost - ranked.fit.cost)
    return found.leftover(ranked).lack_of_fit <= most


def _is_even(found: Attribution, ranked: Ranked, rule: Rules) -> bool:
    """Whether what a fit leaves is in no protocol alone; not asked of a joint in its play."""
    had = found.leftover(found.nominal).unevenness if ranked.names else 0.0
    most = max(rule.uneven_sd, rule.uneven_share * had)
    return ranked.unrest > CALM or found.leftover(ranked).unevenness <= most
