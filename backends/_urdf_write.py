"""Write numbers of joints and links into the text of a user's URDF; all else stays as it is.

A URDF has no gains, no armature and no play: those stand in the MJCF beside it.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from xml.etree.ElementTree import Element

from backends._mjcf_write import JointNumbers, parsed


def written_urdf(text: str, numbers: Mapping[str, JointNumbers]) -> str | None:
    """The text with these joints' friction, limits and masses; None where it is no URDF."""
    root = parsed(text)
    if root.tag != "robot":
        return None
    links = {link.get("name"): link for link in root.findall("link")}
    for joint in root.findall("joint"):
        one = numbers.get(joint.get("name", ""))
        if one is None:
            continue
        _set(joint, "dynamics", damping=one.damping, friction=one.frictionloss)
        limit = joint.find("limit")
        if limit is not None and one.limit:
            limit.set("effort", repr(one.limit))
        child = joint.find("child")
        link = links.get(child.get("link")) if child is not None else None
        mass = link.find("inertial/mass") if link is not None else None
        if mass is not None and one.mass_kg:
            mass.set("value", repr(one.mass_kg))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _set(parent: Element, tag: str, **values: float) -> None:
    """Write what is not zero, or was there, into a child that is made where it lacks."""
    child = parent.find(tag)
    if child is None:
        if not any(values.values()):
            return
        child = ElementTree.SubElement(parent, tag)
    for name, value in values.items():
        if value or child.get(name) is not None:
            child.set(name, repr(value))
