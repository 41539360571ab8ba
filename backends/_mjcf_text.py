"""The text of a user's MJCF or URDF, before MuJoCo compiles it: bounded, whole, finite numbers.

MuJoCo reads other files, repeats parts as often as the text asks and reserves what it asks for.
Here only files within the model's folder are read, and only so much of them.
"""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from files.bounded import FileError, one_line, read_text

MOST_CHARACTERS = 1_000_000
"""Of the file and of all that it includes."""
MOST_ELEMENTS = 10_000
"""Most elements, those counted again that `replicate` repeats."""
REFUSED = {
    "attach": "models are not attached: write it out",
    "model": "models are not attached: write it out",
    "plugin": "plug-ins are not simulated here: delete it",
    "composite": "flexible bodies are not simulated here: delete it",
    "flexcomp": "flexible bodies are not simulated here: delete it",
    "flex": "flexible bodies are not simulated here: delete it",
}
"""Elements that are not taken, and what to do."""
DROPPED = frozenset(
    {"size", "hfield", "texture", "material", "skin", "keyframe", "visual", "statistic"}
    | {"sensor", "contact", "custom", "camera", "light"}
    | {"gazebo", "transmission", "ros2_control"}
)
"""Elements without an effect on the mechanism, in the worlds of MuJoCo, ROS and Gazebo; some may
reserve any amount of memory, and some name parts that are left out."""
NO_NUMBER = re.compile(r"[-+]?(nan|inf|infinity)", re.IGNORECASE)


class MjcfError(FileError):
    """A mechanism cannot be built; the message says what was given, what is allowed, what to do."""


def bounded(xml: str, folder: Path | None = None) -> tuple[Element, bool]:
    """The tree that MuJoCo may have, with what it includes, and whether that is nothing.

    Raises MjcfError.
    """
    root, seen = _parsed(xml), {"": len(xml)}
    _include(root, folder, seen)
    _drop(root)
    count = _elements(root)
    if count > MOST_ELEMENTS:
        raise MjcfError(f"it has {count:.3g} elements; allowed: up to {MOST_ELEMENTS}")
    return root, len(seen) == 1


def inside(folder: Path | None, name: str) -> Path:
    """A file that a model names, within its folder; raises MjcfError."""
    if folder is None:
        raise MjcfError(f"it names '{one_line(name, 60)}': no other file is read: write it out")
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise MjcfError(
            f"it names '{one_line(name, 60)}', which lies outside its folder: no other file is "
            "read; copy it there"
        )
    return path


def elements(root: Element, tag: str) -> Iterator[Element]:
    """What has a tag, a body's own parts and those of its frames, not of the bodies it carries."""
    for child in root:
        if child.tag == tag:
            yield child
        elif child.tag == "frame":
            yield from elements(child, tag)


def _parsed(xml: str) -> Element:
    if len(xml) > MOST_CHARACTERS:
        raise MjcfError(f"it has {len(xml)} characters; allowed: up to {MOST_CHARACTERS}")
    if "<!DOCTYPE" in xml or "<!ENTITY" in xml:
        raise MjcfError("it declares a document type or entities; allowed: none; write them out")
    try:
        return ElementTree.fromstring(xml)
    except (ElementTree.ParseError, ValueError) as error:
        raise MjcfError(f"it is no XML: {one_line(str(error))}; correct it") from None


def _include(root: Element, folder: Path | None, seen: dict[str, int]) -> None:
    """Put included files in place; `seen` has their characters: none is included twice."""
    waiting = [root]
    while waiting:
        parent = waiting.pop()
        for at, child in reversed(list(enumerate(parent))):
            if child.tag == "include":
                parent[at : at + 1] = _included(child.get("file", ""), folder, seen)
                waiting.append(parent)
                break
        else:
            waiting.extend(parent)


def _included(name: str, folder: Path | None, seen: dict[str, int]) -> list[Element]:
    path = inside(folder, name)
    if str(path) in seen:
        raise MjcfError(f"it includes '{one_line(name, 60)}' twice; allowed: once")
    try:
        text = read_text(path, MOST_CHARACTERS)
    except FileNotFoundError:
        raise MjcfError(
            f"it includes '{one_line(name, 60)}', which is missing; copy it there"
        ) from None
    except FileError as error:
        raise MjcfError(f"it includes {error}") from None
    seen[str(path)] = len(text)
    if sum(seen.values()) > MOST_CHARACTERS:
        raise MjcfError(f"it includes more than {MOST_CHARACTERS} characters, which is the most")
    return list(_parsed(text))


def _drop(root: Element) -> None:
    """Take away what does not matter, and what refers to it."""
    for parent in [one for one in root.iter() if one.tag != "link"]:
        for child in [one for one in parent if one.tag in DROPPED]:
            parent.remove(child)
    for link in root.findall("link"):  # of a URDF: shapes matter where no inertial stands
        shapes = ("visual", "collision") if link.find("inertial") is not None else ("visual",)
        for child in [one for one in link if one.tag in shapes]:
            link.remove(child)
    for one in root.iter():
        one.attrib.pop("material", None)


def _elements(root: Element) -> float:
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


def _refuse_infinite(element: Element) -> None:
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
