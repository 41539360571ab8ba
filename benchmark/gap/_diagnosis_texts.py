"""The summary of a diagnosis for the terminal, and the effects that it adds."""

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from backends.effect import Effect, NumberEffect
from backends.spec import Spec
from benchmark.settings.effects import EffectSet, Kinds, effect_text, parse_effects
from diagnosis.answer import Diagnosis
from diagnosis.report import wording
from diagnosis.verdict.result import NONE, UNKNOWN, Cause, LimbResult, Nominal, Ranked

SHOWN, SHOWN_OF_NONE = 4, 2
"""Candidates per limb in the summary: with an effect, and without one."""
MOVED = 6
"""Nominal numbers in the summary."""
DIGITS = 4
"""Of a size in the corrected world."""
COLUMNS = "share: of the squared gap beyond one noise floor; left: of the worst joint, in floors"
"""What the columns of the candidates mean."""


def effects_text(known: EffectSet, found: Sequence[Cause], ideal: Spec, kinds: Kinds) -> str:
    """The corrected world as effects on the ideal hand: the known ones and those found.

    Raises UsageError where their sum is out of an effect's range.
    """
    fresh = [effect for one in found for effect in _effects(one, ideal, kinds[one.effect])]
    places = {(type(e), e.joint) for e in known.effects}
    first, rest = [known.text] if known.effects else [], fresh
    if any((type(e), e.joint) in places for e in fresh):
        first, rest = [], _together([*known.effects, *fresh])
    text = ",".join([*first, *(effect_text(one, ideal, DIGITS) for one in rest)]) or NONE
    parse_effects(text, ideal.hand, kinds)
    return text


def _effects(found: Cause, ideal: Spec, kind: type[Effect]) -> Iterator[Effect]:
    """A finding as effects: one for all joints, or one for each joint that it was found on."""
    size = found.sizes[0]
    everywhere = kind(magnitude=size)
    if not kind.per_joint or everywhere.joints(ideal) == found.joints:
        yield everywhere
    else:
        yield from (kind(magnitude=size, joint=joint) for joint in found.joints)


def _together(effects: Sequence[Effect]) -> list[Effect]:
    """The same world with every effect at most once per joint."""
    sums: dict[tuple[type[Effect], str | None], Effect] = {}
    for effect in effects:
        place = (type(effect), effect.joint)
        have = sums[place].magnitude if place in sums else 0.0
        relative = isinstance(effect, NumberEffect) and effect.relative
        both = have * effect.magnitude if relative else 0.0
        sums[place] = type(effect)(magnitude=have + effect.magnitude + both, joint=effect.joint)
    return list(sums.values())


def summary(found: Diagnosis, result: dict) -> RenderableType:
    """The summary: the verdict, the gap, the best candidates, ties, and what to do next."""
    lines = [*found.sentences]
    gaps = f"{wording.gaps(found)} Brackets hold 90 % intervals."
    lines.append(f"Probability: {wording.probability(found)}. {gaps}")
    if found.gaps.before.value > 1.0 and found.verdict != (UNKNOWN,):
        lines.append(_where(found))
    if found.nominal:
        lines.append(f"Nominal numbers that took part of the gap: {_moved(found.nominal)}.")
    if model := result.get("model"):
        lines += [f"Model: {text}." for text in model["words"]]
    lines += [f"Not judged: {text}." for text in found.missing]
    lines += [f"Warning: {text}" for text in (*found.notes, *result["warnings"])]
    end = [f"Next: {text}." for text in wording.next_steps(found)]
    end += [f"Next: {command}  ({what})" for command, what in result["next"].items()]
    end.append(f"Wrote {', '.join(result['written'])}. CPU time: {found.cpu_s:.0f} s.")
    accused = [limb for limb in found.limbs if limb.verdict != (NONE,)]
    table = _candidates(accused, SHOWN) if accused else _candidates(found.limbs, SHOWN_OF_NONE)
    return Group(*map(Text, lines), table, *map(Text, end))


def _moved(nominal: Sequence[Nominal]) -> str:
    """The surest of the numbers that moved, and how many more there are."""
    surest = sorted(nominal, key=lambda one: -abs(one.value) / max(one.sd, 1e-12))
    words = wording.listed(wording.moved(one) for one in surest[:MOVED])
    more = len(nominal) - MOVED
    return f"{words}; diagnosis.json has {more} more" if more > 0 else words


def _where(found: Diagnosis) -> str:
    place = found.where[0]
    return (
        f"Largest part of the gap: {place.channel} of {place.joint}, protocol {place.protocol}, "
        f"phase {place.phase}: {100 * place.share:.0f} % of the squared gap."
    )


def _candidates(limbs: Sequence[LimbResult], shown: int) -> Table:
    table = Table(header_style="bold", caption=Text(COLUMNS), caption_justify="left")
    for column in ("joints", "causes", "share", "left"):
        table.add_column(column, overflow="fold")
    for limb in limbs:
        for one in limb.ranking[:shown]:
            share, left = f"{round(100 * one.share)} %", f"{one.left:.2f}"
            table.add_row(", ".join(limb.joints), _name(one), share, left)
    return table


def _name(one: Ranked) -> str:
    names = [effect if joint is None else f"{effect} on {joint}" for effect, joint in one.causes]
    return " + ".join(names) or "nominal numbers alone"
