"""From fits to a verdict: an effect, a pair, `none` or `unknown`, by rules frozen in rules.yaml."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from backends.effect import Effect
from backends.effects import backlash, encoder_scale
from diagnosis.attribution.attribute import Attribution, Ranked
from diagnosis.attribution.candidates import RUB, is_read, nuisances
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.explains import belief, excess, explains, is_plain, is_white
from diagnosis.attribution.fit import CALM, Fitter
from diagnosis.attribution.refits import BELIEVED
from diagnosis.attribution.rules import Rules, confidence, rules
from diagnosis.attribution.sound import Sound
from diagnosis.attribution.timing import Late, late_s

WORTH = 0.5
"""A second effect is fitted when to first order it lowers the cost, on the samples for fitting, by
this share of what it needs on all."""
ANEW = 2
"""So many of the best candidates are searched from other magnitudes where the first does not
explain the log."""
OTHERS = 2
"""Singles beside the best one that a pair is built on, where that does not explain the log."""
NONE, UNKNOWN = "none", "unknown"


@dataclass(frozen=True, kw_only=True)
class LimbVerdict:
    """What one limb's evidence says."""

    names: tuple[str, ...]
    """Effects, or `none`, or `unknown`."""
    chosen: Ranked
    """The fit behind the verdict; the nominal one for `none`, the best found for `unknown`."""
    attribution: Attribution
    tied: tuple[Ranked, ...]
    """Single effects that this evidence cannot tell from the chosen one."""
    lead_nats: float
    """How far the verdict is ahead of the next one, or of `none` or `unknown` [nats]."""
    told: "LimbVerdict | None" = None
    """The verdict by all commands, where this one is by those that arrived."""

    @property
    def refitted(self) -> tuple[Effect, ...]:
        """What the chosen fit makes of the joints' nominal parameters, as effects."""
        pairs = zip(self.attribution.fitter.nuisances, self.chosen.fit.deviations, strict=True)
        return tuple(n.at(d) for n, d in pairs if n.joint is not None)

    @property
    def ranking(self) -> tuple[Ranked, ...]:
        """The nominal parameters, every single effect and the chosen fit, least cost first.

        Each once, though some were searched from several magnitudes.
        """
        found = {(self.chosen.names, self.chosen.joints): self.chosen}
        for one in sorted((self.attribution.nominal, *self.attribution.singles), key=_cost):
            found.setdefault((one.names, one.joints), one)
        return tuple(sorted(found.values(), key=_cost))

    @property
    def leading(self) -> tuple[Ranked, ...]:
        """Of an unknown gap the effect that is ahead of all others but one at most, and that one.

        It must leave least on held-out samples, too.
        """
        found, best, rule = self.attribution, self.chosen, self.attribution.rule
        if self.names != (UNKNOWN,) or len(best.names) != 1:
            return ()
        others = [one for one in found.singles if not _same(one, best)]
        tied = [one for one in others if _lead(one, best) < rule.tie_nats]
        left = min(one.plain.mean() for one in (found.nominal, *others))
        ahead = _lead(found.nominal, best) >= rule.accuse_nats and left > best.plain.mean()
        return (best, *tied) if ahead and len(tied) <= 1 else ()

    @property
    def gain_nats(self) -> float:
        """How much better the chosen fit is than the nominal one, see `_lead` [nats]."""
        return _lead(self.attribution.nominal, self.chosen)

    @property
    def confidence(self) -> float:
        """Probability that the verdict is right."""
        right = rules().right
        if self.names == (UNKNOWN,):
            return right.unknown
        share = right.none if self.names == (NONE,) else right.effect ** len(self.names)
        tied = [_lead(one, self.chosen) for one in self.tied]
        return confidence(share, tied or [self.lead_nats])


