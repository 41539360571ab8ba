"""One moment of any engine's run, drawn off-screen by MuJoCo's renderer.

OpenGL's platform is chosen once per process, so the drawing runs in a child process, first with
EGL, then with OSMesa. The model is the one that MuJoCo simulates, with links and lights added for
the eye; it is posed, never stepped.
"""

import os
import pickle
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from backends.spec import Body, Fingertip, Hand, Spec
from backends.state import Array, State
from backends.touch import Skin, taxel_grid
from benchmark.errors import CommandError

if TYPE_CHECKING:
    import mujoco

WIDTH, HEIGHT = 1280, 960
OVERSAMPLING = 2
"""Pixels drawn per pixel kept, along each side."""
LIMIT_S = 300
"""A child that draws longer than this hangs [s]."""
_LOOK_AT_M, _DISTANCE_M, _AZIMUTH_DEG, _ELEVATION_DEG = (0.03, 0.0, -0.032), 0.33, 144, -34
"""The camera: palm, three fingers and the whole stick in view, nothing in front of the grip."""
_PLATFORMS = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
"""OpenGL's platforms by MuJoCo's names, and Debian's packages of each."""
LINK_M, KNUCKLE_M, TAXEL_M, BALL_M, PATH_M = 0.0075, 0.0105, 0.0005, 0.004, 0.0006
"""Drawn radii [m]; the spec has none, for links touch nothing."""
_DARK, _METAL, _PALM = (0.20, 0.21, 0.23, 1), (0.48, 0.50, 0.53, 1), (0.30, 0.31, 0.34, 1)
_PAD, _WOOD = (0.36, 0.55, 0.78, 1), (0.78, 0.60, 0.34, 1)
_RED, _IDLE = (0.90, 0.12, 0.10, 1), (0.22, 0.37, 0.58, 1)


@dataclass(frozen=True, kw_only=True)
class Moment:
    """What is drawn."""

    spec: Spec
    state: State
    """Arrays of one world."""
    reference_m: Array
    """Drawn point now [m], world frame, shape (3,)."""
    path_m: Array
    """Drawn point during the episode [m], world frame, shape (T, 3)."""


def render(moment: Moment, path: Path) -> None:
    """Write a PNG; raises CommandError that names the packages where no OpenGL works."""
    reasons = []
    for platform in _PLATFORMS:
        try:
            return _render_in_child(moment, path, platform)
        except subprocess.TimeoutExpired:
            reasons.append(f"{platform}: no picture within {LIMIT_S} s")
        except subprocess.CalledProcessError as error:
            lines = error.stderr.decode(errors="replace").strip().splitlines()
            reasons.append(f"{platform}: {lines[-1] if lines else f'exit {error.returncode}'}")
    packages = " or ".join(f"apt-get install {name}" for name in _PLATFORMS.values())
    raise CommandError(f"cannot draw off-screen ({'; '.join(reasons)}); on Debian: {packages}")


def _render_in_child(moment: Moment, path: Path, platform: str) -> None:
    subprocess.run(
        [sys.executable, "-m", __name__, str(path)],
        input=pickle.dumps(moment),
        env={**os.environ, "MUJOCO_GL": platform, "PYOPENGL_PLATFORM": platform},
        capture_output=True,
        check=True,
        timeout=LIMIT_S,
    )


def _draw(moment: Moment) -> Array:
    """Pixels, shape (HEIGHT, WIDTH, 3), uint8."""
    import mujoco

    model = _scene(moment).compile()
    data = mujoco.MjData(model)
    _pose(model, data, moment)
    camera = mujoco.MjvCamera()
    camera.lookat = _LOOK_AT_M
    camera.distance = _DISTANCE_M
    camera.azimuth, camera.elevation = _AZIMUTH_DEG, _ELEVATION_DEG
    with mujoco.Renderer(model, OVERSAMPLING * HEIGHT, OVERSAMPLING * WIDTH) as renderer:
        renderer.update_scene(data, camera)
        fine = renderer.render()
    blocks = fine.reshape(HEIGHT, OVERSAMPLING, WIDTH, OVERSAMPLING, 3)
    return blocks.mean(axis=(1, 3)).round().astype(np.uint8)


