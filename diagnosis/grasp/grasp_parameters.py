"""What is wrong with stick and contact, from episodes with the stick in the hand.

Radius and softness show in geometry (`contact_geometry`), friction and mass where the stick is
pulled out (`pull_test`). Where it is not, they show in how the stick moves (`motion_fit`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from backends.catalogue import of_part
from backends.effect import Effect
from backends.spec import Spec
from diagnosis.grasp import pull_test
from diagnosis.grasp.contact_geometry import RADIUS, SOFTNESS, shapes
from diagnosis.grasp.motion_fit import MOTION, YIELDING, motions
from diagnosis.grasp.simulate_grasps import Simulate
from diagnosis.logs.log import Log
from diagnosis.motion.held import Held, held
from diagnosis.verdict.in_hand import Report, missing

NEEDS = "not identifiable from this log; record --protocol grasp with the channel stick"
PULLS = (
    "not identifiable from this log; record --protocol grasp,pull --variants 2 with the channels "
    "stick and pull"
)
NO_MODEL = "not looked for: no test of a grasp here shows it"
WHOLE = 0.95
"""An effect that explains this share of the squared gap by itself leaves nothing to the shapes."""


def identify_grasp_parameters(
    log: Log,
    nominal: Spec,
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate | None,
) -> Report:
    """The effects of stick and contact that a log shows, and why it cannot show others.

    `simulate` puts worlds on the nominal engine; without it nothing is looked for.
    """
    names = of_part(catalogue, "stick", "contact")
    known = (RADIUS, SOFTNESS, *MOTION)
    report = Report(missing=missing([n for k, n in names.items() if k not in known], NO_MODEL))
    names = {number: names[number] for number in known if number in names}
    if not names:
        return report
    if simulate is None:
        return report + Report(missing=missing(names.values(), NEEDS))
    parts = [part for part in held(log, nominal) if part.protocol == "grasp"]
    if not parts:
        still = missing([name for k, name in names.items() if k not in MOTION], NEEDS)
        moving = missing([name for k, name in names.items() if k in MOTION], PULLS)
        return report + Report(missing=(*still, *moving))
    pulls = [part for part in held(log, nominal, ("pull",)) if part.pull_n.any()]
    pulled = pull_test.pull_fit(nominal, pulls, simulate) if pulls else None
    if pulled is not None:
        return report + _pulled_out(nominal, parts, pulls, pulled, catalogue, simulate)
    return report + _moved(nominal, parts, names, catalogue, simulate)


def _moved(
    nominal: Spec,
    parts: Sequence[Held],
    names: Mapping[str, str],
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate,
) -> Report:
    """What grasps without pulls tell; `names` of effects are by the number that they change."""
    moved, yielding = (
        {names[number]: catalogue[names[number]] for number in some if number in names}
        for some in (MOTION, YIELDING)
    )
    alone = motions(nominal, parts, moved | yielding if moved else {}, simulate)
    if any(one.share >= WHOLE for one in alone.causes):
        return alone
    shape = shapes(nominal, parts, catalogue, simulate)
    again = motions(shape.world, parts, moved, simulate) if shape.world != nominal else alone
    return shape.report + again


def _pulled_out(
    nominal: Spec,
    parts: Sequence[Held],
    pulls: Sequence[Held],
    first: pull_test.PullFit,
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate,
) -> Report:
    """Shapes in a world that slips as the stick did; then what pulls tell in a world so shaped.

    Soft contacts yield along the stick as well, and bear as much as they are soft: they look light
    where the stick creeps rather than slips by Newton's law.
    """
    shape = shapes(pull_test.corrected(nominal, first), parts, catalogue, simulate, first.is_firm)
    if shape.soft and not first.is_lawful:
        first = replace(first, mass=0.0)
        shape = shapes(pull_test.corrected(nominal, first), parts, catalogue, simulate)
    again = pull_test.pull_fit(shape.world, pulls, simulate, shape.soft)
    last = again.beside(first) if again else first
    if shape.soft:
        std = float(np.hypot(last.friction_std, pull_test.SOFT_FLOOR))
        left = last.left if last.is_lawful else np.inf
        last = replace(last, left=left, friction_std=std)
    return shape.report + last.report(catalogue)
