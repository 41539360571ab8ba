"""What is wrong with touch, stick and contact, from episodes with the stick in the hand.

Radius and softness show in how near tips and stick are (`shape`), friction and mass where the stick
is pulled out (`pull_test`). Faults of the skin show on the stick that is there.
"""

from collections.abc import Sequence
from dataclasses import replace

from backends.catalogue import Catalogue, of_part
from backends.spec import Spec
from diagnosis.grasp import pull_test
from diagnosis.grasp.forward_model import FRICTION, MASS, RADIUS, SOFTNESS
from diagnosis.grasp.shape import Shape, shape
from diagnosis.logs.log import Log
from diagnosis.motion.batch import Simulate
from diagnosis.motion.held import Held, held
from diagnosis.skin.skin_faults import identify_skin_faults
from diagnosis.verdict.result import Report, missing

NEEDS = "not identifiable from this log; record --protocol grasp with the channel stick"
PULLS = (
    "not identifiable from this log; record --protocol grasp,pull --variants 2 with the channels "
    "stick and pull"
)
NO_MODEL = "not looked for: no test of a grasp here shows it"


def in_hand(
    log: Log, world: Spec, catalogue: Catalogue, simulate: Simulate | None = None
) -> Report:
    """What the log tells of touch, stick and contact.

    `world`: the nominal world, best with what was found on its joints. Without `simulate`, which
    puts worlds on the nominal engine, stick and contact are left out.
    """
    stick = stick_report(log, world, catalogue, simulate)
    seen = stick.world or world
    known, found = ((w.stick.radius_m, w.contact.compliance_m_n) for w in (world, seen))
    return identify_skin_faults(log, seen, catalogue, mended=known != found) + stick


def stick_report(
    log: Log, nominal: Spec, catalogue: Catalogue, simulate: Simulate | None
) -> Report:
    """The effects of stick and contact that a log shows, and why it cannot show others."""
    every = of_part(catalogue, "stick", "contact")
    names = {n: every[n] for n in (RADIUS, SOFTNESS, FRICTION, MASS) if n in every}
    report = missing([n for k, n in every.items() if k not in names], NO_MODEL)
    if not names or simulate is None:
        return report + missing(names.values(), NEEDS)
    slips = missing([names[k] for k in (FRICTION, MASS) if k in names], PULLS)
    parts = held(log, nominal, ("grasp",))
    if not parts:
        return report + missing([names[k] for k in (RADIUS, SOFTNESS) if k in names], NEEDS) + slips
    pulls = [part for part in held(log, nominal, ("pull",)) if part.pull_n.any()]
    found, pulled = _pulled_out(nominal, parts, pulls, simulate)
    slipped = pulled.report(catalogue) if pulled else slips
    return report + found.report(nominal, catalogue) + slipped


def _pulled_out(
    nominal: Spec, parts: Sequence[Held], pulls: Sequence[Held], simulate: Simulate
) -> tuple[Shape, pull_test.PullFit | None]:
    """The shape, and what pulls tell of a stick of that shape; None where no stick slips.

    Once more where friction or mass is another, for then the stick is squeezed otherwise.
    """
    found, pulled = _of_world(nominal, parts, pulls, simulate)
    if pulled and pulled.sure.any():
        world = pull_test.changed(nominal, *pulled.surely)
        found, again = _of_world(world, parts, pulls, simulate)
        pulled = replace(again, logs=again.logs + pulled.surely) if again else pulled
    return found, pulled


def _of_world(
    world: Spec, parts: Sequence[Held], pulls: Sequence[Held], simulate: Simulate
) -> tuple[Shape, pull_test.PullFit | None]:
    """The same about one world; pulls about the mass that its gaps ask for."""
    found = shape(world, parts, simulate)
    rigid, soft, mass = found.chosen.rigid, found.chosen.is_soft, float(found.chosen.sizes[2])
    heavy = pull_test.changed(found.on(world), mass=mass)
    pulled = pull_test.pull_fit(heavy, pulls, simulate, rigid=rigid, soft=soft)
    return found, replace(pulled, logs=pulled.logs + [0.0, mass]) if pulled else None
