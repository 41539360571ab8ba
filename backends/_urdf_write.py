"""Write numbers of joints and links into the text of a user's URDF; all else stays as it is.

A URDF has no gains, no armature and no play: those stand in the MJCF beside it.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from xml.etree.ElementTree import Element

from backends._mjcf_model import compiled, end_m
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
        if limit is not None and one.ends:
            limit.attrib |= dict(zip(("lower", "upper"), map(repr, one.ends), strict=True))
        child = joint.find("child")
        link = links.get(child.get("link")) if child is not None else None
        mass = link.find("inertial/mass") if link is not None else None
        if mass is not None and one.mass_kg:
            mass.set("value", repr(one.mass_kg))
        if link is not None and one.payload * one.mass_kg:
            _add_payload(root, link, text, one)
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


def _add_payload(root: Element, link: Element, text: str, one: JointNumbers) -> None:
    """Fix a point mass to a link."""
    model, name = compiled(text), link.get("name", "")
    load = ElementTree.SubElement(root, "link", {"name": f"{name}_payload"})
    inertial, mass_kg = ElementTree.SubElement(load, "inertial"), one.payload * one.mass_kg
    ElementTree.SubElement(inertial, "mass", {"value": repr(mass_kg)})
    small = dict.fromkeys(("ixx", "iyy", "izz"), repr(1e-9 * mass_kg))
    ElementTree.SubElement(inertial, "inertia", small | dict.fromkeys(("ixy", "ixz", "iyz"), "0"))
    joint = ElementTree.SubElement(root, "joint", {"name": f"{name}_holds", "type": "fixed"})
    ElementTree.SubElement(joint, "parent", {"link": name})
    ElementTree.SubElement(joint, "child", {"link": f"{name}_payload"})
    at_m = one.payload_m or end_m(model, model.body(name).id)
    place = " ".join(repr(float(x)) for x in at_m)
    ElementTree.SubElement(joint, "origin", {"xyz": place})