def judge(
    evidence: Evidence, catalogue: Mapping[str, type[Effect]], uncertainty: float
) -> LimbVerdict:
    """The verdict on one limb; once more with the prediction spread, where a joint plays.

    A world with play predicts a log for a moment only, so what it leaves says little, whoever is
    right. Its replays' spread says how much, and all are judged again by that. A verdict that held
    without keeps its effects, but for a second one that is not needed then. And what is unknown is
    judged once more beside the little play that every mechanism has.
    """
    first = ruled(_attributed(evidence, catalogue, uncertainty))
    little = little_play(first)
    if little:
        world = first.attribution.fitter.evidence.knowing(little)
        again = ruled(Attribution(world, catalogue, uncertainty))
        again.attribution.before = first.attribution.before
        first = first if again.names == (UNKNOWN,) else again
    stray = _stray(first)
    if stray is None:
        return first
    again = ruled(Attribution(first.attribution.forgiving(stray), catalogue, uncertainty))
    if first.names == (UNKNOWN,):
        return again if set(stray.names) & set(again.names) else first
    return again if set(again.names) <= set(first.names) else _known_strays(first, again)


def leaves(
    evidence: Evidence, catalogue: Mapping[str, type[Effect]], uncertainty: float
) -> tuple[LimbVerdict, Sound]:
    """What a limb with which nothing is wrong leaves beside the nominal world: `none` all the same.

    Beside an effect too small to accuse, where that fits better, as in any verdict.
    """
    found = _attributed(evidence, catalogue, uncertainty)
    rule, left = found.rule, found.leftover(found.nominal)
    small = _with_little(found, found.nominal, found.singles, rule)
    seem = [one for one in found.singles if _lead(found.nominal, one) >= rule.sound_nats]
    sizes: dict[str, float] = {}
    for one in seem:
        size = _size(found, one.fit.effects[-1], one)
        sizes[one.names[-1]] = max(size, sizes.get(one.names[-1], 0.0))
    shown = Sound(
        surprise=max(found.nominal.surprise, 0.0),
        unevenness=max(left.unevenness, 0.0),
        lack_of_fit=left.lack_of_fit,
        bent=small.bent,
        sizes=sizes,
    )
    return _verdict((NONE,), found.nominal, found, (), rule.accuse_nats), shown


def _attributed(
    evidence: Evidence, catalogue: Mapping[str, type[Effect]], uncertainty: float
) -> Attribution:
    """The search in a limb's evidence; as far as its nominal replays can be foretold."""
    fitter = Fitter(evidence, nuisances(evidence.nominal, uncertainty))
    bare = fitter.at((), np.zeros(len(fitter.nuisances)))
    if fitter.unrest(bare) > CALM:
        evidence = fitter.forgiving(bare)
    return Attribution(evidence, catalogue, uncertainty)


def unaccused(limb: LimbVerdict) -> LimbVerdict:
    """The verdict where an effect that was accused may as well be nothing: that on the nominal fit.

    What it gains then is what is known of a nominal parameter, which it frees.
    """
    found, rule = limb.attribution, limb.attribution.rule
    nominal = found.nominal
    if nominal.bent <= rule.alone_stds and is_plain(found, nominal, rule):
        return _verdict((NONE,), nominal, found, (), rule.accuse_nats)
    return _verdict((UNKNOWN,), nominal, found, (), _strangeness(found, nominal))


def most_of(limb: LimbVerdict) -> LimbVerdict | None:
    """The verdict on the effect that takes most of an unknown gap, where the rest has a cause.

    It must be ahead of all others by `firm_nats`, with no parameter beyond its prior limit.
    """
    found, rule = limb.attribution, limb.attribution.rule
    best = next((one for one in found.singles if _beyond_nominal(found, one, rule)), None)
    if best is None or best.bent > belief(best, rule):
        return None
    if excess(best.gap) > (1 - rule.explained_share) * excess(found.nominal.gap):
        return None
    verdict = _accused(found, best, found.singles, _lead(found.nominal, best), rule)
    return verdict if not verdict.tied and verdict.lead_nats >= rule.firm_nats else None


