"""A corrected model to take home: the user's own file with the numbers that a diagnosis changed.

The gap before and after is measured in plain MuJoCo with the two files.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from backends.effect import UNITS, Effect, NumberEffect
from backends.mjcf import robot_file
from backends.spec import Spec
from diagnosis.answer import Diagnosis
from diagnosis.logs.log import Log
from diagnosis.motion.columns import COLUMNS, table, with_numbers
from diagnosis.replay.plain import BESIDE, DRIVES, beside, drives, model_text, urdf_text
from diagnosis.verdict.result import NONE, UNKNOWN, Cause, Nominal, distance, in_other_words
from diagnosis.verdict.sentences import size

FILE, URDF, ROBOT = "corrected.xml", "corrected.urdf", "corrected.py"
SPREAD = 3.29
"""A 90 % interval is so many standard deviations wide."""
WRITTEN = {
    "drive.kp_nm_rad": ("kp", "Nm/rad", "N/m"),
    "drive.kd_nms_rad": ("kv", "Nms/rad", "Ns/m"),
    "drive.torque_limit_nm": ("forcerange", "Nm", "N"),
    "drive.rotor_inertia_kgm2": ("armature", "kg m²", "kg"),
    "drive.viscous_nms_rad": ("damping", "Nms/rad", "Ns/m"),
    "drive.coulomb_nm": ("frictionloss", "Nm", "N"),
    "body.mass_kg": ("mass", "kg", "kg"),
    "body.carried": ("gravcomp", "of the link's weight", "of the link's weight"),
    "body.payload": ("the load at the end", "of the link's mass", ""),
    "drive.play_rad": ("range of the play", "rad", "m"),
    "drive.end_stop_rad": ("end stop inside of the range", "rad", "m"),
}
"""Numbers that an MJCF has: their names there, and their units of hinges and slides."""
HELD = WRITTEN | BESIDE | DRIVES
GRAVITY = "spec.gravity_m_s2"


@dataclass(frozen=True, kw_only=True)
class Change:
    """A number of the model that is changed."""

    joint: str
    field: str
    """Its name in the spec."""
    number: str
    """Its name in MJCF."""
    before: float
    after: float
    sd: float
    unit: str
    also: str = ""
    """What it is now, in other words: play from side to side, degrees."""

    @property
    def words(self) -> str:
        """The change in words."""
        also = f"; {self.also}" if self.also else ""
        return (
            f"change {self.number} of {self.joint} from {self.before:.4g} to {self.after:.4g} "
            f"{self.unit} (plus or minus {self.sd:.2g}{also})"
        )


@dataclass(frozen=True, kw_only=True)
class TakeHome:
    """The corrected model."""

    text: str
    urdf: str | None
    """The corrected URDF, where the model is one."""
    robot: str | None
    """A Python file with what an MJCF cannot hold, where there is something."""
    changes: tuple[Change, ...]
    beside: tuple[str, ...]
    """Effects that were named, which an MJCF cannot hold."""
    before_rad: float
    """Root mean square gap of all positions in plain MuJoCo, with the nominal numbers."""
    after_rad: float
    """The same with the corrected file."""
    gravity_m_s2: tuple[float, float, float] | None
    """Gravity in the file, where it is another than the nominal one."""
    world: Spec
    """The corrected world."""

    @property
    def words(self) -> list[str]:
        """The table of changes, and the gaps, by line."""
        gaps = f"{distance(self.before_rad, self.world)} to {distance(self.after_rad, self.world)}"
        gravity = " ".join(f"{g:.4g}" for g in self.gravity_m_s2 or ())
        return [
            *(one.words for one in self.changes),
            *([f"change gravity to {gravity} m/s²"] if gravity else []),
            *(f"not in an MJCF: {text}" for text in self.beside),
            f"in plain MuJoCo with what is written, the gap goes from {gaps}",
        ]

    def plain(self) -> dict:
        """As JSON has it."""
        return {
            "changes": [asdict(one) for one in self.changes],
            "gravity_m_s2": self.gravity_m_s2,
            "not_in_mjcf": list(self.beside),
            "before_rad": self.before_rad,
            "after_rad": self.after_rad,
        }


def take_home(
    log: Log, nominal: Spec, found: Diagnosis, catalogue: Mapping[str, type[Effect]]
) -> TakeHome | None:
    """The corrected model of a user's robot; None where the verdict changes nothing in it."""
    if found.verdict in ((UNKNOWN,), (NONE,)):
        return None
    changes = list[Change]()
    every: tuple[Cause | Nominal, ...] = (*found.magnitudes, *found.nominal)
    for one in every:
        for joint in one.joints if isinstance(one, Cause) else (one.joint,):
            kind = catalogue.get(one.effect)
            if kind is not None and issubclass(kind, NumberEffect) and kind.number in HELD:
                changes.append(_change(nominal, found, joint, kind, one))
    world = with_numbers(nominal, found.corrected, found.gravity_m_s2)
    held = {name for name, kind in catalogue.items() if getattr(kind, "number", "") in HELD}
    held |= {name for name, kind in catalogue.items() if kind.spec_fields() == (GRAVITY,)}
    named = [one for one in found.magnitudes if one.effect not in held]
    others = [f"{one.effect} of {size(one)}" for one in named]
    if not changes and found.gravity_m_s2 is None:
        return None
    text = model_text(log, world, {one.joint for one in changes}, nominal)
    signals, acts = beside(world), drives(world)
    return TakeHome(
        text=text,
        urdf=urdf_text(log, world, {one.joint for one in changes}),
        robot=robot_file(signals, acts) if signals or acts else None,
        changes=tuple(changes),
        beside=tuple(others),
        before_rad=found.engine_gaps_rad[0],
        after_rad=found.engine_gaps_rad[1],
        gravity_m_s2=found.gravity_m_s2,
        world=world,
    )


def _change(
    nominal: Spec, found: Diagnosis, joint: str, kind: type[NumberEffect], one: Cause | Nominal
) -> Change:
    """What is changed for a cause or a refitted number."""
    j = nominal.hand.joint_names.index(joint)
    before = float(table(nominal, True)[j, COLUMNS.index(kind.number)])
    after = found.corrected.get(joint, {}).get(kind.number, before)
    sd = (one.high - one.low) / SPREAD if isinstance(one, Cause) else one.sd
    share = UNITS[one.unit][0] == "share" and (kind.relative or kind.coordinate == "logarithm")
    number, turning, sliding = HELD[kind.number]
    unit = sliding if nominal.hand.driven[j].joint.slides else turning
    return Change(
        joint=joint,
        field=kind.number,
        number=number,
        before=before,
        after=after,
        sd=abs(sd * UNITS[one.unit][1] * (before if share else 1.0)),
        unit=unit,
        also=in_other_words(kind, after, unit),
    )
