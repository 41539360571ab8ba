"""Write numbers of joints and drives into the text of a user's MJCF; all else stays as it is."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from backends._mjcf_actuators import TENDON, file_drive, lever
from backends._mjcf_followers import followers
from backends._mjcf_model import as_mjcf, compiled, end_m
from backends._mjcf_play import FIRM
from backends._mjcf_text import MjcfError
from backends.spec import Vec3

KEPT = ("name", "class", "group", "ctrlrange", "ctrllimited", "gear")
"""Attributes of an actuator that a position servo in its place keeps."""
BEARING = 1e-3
"""Friction of a rolling bearing over what it carries (SKF, Rolling bearings, 2018: 0.001 to 0.002),
at the drive's largest torque."""
TINY = 1e-9
"""Shares that differ by no more are the same."""
TIGHT = 1e-5
"""Play of no more than this to either side is none [rad or m]: it would only slow a simulation."""


@dataclass(frozen=True, kw_only=True)
class JointNumbers:
    """What is written of one joint [Nm, rad, s]; of a slide [N, m, s]."""

    kp: float
    """Proportional gain of its position servo."""
    kd: float
    """Derivative gain of it."""
    limit: float | None
    """Largest torque of it."""
    armature: float
    """Inertia on the motor's side [kg m^2], of a slide [kg]."""
    damping: float
    """Viscous friction."""
    frictionloss: float
    """Coulomb friction."""
    creeps: bool = field(default=False, compare=False)
    """Whether dry friction yields under load, as MuJoCo's does by default."""
    mass_kg: float
    """Mass of the body that it carries; 0: another joint of the same body has it."""

    payload: float = 0.0
    """Mass of a point that the body carries, over its own mass."""
    payload_m: Vec3 | None = None
    """Where, in the body's frame [m]; None: at its end."""
    open: bool = False
    """Whether it is a motor, whose `kp` is the gain of the torque that it is given."""
    note: str = ""
    """What its drive does that an MJCF cannot hold: written as a comment."""
    play: float = 0.0
    """Half of its gear's play: a hinge or slide behind the joint, between stops."""
    ends: tuple[float, float] | None = None
    """Where its end stops stand; None: as in the file."""
    stiffness: float = 0.0
    """Stiffness of the spring at the joint."""
    rest: float = 0.0
    """Where that spring pushes nothing."""
    zero: float = 0.0
    """By how much more than in the file it reads where it stands."""


def written(
    xml: str,
    numbers: Mapping[str, JointNumbers],
    gravity_m_s2: tuple[float, float, float] | None = None,
    held: Collection[str] = (),
    carried: Mapping[str, float] | None = None,
    others: float = 0.0,
    timestep_s: float | None = None,
) -> str:
    """The text with these joints' numbers, and a position servo on each; raises MjcfError.

    A URDF becomes the MJCF that MuJoCo makes of it. `gravity_m_s2`: None for the file's. `held`:
    joints that follow none. `carried`: the share of each link's weight that is carried beside its
    drive, by joint; of all other bodies `others`, beside what the file says.
    `timestep_s`: in place of the file's.
    """
    model, root = compiled(xml), parsed(as_mjcf(xml))
    step_s = timestep_s or model.opt.timestep
    numbers = _without_followers(model, numbers, held)
    if gravity_m_s2 is not None:
        _option(root).set("gravity", _text(gravity_m_s2))
    if timestep_s is not None:
        _option(root).set("timestep", repr(timestep_s))
    _set_carried(root, carried or {}, others)
    for name, one in numbers.items():
        body, joint = _found(root, name)
        joint.set("armature", repr(one.armature))
        joint.set("damping", repr(one.damping + one.open * one.kd))
        _set_friction(joint, model, name, one, step_s)
        _set_zero(root, joint, model, name, one)
        if model.jnt_actfrclimited[model.joint(name).id]:  # the servo has the limit
            joint.attrib.pop("actuatorfrcrange", None)
            joint.set("actuatorfrclimited", "false")
        _set_mass(body, model, model.joint(name).bodyid[0], one.mass_kg)
        if one.payload * one.mass_kg:
            _set_payload(body, model, model.joint(name).bodyid[0], one)
        _set_servo(root, model, name, one)
        if one.ends:
            joint.attrib |= _limits(root, model, name, *one.ends)
        if one.play > TIGHT and len(body.findall("joint")) == 1:
            _set_play(root, body, joint, model, one, step_s)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _without_followers(
    model: mujoco.MjModel, numbers: Mapping[str, JointNumbers], held: Collection[str]
) -> dict[str, JointNumbers]:
    """Joints' numbers less what joints that follow them have in the file, and keep."""
    found = {model.joint(name).id: one for name, one in numbers.items()}
    for j, one in followers(model, list(found), held)[0].items():
        own, file, far = found[one.leader], file_drive(model, j), abs(one.rate)
        loss = far * float(model.dof_frictionloss[model.jnt_dofadr[j]])
        pulls = far**2 * float(model.jnt_stiffness[j])
        left = max(own.stiffness - pulls, 0.0)
        rests = float(model.qpos_spring[model.jnt_qposadr[j]]) - one.course[0]
        found[one.leader] = replace(
            own,
            armature=max(own.armature - far**2 * file.armature, 0.0),
            damping=max(own.damping - far**2 * file.damping, 0.0),
            frictionloss=max(own.frictionloss - loss, 0.0),
            stiffness=left,
            rest=(own.stiffness * own.rest - pulls * rests / one.rate) / left if left else 0.0,
        )
    return {model.joint(j).name: one for j, one in found.items()}


