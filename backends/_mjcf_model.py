"""Compile a user's MJCF or URDF as MuJoCo reads it, and make its text whole.

A whole text needs no other file: what it includes is in it, and where a body's mass comes from a
mesh, the body has the inertial that MuJoCo makes of that mesh. Other meshes, like all that is only
seen, matter to nothing.
"""

from collections.abc import Collection, Mapping
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from backends._mjcf_text import MjcfError, bounded, elements, inside
from backends.state import Array
from files.bounded import FileError, one_line, read_bytes

MOST_MESH_BYTES = 50_000_000
"""Largest mesh that is read."""
HEIGHTS = mujoco.mjtGeom.mjGEOM_HFIELD


def whole(xml: str, folder: Path | None = None) -> str:
    """The text of a model in a folder without other files; raises MjcfError."""
    text, needs_others = _prepared(xml, folder)
    return text if needs_others else xml


def _prepared(xml: str, folder: Path | None = None) -> tuple[str, bool]:
    """The whole text without what does not matter, and whether the text itself needs other files.

    Raises MjcfError.
    """
    root, alone = bounded(xml, folder)
    if root.tag == "mujoco":
        _name(root)
    text = ElementTree.tostring(root, encoding="unicode")
    spec = _spec(text)
    heavy = [geom for geom in spec.geoms if geom.meshname and _weighs(spec, geom)]
    if not heavy:
        return text, not alone
    names = {str(geom.meshname) for geom in heavy}
    bodies = {str(geom.parent.name) for geom in heavy}
    model = _weighed(spec, names, _files(spec, heavy, folder, root.tag))
    for body in [one for one in root.iter("body") if one.get("name") in bodies]:
        _set_inertial(body, model)
    return ElementTree.tostring(root, encoding="unicode"), True


@lru_cache(maxsize=8)
def compiled(xml: str) -> mujoco.MjModel:
    """The compiled model, which nobody changes; raises MjcfError."""
    spec = _spec(_prepared(xml)[0])
    _strip(spec)
    return _compile(spec)


def as_mjcf(xml: str) -> str:
    """The text of an MJCF as it is, or what MuJoCo makes of a URDF; raises MjcfError."""
    if ElementTree.fromstring(xml).tag == "mujoco":
        return xml
    spec = _spec(_prepared(xml)[0])
    _strip(spec)
    _compile(spec)
    return spec.to_xml()


def _spec(text: str) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_string(text)
    except (ValueError, RuntimeError) as error:
        raise MjcfError(f"MuJoCo cannot read it: {one_line(str(error))}") from None


def _compile(spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return spec.compile()
    except (ValueError, RuntimeError) as error:
        raise MjcfError(f"MuJoCo cannot compile it: {one_line(str(error))}") from None


def _name(root: Element) -> None:
    """Give every body a name."""
    taken = {one.get("name") for one in root.iter("body")}
    for number, body in enumerate(root.iter("body")):
        if not body.get("name"):
            name = f"body{number}"
            body.set("name", name if name not in taken else f"{name}_")


def _weighs(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> bool:
    """Whether a moving body has mass from a geom."""
    body, mode = geom.parent, spec.compiler.inertiafromgeom
    always = mode == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    never = mode == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    first, last = spec.compiler.inertiagrouprange
    counts = always or not (never or body.explicitinertial)
    mass = geom.mass if geom.mass == geom.mass else geom.density
    return bool(counts and first <= geom.group <= last and mass > 0.0 and _moves(body))


def _moves(body: mujoco.MjsBody | None) -> bool:
    """Whether joints carry a body; a free joint may only be held."""
    while body is not None and body.name != "world":
        if any(joint.type != mujoco.mjtJoint.mjJNT_FREE for joint in body.joints):
            return True
        body = body.parent
    return False


def _files(
    spec: mujoco.MjSpec, heavy: list[mujoco.MjsGeom], folder: Path | None, kind: str
) -> dict[str, bytes]:
    """The files of the meshes that have a mass, by mesh; raises MjcfError where one is missing."""
    home = spec.compiler.meshdir
    found: dict[str, bytes] = {}
    for geom in heavy:
        mesh = spec.mesh(geom.meshname)
        file = mesh.file if mesh is not None else ""
        if mesh is not None and not file:
            continue
        mass = f"the mass of body '{geom.parent.name}' is in mesh '{geom.meshname}'"
        if kind != "mujoco" or not file:
            raise MjcfError(f"{mass}, which is not read; write an inertial")
        try:
            path = inside(folder, str(Path(home) / file))
            found[geom.meshname] = read_bytes(path, MOST_MESH_BYTES)
        except FileNotFoundError:
            raise MjcfError(
                f"{mass}, and {file} is missing; copy it, or write an inertial"
            ) from None
        except MjcfError as error:
            raise MjcfError(f"{mass}: {error}, or write an inertial") from None
        except FileError as error:
            raise MjcfError(f"{mass}: {error}") from None
    return found


def _weighed(spec: mujoco.MjSpec, names: set[str], files: Mapping[str, bytes]) -> mujoco.MjModel:
    """The model with its heavy meshes."""
    held = {}
    for number, (name, data) in enumerate(files.items()):
        mesh = spec.mesh(name)
        mesh.file = f"mesh{number}{Path(mesh.file).suffix}"
        held[mesh.file] = data
    spec.compiler.meshdir, spec.assets = "", held
    _strip(spec, names)
    return _compile(spec)


def _strip(spec: mujoco.MjSpec, kept: Collection[str] = ()) -> None:
    """Take away meshes, but those kept, and what has their shape."""
    for geom in [one for one in spec.geoms if one.meshname or one.type == HEIGHTS]:
        if geom.meshname not in kept:
            spec.delete(geom)
    for mesh in [one for one in spec.meshes if one.name not in kept]:
        spec.delete(mesh)


def _set_inertial(body: Element, model: mujoco.MjModel) -> None:
    """Write the inertial that a body has of its geoms, in place of these."""
    for parent in [body, *elements(body, "frame")]:
        for child in [one for one in parent if one.tag in ("geom", "inertial")]:
            parent.remove(child)
    b = model.body(body.get("name"))
    numbers = {"mass": b.mass, "pos": b.ipos, "quat": b.iquat, "diaginertia": b.inertia}
    text = {name: " ".join(map(repr, map(float, value))) for name, value in numbers.items()}
    body.insert(0, Element("inertial", text))


def end_m(model: mujoco.MjModel, b: int) -> Array:
    """The point of a body that is furthest from its joint, in the body's frame [m].

    Of sites and of the far sides of geoms, its own and those of what is fixed to it; without any,
    twice as far as the centre of mass.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn, joint = data.xmat[b].reshape(3, 3), model.body_jntadr[b]
    start = data.xanchor[joint] if joint >= 0 else data.xpos[b]
    fixed = model.body_weldid == model.body_weldid[b]
    ends = list(data.site_xpos[fixed[model.site_bodyid]])
    for geom in np.flatnonzero(fixed[model.geom_bodyid]):
        axes, (center, half) = (
            data.geom_xmat[geom].reshape(3, 3),
            model.geom_aabb[geom].reshape(2, 3),
        )
        middle = data.geom_xpos[geom] + axes @ center
        away = middle - start
        reach = np.abs(away @ axes) @ half / max(float(away @ away), 1e-12)
        ends.append(middle + reach * away)
    far = max(ends, key=lambda end: np.linalg.norm(end - start), default=2 * data.xipos[b] - start)
    return turn.T @ (far - data.xpos[b])
