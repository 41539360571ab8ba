"""The parts of a mechanism that are judged each by itself."""

import dataclasses

from backends.spec import Spec


def limbs(spec: Spec) -> tuple[Spec, ...]:
    """The parts of a mechanism that move independently of each other in free air: its fingers.

    What follows a joint belongs to its part.
    """
    root: dict[str, str] = {}
    for body in spec.hand.bodies:
        root[body.name] = body.name if body.parent is None else root[body.parent]
    carrier = {body.joint.name: body.name for body in spec.hand.bodies}
    for body in spec.hand.bodies:
        if body.joint.follows is not None:
            one, other = root[body.name], root[carrier[body.joint.follows]]
            root = {name: other if at == one else at for name, at in root.items()}
    groups: dict[str, list] = {}
    for body in spec.hand.bodies:
        groups.setdefault(root[body.name], []).append(body)
    moving = [g for g in groups.values() if any(b.joint.drive is not None for b in g)]
    found = []
    for bodies in moving:
        names = {body.name for body in bodies}
        tips = tuple(tip for tip in spec.hand.fingertips if tip.body in names)
        hand = dataclasses.replace(spec.hand, bodies=tuple(bodies), fingertips=tips)
        found.append(dataclasses.replace(spec, hand=hand))
    return tuple(found)
