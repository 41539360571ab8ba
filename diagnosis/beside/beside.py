"""What stands beside the replayed verdicts: random effects, touch, stick and contact in one report.

A diagnosis calls `widened_by_steps` before it judges limbs and `beside` afterwards.
"""

from collections.abc import Mapping, Sequence

from backends.effect import UNITS, Effect
from backends.spec import Spec
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.magnitudes import Magnitude
from diagnosis.attribution.verdict import UNKNOWN, LimbVerdict
from diagnosis.beside._regrasp import Simulate
from diagnosis.beside.feel import feel
from diagnosis.beside.finding import Finding, Report
from diagnosis.beside.fingerprints import sensors, widened
from diagnosis.beside.grip import NEEDS, grip
from diagnosis.beside.losses import dropouts
from diagnosis.logs.log import Log

LOST = "command-dropout"


def widened_by_steps(
    parts: Sequence[Evidence], catalogue: Mapping[str, type[Effect]]
) -> tuple[Evidence, ...]:
    """Evidence that allows for the steps of the encoders that it shows."""
    found = sensors(parts, catalogue)
    return tuple(widened(part, found) for part in parts)


def beside(
    log: Log,
    nominal: Spec,
    parts: Sequence[Evidence],
    limbs: Sequence[LimbVerdict],
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate | None = None,
) -> Report:
    """All that the log says of random effects, touch, stick and contact.

    `nominal` is best the world with the effects that replays found, `limbs` are the verdicts on
    `parts`, one each. Without `simulate`, which puts worlds on the nominal engine, stick and
    contact are left out.
    """
    random = sensors(parts, catalogue)
    if LOST in catalogue:
        random += dropouts(parts, limbs)
    touch = feel(log, nominal, catalogue)
    held = grip(log, nominal, catalogue, simulate) if simulate else Report(missing=(NEEDS,))
    return Report(
        findings=(*random, *touch.findings, *held.findings),
        missing=(*touch.missing, *held.missing),
    )


def outdone(limb: LimbVerdict, found: Sequence[Finding]) -> bool:
    """Whether a finding takes the place of a limb's verdict."""
    joints = limb.attribution.fitter.evidence.joints
    return any(one.instead and set(joints) & set(one.joints) for one in found)


def magnitude(one: Finding, catalogue: Mapping[str, type[Effect]]) -> Magnitude | None:
    """A finding as the diagnosis lists it, in the unit of its effect; None of an unknown."""
    if one.effect == UNKNOWN:
        return None
    unit = catalogue[one.effect].unit
    size = UNITS[unit][1]
    return Magnitude(
        effect=one.effect,
        joint=one.joint,
        value=one.value / size,
        unit=unit,
        interval=(one.interval[0] / size, one.interval[1] / size),
        joints=one.joints,
    )