def _option(root: Element) -> Element:
    """The last options of a model, which count."""
    return (root.findall("option") or [ElementTree.SubElement(root, "option")])[-1]


def parsed(text: str) -> Element:
    """The tree with its comments."""
    builder = ElementTree.TreeBuilder(insert_comments=True)
    return ElementTree.fromstring(text, ElementTree.XMLParser(target=builder))


def _found(root: Element, name: str) -> tuple[Element, Element]:
    """A joint and the body that it moves; raises MjcfError."""
    for body, joint in _joints(root, root):
        if joint.get("name") == name:
            return body, joint
    raise MjcfError(f"its joint '{name}' is made by a repetition; write it out, to correct it")


def _joints(parent: Element, body: Element) -> Iterator[tuple[Element, Element]]:
    for child in parent:
        if child.tag == "joint" and body.tag == "body":
            yield body, child
        elif child.tag in ("worldbody", "frame"):
            yield from _joints(child, body)
        elif child.tag == "body":
            yield from _joints(child, child)


def _set_friction(
    joint: Element, model: mujoco.MjModel, name: str, one: JointNumbers, step_s: float
) -> None:
    """Write dry friction; another than the file's holds, as a robot's, where it does not creep."""
    if one.frictionloss != model.dof_frictionloss[model.joint(name).dofadr[0]] and not one.creeps:
        _rub(joint, one.frictionloss, step_s)
    joint.set("frictionloss", repr(one.frictionloss))


def _rub(joint: Element, loss: float, step_s: float) -> None:
    """Write dry friction that holds."""
    joint.set("frictionloss", repr(loss))
    joint.set("solreffriction", f"{2 * step_s!r} 1")
    joint.set("solimpfriction", f"{_text(FIRM)} 0.001")


def _set_zero(
    root: Element, joint: Element, model: mujoco.MjModel, name: str, one: JointNumbers
) -> None:
    """Write the zero of a joint and its spring, where they are others."""
    own, in_file, rest = model.joint(name), _in_file(root, model, name), one.rest + one.zero
    if one.zero:
        joint.set("ref", repr(float(in_file(own.qpos0[0] + one.zero))))
    there = one.stiffness or own.stiffness[0]
    if there and (one.stiffness, rest) != (own.stiffness[0], own.qpos_spring[0]):
        joint.set("stiffness", repr(one.stiffness))
        joint.set("springref", repr(float(in_file(rest))))


def _set_mass(body: Element, model: mujoco.MjModel, b: int, mass_kg: float) -> None:
    """Write the mass of a body, if it is another one, into its inertial."""
    if not mass_kg or abs(mass_kg - model.body_mass[b]) <= 1e-9 * mass_kg:
        return
    inertial = body.find("inertial")
    if inertial is None:
        place = {"pos": model.body_ipos[b], "quat": model.body_iquat[b]}
        own = place | {"diaginertia": model.body_inertia[b]}
        text = {name: _text(value) for name, value in own.items()}
        inertial = Element("inertial", text)
        body.insert(0, inertial)
    inertial.set("mass", repr(mass_kg))


def _set_carried(root: Element, carried: Mapping[str, float], others: float) -> None:
    """Write gravity compensation, where it is another."""
    for body in root.iter("body"):
        file = float(body.get("gravcomp", 0.0))
        share = 1.0 - (1.0 - file) * (1.0 - others)
        for joint in body.findall("joint"):
            share = carried.get(joint.get("name", ""), share)
        if abs(share - file) > TINY:
            body.set("gravcomp", repr(share))


