"""What a frame shows: MuJoCo's renderer on one step of any engine's run.

The model is the one that MuJoCo simulates, with links and lights added for the eye; it is posed,
never stepped. Runs as a program of its own, see `_render`: a stage, then moments, on standard
input; a picture of each on standard output.
"""

import os
import pickle
import sys
from collections.abc import Iterator
from typing import IO

import mujoco
import numpy as np
from PIL import Image

from backends.mujoco import build
from backends.spec import Body, Fingertip, Hand
from backends.state import Array, quat_from_z_axis, quat_to_matrix
from backends.touch import taxel_grid
from benchmark.pictures._render import Moment, Stage

OVERSAMPLING = 2
"""Pixels drawn per pixel kept, along each side."""
SLICES = 16
"""Sides of what is drawn round: without a graphics card, corners cost as much as pixels."""
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


def _draw(stage: Stage, moments: Iterator[Moment], out: IO[bytes]) -> None:
    """Write the pixels of every moment."""
    width, height = stage.size
    model = _model(stage).compile()
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat = _LOOK_AT_M
    camera.distance = _DISTANCE_M
    camera.azimuth, camera.elevation = _AZIMUTH_DEG, _ELEVATION_DEG
    with mujoco.Renderer(model, OVERSAMPLING * height, OVERSAMPLING * width) as renderer:
        for moment in moments:
            _pose(model, data, stage, moment)
            renderer.update_scene(data, camera)
            _add_paths(renderer.scene, moment)
            out.write(Image.fromarray(renderer.render()).reduce(OVERSAMPLING).tobytes())
            out.flush()


def _pose(model: mujoco.MjModel, data: mujoco.MjData, stage: Stage, moment: Moment) -> None:
    hand = stage.spec.hand
    for name, angle in zip(hand.joint_names, moment.joint_rad, strict=True):
        data.joint(name).qpos[0] = angle
    data.joint("stick").qpos[:] = [*moment.stick_pos_m, *moment.stick_quat_wxyz]
    for tip, felt in zip(hand.fingertips, moment.active, strict=True):
        for number, on in enumerate(felt):
            taxel = model.site(f"{tip.finger}/{number}")
            taxel.rgba = _RED if on else _IDLE
            taxel.size[:] = 2.2 * TAXEL_M if on else TAXEL_M
    model.geom("sheet").pos = moment.line_m.mean(axis=0) - (0, 0, SHEET_BELOW_M)
    mujoco.mj_forward(model, data)


def _add_paths(scene: mujoco.MjvScene, moment: Moment) -> None:
    """The figure, the drawn point on it, and the trail, which fades."""
    line, trail = moment.line_m[::EVERY], moment.trail_m[: -TRAIL - 1 : -1]
    _add_path(scene, line, PATH_M, [_RED] * len(line))
    fading = [(*_BLUE, 1 - age / TRAIL) for age in range(len(trail))]
    _add_path(scene, trail, 1.3 * PATH_M, fading)
    _add_shape(scene, "SPHERE", [BALL_M] * 3, moment.reference_m, np.eye(3), _RED)


def _add_path(scene: mujoco.MjvScene, path_m: Array, radius_m: float, rgba: list[tuple]) -> None:
    """A rod from each point to the next that is another."""
    along = np.diff(path_m, axis=0)
    length = np.linalg.norm(along, axis=1)
    moves = np.flatnonzero(length > 0)
    frames = quat_to_matrix(quat_from_z_axis(along[moves] / length[moves, None]))
    for i, frame in zip(moves, frames, strict=True):
        size, middle = [radius_m, radius_m, length[i] / 2], path_m[i] + along[i] / 2
        _add_shape(scene, "BOX", size, middle, frame, rgba[i])


def _add_shape(
    scene: mujoco.MjvScene, shape: str, size: list, pos_m: Array, frame: Array, rgba: tuple
) -> None:
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{shape}")
    geom = scene.geoms[scene.ngeom]
    scene.ngeom += 1
    mujoco.mjv_initGeom(
        geom, kind, np.array(size), pos_m, frame.ravel(), np.array(rgba, np.float32)
    )


def _model(stage: Stage) -> mujoco.MjSpec:
    """The simulated model with colours, lights and parts that only the eye sees."""
    model, hand = build(stage.spec), stage.spec.hand
    _light(model, stage.size)
    model.geom("palm").rgba = _PALM
    model.geom("stick").rgba = _WOOD
    for tip in hand.fingertips:
        model.geom(tip.finger).rgba = _PAD
        _add_taxels(model.body(tip.body), tip, hand)
    for body in hand.bodies:
        _add_link(model, hand, body)
    sheet = {"size": (SHEET_M, SHEET_M, 5e-4), "pos": (0, 0, -1), "rgba": _SHEET}
    model.worldbody.add_geom(name="sheet", type=mujoco.mjtGeom.mjGEOM_BOX, **sheet)
    return model


def _light(model: mujoco.MjSpec, size: tuple[int, int]) -> None:
    model.stat.extent = (
        _DISTANCE_M  # else a stick that falls far moves the near plane past the hand
    )
    view = model.visual
    view.global_.offwidth, view.global_.offheight = (OVERSAMPLING * side for side in size)
    view.quality.offsamples, view.quality.numquads = 0, 1
    view.quality.numslices, view.quality.numstacks = SLICES, SLICES // 2
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
    """Draw what comes on standard input to standard output, and nothing else there."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    stage: Stage = pickle.load(sys.stdin.buffer)
    _draw(stage, _moments(sys.stdin.buffer), out)


def _moments(given: IO[bytes]) -> Iterator[Moment]:
    """Moments until there are no more."""
    while True:
        try:
            yield pickle.load(given)
        except EOFError:
            return


if __name__ == "__main__":
    main()