def _known_strays(first: LimbVerdict, again: LimbVerdict) -> LimbVerdict:
    """The verdict where other effects are found once it is known how far joints stray.

    A second one that the first effect needs then is kept; else the first stands alone, as its
    strays are known, or as it was where it was not tried so.
    """
    found, rule = again.attribution, again.attribution.rule
    same = [one for one in found.singles if _same(one, first.chosen)]
    alone = min(same, key=_cost, default=None)
    if alone is None:
        return first
    if set(again.names) > set(first.names) and not is_white(found, alone, rule):
        return again
    return _accused(found, alone, found.singles, _lead(found.nominal, alone), rule)


def little_play(verdict: LimbVerdict) -> tuple[Effect, ...]:
    """The little play on every joint that explains part of an unknown gap; none where it does not.

    It starts as large as the model's own error, and is too small to accuse.
    """
    found, chosen = verdict.attribution, verdict.chosen
    rule, whole = found.rule, found.whole
    evidence = whole.evidence
    drives = evidence.world(chosen.fit.effects).drives
    rows = zip(evidence.joints, drives, evidence.floor[0, 0], strict=True)
    floor = {joint: float(size) for joint, drive, size in rows if drive.play_rad == 0.0}
    if verdict.names != (UNKNOWN,) or not floor:
        return ()
    little = tuple(backlash.Effect(magnitude=size, joint=joint) for joint, size in floor.items())
    fit = whole.refit(whole.at((*chosen.fit.effects, *little), chosen.fit.deviations))
    plays = fit.effects[len(chosen.fit.effects) :]
    helps = chosen.fit.cost - fit.cost >= rule.firm_nats * chosen.spread
    small = all(e.magnitude <= rule.nominal_stds * floor[str(e.joint)] for e in plays)
    return plays if helps and small else ()


def _stray(verdict: LimbVerdict) -> Ranked | None:
    """The best restless candidate, where what the verdict leaves is not white."""
    if verdict.chosen.surprise <= verdict.attribution.rule.white_sd:
        return None
    found = verdict.attribution
    tried = min((*found.singles, *found.pairs), key=_cost, default=None)
    return tried if tried is not None and tried.unrest > CALM else None


def ruled(found: Attribution) -> LimbVerdict:
    """The verdict that the fits give by the rules."""
    rule, nominal = found.rule, found.nominal
    singles = [r for r in found.singles if _beyond_nominal(found, r, rule)]
    small = _with_little(found, nominal, found.singles, rule)
    gain = _lead(small, singles[0]) if singles else -np.inf
    if gain < rule.accuse_nats and not (singles and _became(found, small, singles[0], rule)):
        off = _slightly_off(found, small, rule)
        if off is not None:
            return _verdict((UNKNOWN,), off, found, (), _lead(small, off))
        if small.bent <= rule.alone_stds and is_plain(found, small, rule):
            return _verdict((NONE,), nominal, found, (), rule.accuse_nats - max(gain, 0.0))
        return _verdict((UNKNOWN,), nominal, found, (), _strangeness(found, small))
    if not explains(found, singles[0], rule):
        singles = sorted([*map(found.elsewhere, singles[:ANEW]), *singles[ANEW:]], key=_cost)
    doubted = _accused(found, singles[0], singles, gain, rule).names == (UNKNOWN,)
    best, pair = _pair(found, singles[0], rule, doubted)
    better = _lead(singles[0], best) >= rule.firm_nats
    if pair is None and better and not explains(found, best, rule):
        best, pair = _pair(found, best, rule, doubted)
    if pair is not None and (explains(found, pair, rule) or _became(found, best, pair, rule)):
        pair = _searched_on(found, pair)
        return _verdict(pair.names, pair, found, (), _lead(best, pair))
    if not explains(found, best, rule):
        return _verdict((UNKNOWN,), best, found, (), _strangeness(found, best))
    return _accused(found, best, singles, gain, rule)