def _set_payload(body: Element, model: mujoco.MjModel, b: int, one: JointNumbers) -> None:
    """Fix a point mass to a body."""
    mass_kg, at_m = one.payload * one.mass_kg, one.payload_m or end_m(model, b)
    place = {"name": f"{body.get('name', 'body')}_payload", "pos": _text(at_m)}
    small = {"pos": "0 0 0", "mass": repr(mass_kg), "diaginertia": _text([1e-9 * mass_kg] * 3)}
    load = ElementTree.SubElement(body, "body", place)
    ElementTree.SubElement(load, "inertial", small)


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _set_play(
    root: Element,
    body: Element,
    joint: Element,
    model: mujoco.MjModel,
    one: JointNumbers,
    step_s: float,
) -> None:
    """Put a body without mass between a joint and the body that it moves, which is loose on it.

    Its bearing rubs: what nothing moves stays where it is in its play.
    """
    name = joint.get("name", "")
    j, gear = model.joint(name).id, Element("body", dict(body.attrib))
    gear.set("name", f"{name}_gear")
    for pose in ("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis"):
        body.attrib.pop(pose, None)
    parent = next(one for one in root.iter() if body in list(one))
    place = list(parent).index(body)
    parent.remove(body)
    parent.insert(place, gear)
    body.remove(joint)
    gear.append(Element("inertial", {"pos": "0 0 0", "mass": "1e-6", "diaginertia": "1e-9 " * 3}))
    gear.extend([joint, body])
    loose = {
        "name": f"{name}_play",
        "type": "slide" if _slides(model, name) else "hinge",
        "axis": _text(model.jnt_axis[j]),
        "pos": _text(model.jnt_pos[j]),
    }
    stops = _limits(root, model, name, -one.play, one.play)
    still = dict.fromkeys(("damping", "armature", "stiffness"), "0")
    body.insert(0, Element("joint", loose | stops | still))
    _rub(body[0], BEARING * (one.limit or 0.0), step_s)


def _slides(model: mujoco.MjModel, name: str) -> bool:
    return int(model.jnt_type[model.joint(name).id]) == int(mujoco.mjtJoint.mjJNT_SLIDE)


def _limits(
    root: Element, model: mujoco.MjModel, name: str, low: float, high: float
) -> dict[str, str]:
    """Attributes of stops for a joint like this [rad, m], in the file's unit of angles.

    As firm as friction that holds: MuJoCo's stops else give way under a light link.
    """
    in_file = _in_file(root, model, name)
    ends = " ".join(repr(float(in_file(end))) for end in (low, high))
    firm = {"solreflimit": "0.004 1", "solimplimit": f"{_text(FIRM)} 0.001"}
    return {"range": ends, "limited": "true"} | firm


def _in_file(root: Element, model: mujoco.MjModel, name: str) -> Callable[[float], Any]:
    """An angle [rad] of a joint in the file's unit, or a slide's [m]."""
    turned = all(one.get("angle") != "radian" for one in root.findall("compiler"))
    return np.degrees if turned and not _slides(model, name) else np.asarray


def _set_servo(root: Element, model: mujoco.MjModel, name: str, one: JointNumbers) -> None:
    """Put a position servo in the place of a joint's actuators, those on its tendons too."""
    sections = root.findall("actuator") or [ElementTree.SubElement(root, "actuator")]
    servo, first = Element("position", {"joint": name}), None
    own = {a: by for a in range(model.nu) if (by := lever(model, a, model.joint(name).id))}
    by_tendon = [a for a in own if int(model.actuator_trntype[a]) == TENDON]
    tendons = {model.tendon(model.actuator_trnid[a, 0]).name for a in by_tendon}
    for section in sections:
        for old in [
            e
            for e in section
            if name in (e.get("joint"), e.get("jointinparent")) or e.get("tendon") in tendons
        ]:
            if first is None:
                first = old
                section.insert(list(section).index(old), servo)
            section.remove(old)
    if first is None:
        sections[0].append(servo)
    else:
        servo.attrib |= {key: first.get(key, "") for key in KEPT if first.get(key) is not None}
    if one.note:
        section = next(part for part in sections if servo in list(part))
        section.insert(list(section).index(servo), ElementTree.Comment(f" {one.note} "))
    by = next(iter(own.values()), 1.0)
    if by_tendon:
        servo.set("gear", repr(by))
    if one.open:  # the torque in place of a control within the file's range
        servo.tag, by = "general", 1.0
        servo.attrib = {k: x for k, x in servo.attrib.items() if k in ("name", "joint", "class")}
        servo.attrib |= {"gear": "1", "gainprm": repr(one.kp), "ctrllimited": "false"}
    else:
        servo.set("kp", repr(one.kp / by**2))
        servo.set("kv", repr(one.kd / by**2))
    servo.set("forcelimited", "true" if one.limit else "false")
    if one.limit:
        most = one.limit / abs(by)
        servo.set("forcerange", f"{-most!r} {most!r}")