def _pose(model: "mujoco.MjModel", data: "mujoco.MjData", moment: Moment) -> None:
    import mujoco

    state = moment.state
    for name, angle in zip(moment.spec.hand.joint_names, state.joint_rad[0], strict=True):
        data.joint(name).qpos[0] = angle
    data.joint("stick").qpos[:] = [*state.stick_pos_m[0], *state.stick_quat_wxyz[0]]
    mujoco.mj_forward(model, data)


def _scene(moment: Moment) -> "mujoco.MjSpec":
    """The simulated model with colours, lights and parts that only the eye sees."""
    from backends.mujoco import build

    model, hand = build(moment.spec), moment.spec.hand
    _light(model)
    model.geom("palm").rgba = _PALM
    model.geom("stick").rgba = _WOOD
    active = Skin([moment.spec]).feel(moment.state).active[0]
    for tip, felt in zip(hand.fingertips, active, strict=True):
        model.geom(tip.finger).rgba = _PAD
        _add_taxels(model.body(tip.body), tip, hand, felt)
    for body in hand.bodies:
        _add_link(model, hand, body)
    ball, path = moment.reference_m, moment.path_m
    _add(model.worldbody, "SPHERE", _RED, BALL_M, pos=ball)
    for start, end in zip(path[:-1], path[1:], strict=True):
        _add(model.worldbody, "CAPSULE", _RED, PATH_M, fromto=[*start, *end])
    return model


def _light(model: "mujoco.MjSpec") -> None:
    import mujoco

    view = model.visual
    view.global_.offwidth, view.global_.offheight = OVERSAMPLING * WIDTH, OVERSAMPLING * HEIGHT
    view.quality.shadowsize = 4096
    view.headlight.ambient, view.headlight.diffuse = (0.32, 0.32, 0.34), (0.28, 0.28, 0.28)
    view.headlight.specular = (0.1, 0.1, 0.1)
    model.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=(0.97, 0.98, 1.0),
        rgb2=(0.78, 0.82, 0.87),
        width=512,
        height=3072,
    )
    for pos, strength, shadow in (((0.5, -0.5, 0.8), 0.55, True), ((0.5, 0.6, 0.3), 0.25, False)):
        light = model.worldbody.add_light(pos=pos, dir=-np.array(pos), castshadow=shadow)
        light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        light.diffuse, light.specular = (strength,) * 3, (0.2,) * 3


def _add(node: "mujoco.MjsBody", shape: str, rgba: tuple, radius_m: float, **where: object) -> None:
    """A site: seen, but neither heavy nor touched."""
    import mujoco

    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{shape}")
    node.add_site(type=kind, rgba=rgba, size=[radius_m, 0, 0], **where)


def _add_link(model: "mujoco.MjSpec", hand: Hand, body: Body) -> None:
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


def _add_taxels(node: "mujoco.MjsBody", tip: Fingertip, hand: Hand, active: Array) -> None:
    frame = np.array([tip.forward, tip.inward, np.cross(tip.forward, tip.inward)]).T
    positions, _ = taxel_grid(tip, hand.taxels)
    for position, on in zip(np.array(tip.center_m) + positions @ frame.T, active, strict=True):
        radius = 2 * TAXEL_M if on else TAXEL_M
        _add(node, "SPHERE", _RED if on else _IDLE, radius, pos=position)


def main() -> None:
    """Draw the moment on standard input to the file named by the first argument."""
    from matplotlib.image import imsave

    moment: Moment = pickle.load(sys.stdin.buffer)
    imsave(sys.argv[1], _draw(moment), format="png")


if __name__ == "__main__":
    main()
