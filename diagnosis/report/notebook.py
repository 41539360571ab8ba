"""A diagnosis as a notebook shows it: the sentences, the bar of shares, the sizes."""

from html import escape

from diagnosis.answer import Diagnosis
from diagnosis.report import wording
from diagnosis.report.report import Part, parts
from diagnosis.verdict.sentences import size

_COLORS = {"nominal": "#7a9e3f", "cause": "#2b6cb0", "second": "#7fa8d6", "left": "#9a9a9a"}


def shown(found: Diagnosis) -> str:
    """A piece of HTML that follows the notebook's colours."""
    first, *rest = map(escape, found.sentences)
    said = [f"<p><b>{first}</b></p>", *(f"<p>{text}</p>" for text in rest)]
    sure = f"<p>Probability: {wording.probability(found)}.</p>"
    return f"<div>{''.join(said)}{sure}{_bar(list(parts(found)))}{_sizes(found)}</div>"


def _bar(shares: list[Part]) -> str:
    pieces = "".join(
        f'<span style="width:{100 * one.share:.1f}%;background:{_COLORS[one.kind]}"></span>'
        for one in shares
    )
    names = ", ".join(f"{escape(one.name)} {100 * one.share:.0f} %" for one in shares)
    return f'<div style="display:flex;height:1em;max-width:40em">{pieces}</div><p>{names}</p>'


def _sizes(found: Diagnosis) -> str:
    if not found.magnitudes:
        return ""
    rows = "".join(
        f"<tr><td>{escape(one.effect)}</td><td>{escape(', '.join(one.joints) or '-')}</td>"
        f"<td>{size(one)}</td><td>{one.low:.3g} to {one.high:.3g}</td></tr>"
        for one in found.magnitudes
    )
    heads = "".join(f"<th>{name}</th>" for name in ("effect", "joints", "size", "90 % interval"))
    return f"<table><tr>{heads}</tr>{rows}</table>"
