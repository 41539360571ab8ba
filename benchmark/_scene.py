"""What a frame shows: MuJoCo's renderer on one step of any engine's run.

The model is the one that MuJoCo simulates, with links and lights added for the eye; it is posed,
never stepped. Runs as a program of its own, see `_render`.
"""

import os
import pickle
import sys
from typing import IO

import mujoco
import numpy as np
from PIL import Image

from backends.mujoco import build
from backends.spec import Body, Fingertip, Hand
from backends.state import Array, quat_from_z_axis
from backends.touch import taxel_grid
from benchmark._render import Scene

OVERSAMPLING = 2
"""Pixels drawn per pixel kept, along each side."""
_LOOK_AT_M, _DISTANCE_M, _AZIMUTH_DEG, _ELEVATION_DEG = (0.035, 0.002, -0.052), 0.288, 162, -38
"""The camera: palm, three fingers, the whole stick and the sheet that it draws on."""
LINK_M, KNUCKLE_M, TAXEL_M, BALL_M, PATH_M = 0.0075, 0.0105, 0.0006, 0.003, 0.0006
"""Drawn radii [m]; the spec has none, for links touch nothing."""
SHEET_M, SHEET_BELOW_M = 0.045, 0.014
"""Half a side of the sheet, and how far it lies below the reference [m]: sticks slip a little."""
EVERY = 2
"""Steps from one corner of the reference's line to the next."""
TRAIL = 90
"""Steps for which the stick's lower end leaves a trail, which fades."""
_DARK, _METAL, _PALM = (0.20, 0.21, 0.23, 1), (0.48, 0.50, 0.53, 1), (0.30, 0.31, 0.34, 1)
_WOOD, _SHEET, _SKY = (0.80, 0.62, 0.36, 1), (0.97, 0.97, 0.96, 1), (0.86, 0.89, 0.93)
_PAD = (0.50, 0.70, 0.95, 0.5)
"""Fingertips let the taxels shine through, which face the stick and not the camera."""
_RED, _BLUE, _IDLE = (0.90, 0.12, 0.10, 1), (0.10, 0.30, 0.85), (0.22, 0.37, 0.58, 1)


def _draw(scene: Scene, out: IO[bytes]) -> None:
    """Write every frame's pixels."""
    width, height = scene.size
    model = _model(scene).compile()
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat = _LOOK_AT_M
    camera.distance = _DISTANCE_M
    camera.azimuth, camera.elevation = _AZIMUTH_DEG, _ELEVATION_DEG
    with mujoco.Renderer(model, OVERSAMPLING * height, OVERSAMPLING * width) as renderer:
        for step in scene.frames:
            _pose(model, data, scene, step)
            renderer.update_scene(data, camera)
            out.write(Image.fromarray(renderer.render()).reduce(OVERSAMPLING).tobytes())
            out.flush()


def _pose(model: mujoco.MjModel, data: mujoco.MjData, scene: Scene, step: int) -> None:
    state, hand = scene.states, scene.spec.hand
    for name, angle in zip(hand.joint_names, state.joint_rad[step], strict=True):
        data.joint(name).qpos[0] = angle
    data.joint("stick").qpos[:] = [*state.stick_pos_m[step], *state.stick_quat_wxyz[step]]
    for tip, felt in zip(hand.fingertips, scene.active[step], strict=True):
        for number, on in enumerate(felt):
            taxel = model.site(f"{tip.finger}/{number}")
            taxel.rgba = _RED if on else _IDLE
            taxel.size[:] = 2.2 * TAXEL_M if on else TAXEL_M
    model.site("reference").pos = scene.reference_m[step]
    for end in range(1, len(scene.lower_m)):
        fresh = 1 - (step - end) / TRAIL if end <= step else 0.0
        model.site(f"trail/{end}").rgba = (*_BLUE, np.clip(fresh, 0, 1))
    mujoco.mj_forward(model, data)


