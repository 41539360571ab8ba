"""A corrected model to take home: the user's own file with the numbers that a diagnosis changed.

The gap before and after is measured in plain MuJoCo with the two files.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields

from backends.effect import UNITS, Effect, NumberEffect
from backends.mjcf import robot_file
from backends.spec import Loop, Spec
from diagnosis.answer import Diagnosis
from diagnosis.logs.log import Log
from diagnosis.motion.columns import COLUMNS, table, with_numbers
from diagnosis.plain_gap import PlainGap
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
    "drive.weakness": ("what lacks of kp, kv and forcerange", "of each", "of each"),
    "drive.rotor_inertia_kgm2": ("armature", "kg m²", "kg"),
    "drive.viscous_nms_rad": ("damping", "Nms/rad", "Ns/m"),
    "drive.coulomb_nm": ("frictionloss", "Nm", "N"),
    "body.mass_kg": ("mass", "kg", "kg"),
    "body.carried": ("gravcomp", "of the link's weight", "of the link's weight"),
    "body.payload": ("the load", "of the link's mass", "of the link's mass"),
    "drive.play_rad": ("range of the play", "rad", "m"),
    "drive.spring_nm_rad": ("stiffness", "Nm/rad", "N/m"),
    "drive.spring_rest_rad": ("springref", "rad", "m"),
    "drive.zero_rad": ("ref", "rad", "m"),
    "drive.end_stop_rad": ("end stop inside of the range", "rad", "m"),
}
"""Numbers that an MJCF has: their names there, and their units of hinges and slides."""
HELD = WRITTEN | BESIDE | DRIVES
IN_FILES = "open", "soft_friction"
"""Numbers of a loop that a corrected model has."""
HALF = 0.5
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
    more: int
    """So many other numbers move as well, by less than half of their uncertainty."""
    beside: tuple[str, ...]
    """Effects that were named, which an MJCF cannot hold."""
    gap: PlainGap
    """In plain MuJoCo, with the user's file and with the corrected one."""
    less: str
    """Why that gap shrinks less than the verdict says; empty where it does not."""
    gravity_m_s2: tuple[float, float, float] | None
    """Gravity in the file, where it is another than the nominal one."""
    world: Spec
    """The corrected world."""

    @property
    def words(self) -> list[str]:
        """The table of changes, and the gaps, by line."""
        gravity = " ".join(f"{g:.4g}" for g in self.gravity_m_s2 or ())
        return [
            *(one.words for one in self.changes),
            *(
                [f"{self.more} more change by less than half of their uncertainty"]
                if self.more
                else []
            ),
            *([f"change gravity to {gravity} m/s²"] if gravity else []),
            *self._step_words(),
            *(f"not in an MJCF: {text}" for text in self.beside),
            self._gap_words(),
        ]

    def _step_words(self) -> Iterator[str]:
        """The time step that it needs, where that is another."""
        gap = self.gap
        if gap.step_s < gap.file_step_s:
            before, after = (f"{1e3 * step_s:.4g}" for step_s in (gap.file_step_s, gap.step_s))
            left = distance(gap.by_step_rad, self.world)
            yield (
                f"change the timestep from {before} to {after} ms, which these numbers need; that "
                f"alone takes the gap to {left}"
            )

    def _gap_words(self) -> str:
        """The gap before and after, and why it is not less."""
        before, after = (distance(x, self.world) for x in (self.gap.before_rad, self.gap.after_rad))
        where = " where pushed joints rest" if self.gap.at_rest else ""
        text = f"in plain MuJoCo with what is written, the gap{where} goes from {before} to {after}"
        return f"{text}; it shrinks less than the verdict says: {self.less}" if self.less else text

    def plain(self) -> dict:
        """As JSON has it."""
        return {
            "changes": [asdict(one) for one in self.changes],
            "more": self.more,
            "gravity_m_s2": self.gravity_m_s2,
            "not_in_mjcf": list(self.beside),
            "before_rad": self.gap.before_rad,
            "after_rad": self.gap.after_rad,
            "timestep_s": self.gap.step_s,
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
            kind, corrected = catalogue.get(one.effect), found.corrected.get(joint, {})
            if kind is None or not issubclass(kind, NumberEffect):
                continue
            if kind.number in corrected.keys() & HELD.keys():
                changes.append(_change(nominal, corrected, joint, kind, one))
    world = with_numbers(nominal, found.corrected, found.gravity_m_s2)
    held = {name for name, kind in catalogue.items() if getattr(kind, "number", "") in HELD}
    held |= {name for name, kind in catalogue.items() if kind.spec_fields() == (GRAVITY,)}
    named = [one for one in found.magnitudes if one.effect not in held]
    others = [f"{one.effect} of {size(one)}" for one in named]
    others += [limb.law for limb in found.limbs if limb.law]
    others += _loops(nominal)
    if found.in_mujoco is None or not (changes or found.gravity_m_s2):
        return None
    said = {(one.joint, one.field) for one in changes}
    moved = {(j, field) for j, row in found.corrected.items() for field in row.keys() & HELD.keys()}
    signals, acts = beside(world), drives(world)
    return TakeHome(
        text=model_text(log, world, nominal, _other_step(found.in_mujoco)),
        urdf=urdf_text(log, world, nominal),
        robot=robot_file(signals, acts) if signals or acts else None,
        changes=tuple(changes),
        more=len(moved - said),
        beside=tuple(others),
        gap=found.in_mujoco,
        less=_less(found, found.in_mujoco, others),
        gravity_m_s2=found.gravity_m_s2,
        world=world,
    )


def _other_step(gap: PlainGap) -> float | None:
    """The time step that is written; None: that of the file stays."""
    return gap.step_s if gap.step_s < gap.file_step_s else None


def _loops(world: Spec) -> list[str]:
    """What the drives of a world do beside a PD law that neither file has, in words."""
    driven = [body.joint for body in world.hand.driven]
    every = [field.name for field in fields(Loop) if field.name not in IN_FILES]
    return [
        f"{name} of {', '.join(own)}"
        for name in every
        if (own := [joint.name for joint in driven if getattr(joint.loop, name)])
    ]


def _less(found: Diagnosis, gap: PlainGap, beside: Sequence[str]) -> str:
    """Why the gap in plain MuJoCo shrinks by less than half of what the verdict says; or empty."""
    gone = 1.0 - (gap.after_rad / max(gap.before_rad, 1e-12)) ** 2
    if gone >= found.shrinkage.interval[0] / 2.0 and gap.after_rad <= gap.before_rad:
        return ""
    torque = sum(place.share for place in found.where if place.channel == "torque")
    worst = max(gap.by_joint, key=lambda joint: gap.by_joint[joint][1])
    if beside:
        return f"{', '.join(beside)} is in none of the files"
    if torque > HALF:
        return f"{100 * torque:.0f} % of its gap are torques, and these are positions"
    if worst not in found.joints:
        return f"most of it is of {worst}, where nothing is named"
    return (
        f"most of it is of {worst}; the fit goes along the motion that was measured, and a "
        "simulation along its own"
    )


def _change(
    nominal: Spec,
    corrected: Mapping[str, float],
    joint: str,
    kind: type[NumberEffect],
    one: Cause | Nominal,
) -> Change:
    """What is changed for a cause or a refitted number, of a joint's corrected numbers."""
    j = nominal.hand.joint_names.index(joint)
    before = float(table(nominal, True)[j, COLUMNS.index(kind.number)])
    after = corrected[kind.number]
    sd = (one.high - one.low) / SPREAD if isinstance(one, Cause) else one.sd
    if isinstance(one, Cause) and one.joint is None and kind.unsaid and one.value:
        sd *= (after - before) / one.sizes[0]  # each joint has its own size
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
        also=one.also
        if isinstance(one, Cause) and kind.spot
        else in_other_words(kind, after, unit),
    )
