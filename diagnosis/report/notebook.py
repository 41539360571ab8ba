"""A diagnosis as a notebook shows it: the sentences, the shares of the gap, the sizes."""

from html import escape

from diagnosis.answer import Diagnosis
from diagnosis.report import wording
from diagnosis.report.report import parts
from diagnosis.verdict.sentences import named


def shown(found: Diagnosis) -> str:
    """A piece of HTML that follows the notebook's colours."""
    first, *rest = found.sentences
    shares = ", ".join(f"{one.name} {100 * one.share:.0f} %" for one in parts(found))
    rest += [f"Probability: {wording.probability(found)}. Of the gap: {shares}."]
    rest += [f"{named(one)}, with its 90 % interval." for one in found.magnitudes]
    lines = "".join(f"<p>{escape(text)}</p>" for text in rest)
    return f"<div><p><b>{escape(first)}</b></p>{lines}</div>"
