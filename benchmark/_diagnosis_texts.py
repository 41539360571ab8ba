"""The summary of a diagnosis for the terminal, and the effects that it adds."""

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from backends.effect import UNITS, Effect, NumberEffect
from backends.spec import Spec
from benchmark import registry
from benchmark.effects import effect_name, parse_effects
from diagnosis.attribution.magnitudes import Magnitude
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import NONE, LimbVerdict
from diagnosis.diagnose import Diagnosis
from diagnosis.report.report import wording

SHOWN, SHOWN_OF_NONE = 4, 2
"""Candidates per limb in the summary: with an effect, and without one."""
COLUMNS = (
    "log evidence ratio: how much better the best candidate fits than this one, in nats (1 nat is "
    "a factor of 2.7); misfit: residual on samples not used in fits, in standard deviations"
)
"""What the columns of the candidates mean."""


def effects_text(known: str, found: Sequence[Magnitude], ideal: Spec) -> str:
    """The corrected world as effects on the ideal hand: the known ones and those found.

    Raises UsageError where their sum is out of an effect's range.
    """
    fresh = [effect for magnitude in found for effect in _effects(magnitude, ideal)]
    have = parse_effects(known, ideal.hand)
    places = {(type(e), e.joint) for e in have}
    if not any((type(e), e.joint) in places for e in fresh):
        text = ",".join([*([] if known == NONE else [known]), *map(_item, fresh)]) or NONE
    else:
        text = ",".join(map(_item, _together([*have, *fresh])))
    parse_effects(text, ideal.hand)
    return text


def _effects(found: Magnitude, ideal: Spec) -> Iterator[Effect]:
    """A finding as effects: one for all joints, or one for each joint that it was found on."""
    kind: type[Effect] = registry.load("effect", found.effect)
    size = found.value * UNITS[found.unit][1]
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


def _item(effect: Effect) -> str:
    joint = f"@{effect.joint}" if effect.joint else ""
    return (
        f"{effect_name(effect)}={effect.magnitude / UNITS[effect.unit][1]:.4g}{effect.unit}{joint}"
    )


def summary(found: Diagnosis, result: dict) -> RenderableType:
    """The summary: the verdict, the gap, the best candidates, ties, and what to do next."""
    lines = [f"{wording.sentence(found)} Confidence: {wording.confidence(found)}."]
    lines += [f"{wording.shrinkage(found)} Brackets hold 90 % intervals."]
    if found.gap_before > found.noise_floor:
        lines.append(_where(found))
    lines += [f"{wording.finding(one)}." for one in found.beside]
    lines += [f"Not settled: {wording.tie(row)}." for row in found.indistinguishable]
    if found.unseen:
        lines.append(f"{wording.listed(found.unseen)}: this log shows nothing of the drive.")
    if result["healthy"]["logs"]:
        lines.append(f"Healthy logs: {wording.healthy(result['healthy'], rules())}.")
    lines += [f"Not judged: {text}." for text in found.missing]
    lines += [f"Warning: {warning}" for warning in result["warnings"]]
    end = [f"Next: {command}  ({what})" for command, what in result["next"].items()]
    end.append(f"Wrote {' and '.join(result['written'])}. CPU time: {found.cpu_s:.0f} s.")
    accused = [limb for limb in found.limbs if limb.names != (NONE,)]
    table = _candidates(accused, SHOWN) if accused else _candidates(found.limbs, SHOWN_OF_NONE)
    return Group(*map(Text, lines), table, *map(Text, end))


def _where(found: Diagnosis) -> str:
    place = found.where[0]
    return (
        f"Largest part of the gap: {place.channel} of {place.joint}, protocol {place.protocol}, "
        f"phase {place.phase}: {100 * place.share:.0f} % of the squared gap."
    )


def _candidates(limbs: Sequence[LimbVerdict], shown: int) -> Table:
    table = Table(header_style="bold", caption=Text(COLUMNS), caption_justify="left")
    for column in ("joints", "candidate", "magnitude", "log evidence ratio", "misfit"):
        table.add_column(column, overflow="fold")
    for limb in limbs:
        best = limb.ranking[0].fit.cost
        for one in limb.ranking[:shown]:
            table.add_row(
                ", ".join(limb.attribution.fitter.evidence.joints),
                wording.candidate(one),
                wording.amounts(one),
                f"{one.fit.cost - best:.1f}",
                f"{one.gap:.2f}",
            )
    return table