def _model(scene: Scene) -> mujoco.MjSpec:
    """The simulated model with colours, lights and parts that only the eye sees."""
    model, hand = build(scene.spec), scene.spec.hand
    _light(model, scene.size)
    model.geom("palm").rgba = _PALM
    model.geom("stick").rgba = _WOOD
    for tip in hand.fingertips:
        model.geom(tip.finger).rgba = _PAD
        _add_taxels(model.body(tip.body), tip, hand)
    for body in hand.bodies:
        _add_link(model, hand, body)
    world = model.worldbody
    at_m = scene.reference_m[scene.first :].mean(axis=0) - (0, 0, SHEET_BELOW_M)
    world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=(SHEET_M, SHEET_M, 5e-4), pos=at_m, rgba=_SHEET
    )
    # away from the origin: the compiler lets a site there ride on its body, wherever it is moved
    _add(world, "SPHERE", _RED, BALL_M, name="reference", pos=scene.reference_m[0])
    for ends in _segments(scene.reference_m[scene.first :: EVERY]):
        _add(world, "BOX", _RED, PATH_M, fromto=ends)
    for number, ends in enumerate(_segments(scene.lower_m), start=1):
        where = {"name": f"trail/{number}", "fromto": ends}
        _add(world, "BOX", (*_BLUE, 1), 1.3 * PATH_M, **where)
    return model


def _segments(path_m: Array) -> list[list[float]]:
    """Both ends of each piece of a path [m]; a piece of no length gets a micrometre."""
    apart = np.where(np.diff(path_m, axis=0).any(axis=1), 0.0, 1e-6)
    pairs = zip(path_m[:-1], path_m[1:], apart, strict=True)
    return [[*start, *end[:2], end[2] + gap] for start, end, gap in pairs]


def _light(model: mujoco.MjSpec, size: tuple[int, int]) -> None:
    model.stat.extent = (
        _DISTANCE_M  # else a stick that falls far moves the near plane past the hand
    )
    view = model.visual
    view.global_.offwidth, view.global_.offheight = (OVERSAMPLING * side for side in size)
    view.quality.offsamples = 0
    view.headlight.ambient, view.headlight.diffuse = (0.32, 0.32, 0.34), (0.28, 0.28, 0.28)
    view.headlight.specular = (0.1, 0.1, 0.1)
    model.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=_SKY,
        rgb2=_SKY,
        width=8,
        height=48,
    )
    for pos, strength in (((0.5, -0.5, 0.8), 0.55), ((0.5, 0.6, 0.3), 0.25)):
        light = model.worldbody.add_light(pos=pos, dir=-np.array(pos), castshadow=False)
        light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        light.diffuse, light.specular = (strength,) * 3, (0.2,) * 3


def _add(node: mujoco.MjsBody, shape: str, rgba: tuple, radius_m: float, **where: object) -> None:
    """A site: seen, but neither heavy nor touched; of a box, half the side is the radius."""
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{shape}")
    node.add_site(type=kind, rgba=rgba, size=[radius_m] * 3, **where)


def _add_link(model: mujoco.MjSpec, hand: Hand, body: Body) -> None:
    """A knuckle on the hinge and a rod to whatever the body carries; a strut from the palm."""
    node = model.body(body.name)
    ends = [b.origin_m for b in hand.bodies if b.parent == body.name]
    ends += [tip.center_m for tip in hand.fingertips if tip.body == body.name]
    for end in ends:
        if np.linalg.norm(end) > LINK_M:
            _add(node, "CAPSULE", _DARK, LINK_M, fromto=[0, 0, 0, *end])
    if body.joint.drive is not None:
        along = 1.1 * KNUCKLE_M * np.array(body.joint.axis)
        _add(node, "CYLINDER", _METAL, KNUCKLE_M, fromto=[*-along, *along])
    if body.parent is None:
        foot = (hand.palm_center_m[0], *body.origin_m[1:])
        _add(model.worldbody, "CAPSULE", _DARK, LINK_M, fromto=[*foot, *body.origin_m])


def _add_taxels(node: mujoco.MjsBody, tip: Fingertip, hand: Hand) -> None:
    frame = np.array([tip.forward, tip.inward, np.cross(tip.forward, tip.inward)]).T
    positions, normals = taxel_grid(tip, hand.taxels)
    upright = quat_from_z_axis(normals @ frame.T)
    for number, position in enumerate(np.array(tip.center_m) + positions @ frame.T):
        where = {"name": f"{tip.finger}/{number}", "pos": position, "quat": upright[number]}
        _add(node, "BOX", _IDLE, TAXEL_M, **where)


def main() -> None:
    """Draw the scene on standard input to standard output, and nothing else there."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    scene: Scene = pickle.load(sys.stdin.buffer)
    _draw(scene, out)


if __name__ == "__main__":
    main()
