"""The parts of a mechanism that are judged each by itself."""

import dataclasses

from backends.spec import Hand, Spec


def limbs(spec: Spec) -> tuple[Spec, ...]:
    """The parts of a mechanism that move independently of each other in free air: its fingers."""
    groups: dict[str, list] = {}
    root: dict[str, str] = {}
    for body in spec.hand.bodies:
        root[body.name] = body.name if body.parent is None else root[body.parent]
        groups.setdefault(root[body.name], []).append(body)
    moving = [g for g in groups.values() if any(b.joint.drive is not None for b in g)]
    return tuple(dataclasses.replace(spec, hand=_part(spec.hand, tuple(g))) for g in moving)


def _part(hand: Hand, bodies: tuple) -> Hand:
    names = {body.name for body in bodies}
    tips = tuple(tip for tip in hand.fingertips if tip.body in names)
    return dataclasses.replace(hand, bodies=bodies, fingertips=tips)
