"""All that a log with the stick in the hand tells of touch, stick and contact."""

from collections.abc import Mapping

from backends.effect import Effect
from backends.spec import Spec
from diagnosis.grasp.grasp_parameters import identify_grasp_parameters
from diagnosis.grasp.simulate_grasps import Simulate
from diagnosis.logs.log import Log
from diagnosis.skin.skin_faults import identify_skin_faults
from diagnosis.verdict.in_hand import Report


def in_hand(
    log: Log, world: Spec, catalogue: Mapping[str, type[Effect]], simulate: Simulate | None = None
) -> Report:
    """What the log tells of touch, stick and contact; nothing of a mechanism without fingertips.

    `world`: the nominal world, best with what was found on its joints. Without `simulate`, which
    puts worlds on the nominal engine, stick and contact are left out.
    """
    if not world.hand.fingertips:
        return Report()
    stick = identify_grasp_parameters(log, world, catalogue, simulate)
    seen = stick.world or world
    shape, known = ((w.stick.radius_m, w.contact.compliance_m_n) for w in (seen, world))
    touch = identify_skin_faults(log, seen, catalogue, mended=shape != known)
    return touch + stick
