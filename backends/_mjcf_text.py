"""The text of a user's MJCF, before MuJoCo compiles it: bounded, alone, with finite numbers.

MuJoCo reads other files, repeats parts as often as the text asks and reserves what it asks for.
"""

import math
import re
from xml.etree import ElementTree

from files.bounded import one_line

MOST_CHARACTERS = 1_000_000
MOST_ELEMENTS = 10_000
"""Most elements, those counted again that `replicate` repeats."""
REFUSED = {
    "include": "no other file is read: write it out",
    "attach": "no other file is read: write it out",
    "model": "no other file is read: write it out",
    "plugin": "plug-ins are not simulated here: delete it",
    "composite": "flexible bodies are not simulated here: delete it",
    "flexcomp": "flexible bodies are not simulated here: delete it",
    "flex": "flexible bodies are not simulated here: delete it",
}
"""Elements that are not taken, and what to do."""
DROPPED = frozenset({"size", "hfield", "mesh", "texture", "skin", "keyframe", "visual"})
"""Elements under the root or its assets without an effect on the mechanism; they may reserve any
amount of memory."""
NO_NUMBER = re.compile(r"[-+]?(nan|inf|infinity)", re.IGNORECASE)


class MjcfError(ValueError):
    """A mechanism cannot be built; the message says what was given, what is allowed, what to do."""


def bounded(xml: str) -> str:
    """The text as MuJoCo may have it, without what has no effect; raises MjcfError."""
    if len(xml) > MOST_CHARACTERS:
        raise MjcfError(f"it has {len(xml)} characters; allowed: up to {MOST_CHARACTERS}")
    if "<!DOCTYPE" in xml or "<!ENTITY" in xml:
        raise MjcfError("it declares a document type or entities; allowed: none; write them out")
    try:
        root = ElementTree.fromstring(xml)
    except (ElementTree.ParseError, ValueError) as error:
        raise MjcfError(f"it is no XML: {one_line(str(error))}; correct it") from None
    count = _elements(root)
    if count > MOST_ELEMENTS:
        raise MjcfError(f"it has {count:.3g} elements; allowed: up to {MOST_ELEMENTS}")
    for parent in (root, *root.iter("asset")):
        for child in [one for one in parent if one.tag in DROPPED]:
            parent.remove(child)
    return ElementTree.tostring(root, encoding="unicode")


def _elements(root: ElementTree.Element) -> float:
    """How many elements MuJoCo will make of the text; raises MjcfError for one that is refused."""
    count, waiting = 0.0, [(root, 1.0)]
    while waiting:
        element, times = waiting.pop()
        count += times
        if element.tag in REFUSED and element is not root:
            raise MjcfError(f"it has <{element.tag}>: {REFUSED[element.tag]}")
        _refuse_infinite(element)
        if element.tag == "replicate":
            times *= _number(element.get("count", "1"))
        waiting.extend((child, times) for child in element)
    return count


def _refuse_infinite(element: ElementTree.Element) -> None:
    for name, value in element.attrib.items():
        strange = [word for word in value.split() if NO_NUMBER.fullmatch(word)]
        if strange and name not in ("name", "class", "childclass"):
            raise MjcfError(
                f'<{one_line(element.tag, 40)}> has {one_line(name, 40)}="{one_line(value, 40)}"; '
                "allowed: finite numbers"
            )


def _number(text: str) -> float:
    try:
        value = abs(float(text))
    except ValueError:
        return 1.0
    return value if math.isfinite(value) else MOST_ELEMENTS + 1.0