def _accused(
    found: Attribution, best: Ranked, singles: Sequence[Ranked], gain: float, rule: Rules
) -> LimbVerdict:
    """The verdict on one effect that explains the log, `gain` nats ahead of `none`."""
    others = [r for r in singles if not _same(r, best)]
    tied = tuple(r for r in others if _lead(r, best) < rule.tie_nats)
    lead = min([_lead(r, best) for r in others] + [gain])
    if best.bent > rule.alone_stds and lead < rule.firm_nats:
        return _verdict((UNKNOWN,), best, found, (), _strangeness(found, best))
    return _verdict(best.names, best, found, tied, lead)


def _searched_on(found: Attribution, pair: Ranked) -> Ranked:
    """A pair that explains the log, from other magnitudes and without slopes where joints play.

    A lock has a dip in its costs for every push that it holds, and in a play no slope leads on.
    """
    return found.slopeless(found.elsewhere(pair), 0.0) if pair.unrest > CALM else pair


def _same(one: Ranked, other: Ranked) -> bool:
    """Whether two fits are of the same effects on the same joints."""
    return (one.names, one.joints) == (other.names, other.joints)


def _became(found: Attribution, less: Ranked, more: Ranked, rule: Rules) -> bool:
    """Whether an effect of a fit that explains is what is bent beyond belief without it.

    Then the world without it is none that a log could be of, however little worse it fits.
    """
    worst = found.fitter.nuisances[int(np.abs(less.fit.deviations).argmax())]
    same = any(
        isinstance(e, worst.kind) and e.joint in (None, worst.joint) for e in more.fit.effects
    )
    bent = less.bent > belief(less, rule) and more.bent < belief(more, rule)
    plain = is_white(found, less, rule) and is_plain(found, more, rule)
    return same and bent and plain and _lead(less, more) > 0.0


def _with_little(
    found: Attribution, ranked: Ranked, tried: Sequence[Ranked], rule: Rules
) -> Ranked:
    """A candidate, or it with the effect that is too small to accuse where that fits better.

    What the nominal world may have is no reason to accuse another: that must do better still. A
    nominal parameter that is bent beyond belief it may not have, nor one that is free of what is
    known of it, nor a sensor that is off, unless it reads in steps: a little play is in every
    mechanism.
    """
    count, stepped = len(ranked.names), _in_steps(found, rule)
    little = (
        one
        for one in tried
        if one.names[:count] == ranked.names
        and one.bent <= belief(one, rule)
        and (not is_read(one.fit.effects[-1]) or _on(found, one.fit.effects[-1]) <= stepped)
        and not _is_nominal(found, one)
        and not _beyond_nominal(found, one, rule)
    )
    return min((ranked, *little), key=_cost)


def _slightly_off(found: Attribution, small: Ranked, rule: Rules) -> Ranked | None:
    """A position sensor that is off by too little to accuse, and yet helps as what is accused must.

    It stands in for what is unknown: not every mechanism has a little of that, unlike of play, and
    of delay, and of what a sensor does that reads in steps.
    """
    off = [] if _in_steps(found, rule) else found.singles
    effects = ((one, one.fit.effects[-1]) for one in off)
    read = (one for one, effect in effects if is_read(effect) and effect.dimension != "time")
    best = min(read, key=_cost, default=small)
    return best if _lead(small, best) >= rule.accuse_nats else None


def _in_steps(found: Attribution, rule: Rules) -> set[str]:
    """Joints whose sensor reads in steps: its floor is wider than the model's own error."""
    evidence = found.fitter.evidence
    wide = evidence.floor[0, 0] > 1.01 * rule.floor_position_rad * evidence.size
    return set(compress(evidence.joints, wide))


def _on(found: Attribution, effect: Effect) -> set[str]:
    """The joints that an effect is on."""
    return set(found.fitter.evidence.joints) if effect.joint is None else {effect.joint}


def _pair(
    found: Attribution, best: Ranked, rule: Rules, doubted: bool
) -> tuple[Ranked, Ranked | None]:
    """The best single effect, and the best pair where that does not explain and a second adds.

    Where that effect is doubted, for a nominal parameter is bent beyond belief beside it, a second
    one need do no more than a first.

    The single one is fitted again from where pairs have taken the nominal parameters, also such as
    are no more than nominal, and from dip to dip before a second is named: a refit that stopped
    early would make any second effect look needed. Of its fits one that explains the log is taken
    where it is no worse than `BELIEVED`.
    """
    pair = _best_pair(found, best, rule)
    if pair is None:
        return best, None
    pair, cheapest = found.slopeless(pair), min((pair, *found.pairs), key=_cost)
    tried = {one.names + one.joints: one for one in (cheapest, pair)}
    halves = (one for other in tried.values() for one in found.halves(other))
    alone = (best, *(one for one in halves if _beyond_nominal(found, one, rule)))
    least = min(alone, key=_cost)
    if _became(found, least, pair, rule):
        return least, pair
    if _lead(least, pair) >= rule.pair_nats:
        least = min((least, found.again(found.slopeless(least, 0.0))), key=_cost)
        alone = (*alone, least)
    near = (one for one in alone if _lead(one, least) <= BELIEVED and explains(found, one, rule))
    best = min(near, key=_cost, default=least)
    firm = rule.pair_nats if is_white(found, pair, rule) else rule.firm_nats
    asked = rule.accuse_nats if doubted else firm
    if _lead(_with_little(found, least, found.pairs, rule), pair) < asked:
        return best, None
    enough = excess(pair.gap) <= (1 - rule.pair_share) * excess(best.gap)
    needed = enough or is_white(found, best, rule) or not explains(found, best, rule)
    return best, pair if needed else None


def _best_pair(found: Attribution, best: Ranked, rule: Rules) -> Ranked | None:
    """The pair that fits best: from the best single effect, and on while no pair explains.

    Where that one does not explain the log with nothing bent: a hard log. A pair that is far ahead
    of one that does is searched on, too: it may have ended beside its best magnitudes.
    """
    hard = not explains(found, best, rule) or best.bent > belief(best, rule)
    pairs: list[Ranked] = []
    for more in _pairs(found, best, rule, hard):
        pairs += [r for r in more if _beyond_nominal(found, r, rule)]
        if any(_settles(found, r, rule) for r in pairs):
            break
    for mend in (_unbent, _again, _stood_in):
        pairs.sort(key=_cost)
        far = bool(pairs) and _lead(best, pairs[0]) >= rule.firm_nats
        more = mend(found, pairs, rule) if pairs and (hard or far or mend is _unbent) else []
        pairs += [r for r in more if _beyond_nominal(found, r, rule)]
    return min(pairs, key=_cost, default=None)


def _settles(found: Attribution, pair: Ranked, rule: Rules) -> bool:
    """Whether no other pair is asked: it explains the log, and once more will be judged or settled.

    Where it is known how far joints stray in their play, what is left beyond that has a cause.
    """
    strays = bool(found.fitter.evidence.astray)
    return explains(found, pair, rule) and (not strays or pair.gap <= rule.settled_gap)


def _pairs(found: Attribution, best: Ranked, rule: Rules, hard: bool) -> Iterator[list[Ranked]]:
    """Pairs with the best single effect; of a hard log with what joined it, then with others."""
    worth = WORTH * rule.pair_nats
    seconds = found.second(best, worth, explained=not hard)
    yield seconds
    if not hard:
        return
    if seconds:
        yield found.exchanged(seconds[0])
    for other in [r for r in found.singles[1:] if r.names != best.names][:OTHERS]:
        yield found.second(other, worth)


def _unbent(found: Attribution, pairs: Sequence[Ranked], rule: Rules) -> list[Ranked]:
    """Pairs with the nominal parameter that the best pair bends beyond belief as an effect."""
    best = pairs[0]
    return found.instead(best) if best.bent > belief(best, rule) else []


def _again(found: Attribution, pairs: Sequence[Ranked], rule: Rules) -> list[Ranked]:
    """The best pairs searched anew where the first does not explain the log."""
    if explains(found, pairs[0], rule):
        return []
    different = {frozenset(zip(p.names, p.joints, strict=True)): p for p in reversed(pairs)}
    again = [found.elsewhere(p) for p in sorted(different.values(), key=_cost)[:ANEW]]
    best = min(again, key=_cost)
    return again if explains(found, best, rule) else [*again, found.again(best)]


def _stood_in(found: Attribution, pairs: Sequence[Ranked], rule: Rules) -> list[Ranked]:
    """Pairs with anything in place of either effect, where the best pair is white, and bent."""
    best = pairs[0]
    if best.bent <= belief(best, rule) or not is_white(found, best, rule):
        return []
    others = found.instead(best, anything=True)
    return [*others, found.again(min((best, *others), key=_cost))]


def _cost(ranked: Ranked) -> float:
    return ranked.fit.cost


def _strangeness(found: Attribution, ranked: Ranked) -> float:
    """How far a fit is from what the nominal world with its effects may leave, in nats."""
    left = found.leftover(ranked)
    deviations = max(ranked.surprise, ranked.bent, left.unevenness)
    return max(deviations**2 / 2, left.lack_of_fit)


def _lead(behind: Ranked, ahead: Ranked) -> float:
    """How much better the one ahead fits [nats], less where it does not explain the log itself.

    Over the variance of its block means (a quasi-likelihood: Burnham and Anderson, 2002).
    """
    return (behind.fit.cost - ahead.fit.cost) / ahead.spread


def _verdict(
    names: tuple[str, ...],
    chosen: Ranked,
    found: Attribution,
    tied: tuple[Ranked, ...],
    lead: float,
) -> LimbVerdict:
    return LimbVerdict(
        names=names, chosen=chosen, attribution=found, tied=tied, lead_nats=float(lead)
    )


def _beyond_nominal(found: Attribution, ranked: Ranked, rule: Rules) -> bool:
    """Whether its effects are more than nominal parameters within their uncertainty, or the floor.

    Each of them: the first of a pair, too, may be no more than that beside the second.
    """
    sound, pairs = found.fitter.evidence.sound, zip(ranked.names, ranked.fit.effects, strict=True)
    excused = sound and any(_size(found, e, ranked) <= sound.most(n, rule) for n, e in pairs)
    return not excused and all(_is_beyond(found, e, ranked, rule) for e in ranked.fit.effects)


def _is_beyond(found: Attribution, effect: Effect, ranked: Ranked, rule: Rules) -> bool:
    stds = [
        n.std
        for n in found.fitter.nuisances
        if (effect.dimension == "time" and n.kind is Late)
        or (isinstance(effect, n.kind) and effect.joint in (None, n.joint))
    ]
    stds += _floors(found.fitter.evidence, effect)
    return not stds or _size(found, effect, ranked) > rule.nominal_stds * min(stds)


def _is_nominal(found: Attribution, ranked: Ranked) -> bool:
    """Whether the last effect changes a nominal parameter, which is off in any fit as it may be."""
    return not found.fitter.free(ranked.fit.effects[-1:]).all()


def _floors(evidence: Evidence, effect: Effect) -> list[float]:
    """What the model's own error on each joint amounts to as magnitudes of an effect on it.

    None where it has no such measure. A scale's error is as large as the angles that it scales.
    """
    near = [k for k, joint in enumerate(evidence.joints) if effect.joint in (None, joint)]
    floor = evidence.floor[0, 0, near]
    if isinstance(effect, encoder_scale.Effect):
        angle = np.concatenate([r.measured[0] for r in evidence.recordings])[:, near]
        return list(floor / np.maximum(np.sqrt(np.nanmean(angle**2, axis=0)), floor))
    if effect.per_joint and effect.dimension == "angle":
        return list(floor)
    if effect.per_joint and effect.dimension == "torque":
        return [RUB * evidence.nominal.drives[k].torque_limit_nm for k in near]
    return []


def _size(found: Attribution, effect: Effect, ranked: Ranked) -> float:
    """Magnitude of an effect; of a delay with how late readings are, which look like it."""
    size = abs(effect.magnitude)
    if effect.dimension != "time":
        return size
    late = late_s(found.fitter.effects(ranked.fit))[0]
    return max(size, abs(effect.magnitude + late))
