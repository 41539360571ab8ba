"""Effects: what reality adds to the ideal hand.

Each effect has a magnitude with a unit, and it may name a joint.
"""

import dataclasses
import inspect
import re
from abc import ABC
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, final

from backends.spec import Body, Drive, Spec

UNITS: dict[str, tuple[str, float]] = {
    "mrad": ("angle", 1e-3),
    "deg": ("angle", 0.017453292519943295),
    "rad": ("angle", 1.0),
    "mNm": ("torque", 1e-3),
    "Nm": ("torque", 1.0),
    "mNms": ("damping", 1e-3),
    "Nms": ("damping", 1.0),
    "%": ("share", 0.01),
    "times": ("share", 1.0),
    "gcm2": ("inertia", 1e-7),
    "kgm2": ("inertia", 1.0),
    "ms": ("time", 1e-3),
    "s": ("time", 1.0),
    "s/rad": ("slowness", 1.0),
    "Nm/rad": ("stiffness", 1.0),
    "N/m": ("linear stiffness", 1.0),
    "kN/m": ("linear stiffness", 1e3),
    "um": ("length", 1e-6),
    "mm": ("length", 1e-3),
    "m": ("length", 1.0),
    "N": ("force", 1.0),
    "kN": ("force", 1e3),
    "Ns/m": ("linear damping", 1.0),
    "kg": ("mass", 1.0),
    "s/m": ("linear slowness", 1.0),
    "mm/s": ("drift", 1e-3),
    "mm/N": ("compliance", 1e-3),
    "mm/Ns": ("mobility", 1e-3),
}
"""Units that the command line accepts, by size: their dimension and their size in SI."""
ON_SLIDES = {
    "angle": "length",
    "torque": "force",
    "damping": "linear damping",
    "inertia": "mass",
    "slowness": "linear slowness",
    "stiffness": "linear stiffness",
}
"""What a dimension of hinges is of slides; others are the same."""
LARGEST = 1000.0
"""A size of so many units is said in the next larger one."""
NATURAL = {
    "torque": "torque_limit_nm",
    "damping": "kd_nms_rad",
    "inertia": "rotor_inertia_kgm2",
    "stiffness": "kp_nm_rad",
}
"""Numbers of a drive that magnitudes of a dimension are relative to; others stand by themselves."""
Levels = tuple[float, float, float]
"""A small, a medium and a large magnitude."""
POINTS = ("Law", "Source", "Hardware", "Log", "Confused with")
"""What the docstring of every effect says, a paragraph each: `description` reads them.

The equation as implemented; where it comes from; what was seen on real machines; how it shows in a
recording; and which effects look alike, with what tells them apart.
"""


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """Base class of every effect; a subclass named `Effect` in its own file is one effect.

    An effect of zero magnitude changes nothing. Several effects are applied one after the other. An
    effect only changes numbers of the spec. The code that uses these numbers (command path, drive,
    sensor, skin) is the same for all engines. Two worlds are equal if the digests of their numbers
    are equal.
    """

    magnitude: float
    """Magnitude in SI units of `dimension`."""
    joint: str | None = None
    """The joint that it acts on; None: every joint that it applies to."""

    group: ClassVar[str]
    """What it belongs to, such as 'drive' or 'touch': effects of a group share a page."""
    dimension: ClassVar[str]
    """Dimension of the magnitude, one of those in `UNITS`."""
    unit: ClassVar[str]
    """Unit in which the magnitude is usually written."""
    bounds: ClassVar[tuple[float, float]]
    """Allowed magnitudes in SI units, both included."""
    levels: ClassVar[Levels]
    """What the blind check draws, in natural sizes (`natural`)."""
    drawn: ClassVar[bool] = True
    """Whether the blind check draws it: not what no diagnosis here looks for."""
    opposite: ClassVar[Levels | None] = None
    """The same of the other sign, of an effect that has both."""
    per_joint: ClassVar[bool] = True
    """Whether it acts on joints; then it may name one."""
    hinges_only: ClassVar[bool] = False
    """Whether slides cannot have it."""
    at_ends: ClassVar[bool] = False
    """Without a named joint it acts only on links that carry no driven one."""
    by_weight: ClassVar[bool] = False
    """Whether it shows only on joints that weight turns: a hand with upright axes has none."""
    gear: ClassVar[str | None] = None
    """Without a named joint it acts only on joints with this gear; None: on all joints."""
    spread: ClassVar[str] = "normal"
    """Distribution of its magnitude under domain randomisation: 'normal' or 'uniform'."""

    spot: ClassVar[tuple[str, ...]] = ()
    """Numbers that say where on its link it acts [m]: a diagnosis finds them with its magnitude."""
    coordinate: ClassVar[str] = "amount"
    """What a diagnosis varies, below `u`, so that nothing leaves its sign.

    'amount': the number grows by u natural sizes (`diagnosis.models.sizes`); 'logarithm': it is
    multiplied by exp(u); 'compliance': its inverse grows by u natural sizes; 'reach': u is by how
    far a joint falls short of where its nominal drive takes it, to the side where it does so more.
    """
    nominal: ClassVar[bool] = False
    """Its number stands in the mechanism's file, so it is off by the log's nominal uncertainty."""
    tolerance: ClassVar[float] = 0.0
    """What a healthy robot has of it, standard deviation of u beside the nominal uncertainty."""
    least: ClassVar[float | None] = None
    """From which u on a diagnosis names it; None: replays of free air do not show it."""
    most: ClassVar[float] = 1.0
    """Largest u that a diagnosis tries."""
    either_sign: ClassVar[bool] = False
    """Whether u may be negative as an effect."""
    breaks: ClassVar[bool] = False
    """Whether u may fall to what the mechanism's file has of it: a spring that is worn or gone."""
    kinked: ClassVar[bool] = False
    """Its law has a kink: fits of it start from a scan of sizes."""
    by_column: ClassVar[bool] = False
    """As a tolerance it adds its slope to a replay: within its kink it is no smooth parameter."""
    family: ClassVar[str | None] = None
    """Effects of a family at a joint are one cause: the others are the shape of its law."""
    narrow_as: ClassVar[str | None] = None
    """What it is in a narrow range: that one is named where both explain a log alike."""
    exact: ClassVar[bool] = False
    """Its law is exact in every mechanism, as a sensor's offset; else it is a model of many."""
    shared: ClassVar[bool] = False
    """All joints may have the same of it, as what a bus does to all its drives."""

    unsaid: ClassVar[bool] = False
    """Whether files often say nothing of it: then all joints may have some, each as much as it has,
    as one cause."""

    whole: ClassVar[float] = 1.0
    """From one side to the other it is so many times its magnitude."""
    slips: ClassVar[bool] = False
    """Whether it shows when the stick is pulled out of the grip."""
    near: ClassVar[tuple[str, ...]] = ()
    """Effects that a mechanic would accept for it where a catalogue lacks it."""
    same_as: ClassVar[str | None] = None
    """An effect that says the same of a robot."""
    apart_by: ClassVar[str | None] = None
    """The channel that tells it from that one; None: none does."""

    @classmethod
    def spec_fields(cls) -> tuple[str, ...]:
        """Names of the spec's numbers that it changes.

        An engine supports the effect as well as it supports these numbers.
        """
        return ()

    @classmethod
    def is_of(cls, *parts: str) -> bool:
        """Whether it changes a number of one of these parts of the spec."""
        return any(number.split(".")[0] in parts for number in cls.spec_fields())

    @classmethod
    def shows_in_hand(cls) -> bool:
        """Whether it shows only with the stick in the hand."""
        return cls.is_of("taxels", "stick", "contact")

    @classmethod
    def units(cls, slides: bool = False) -> tuple[str, ...]:
        """The units of its magnitude on a hinge or a slide, the smallest first."""
        other = ON_SLIDES if slides and cls.per_joint else {}
        dimension = other.get(cls.dimension, cls.dimension)
        return tuple(unit for unit, (what, _) in UNITS.items() if what == dimension)

    @classmethod
    def unit_of(cls, magnitude: float, slides: bool = False) -> str:
        """The unit in which a magnitude [SI] on a hinge or a slide is said."""
        units = cls.units(slides)
        usual = units[units.index(cls.unit) :] if cls.unit in units else units
        return next((u for u in usual if abs(magnitude) < LARGEST * UNITS[u][1]), usual[-1])

    @classmethod
    def natural(cls, drive: Drive) -> float:
        """The natural size of its magnitude on a drive, in SI units."""
        return float(getattr(drive, NATURAL[cls.dimension])) if cls.dimension in NATURAL else 1.0

    def joints(self, spec: Spec) -> tuple[str, ...]:
        """Names of its joints, in spec order; raises ValueError for a joint without a drive."""
        known = spec.hand.joint_names
        if not self.per_joint:
            return ()
        if self.joint is None:
            links = spec.hand.ends if self.at_ends else spec.hand.driven
            fits = [b.joint for b in links if self.refusal(b) is None]
            return tuple(joint.name for joint in fits if self.gear in (None, joint.gear))
        if self.joint not in known:
            raise ValueError(f"no driven joint named '{self.joint}'; known: {', '.join(known)}")
        why = self.refusal(spec.hand.driven[known.index(self.joint)])
        if why is not None:
            raise ValueError(f"{self.joint} {why} have this effect")
        return (self.joint,)

    @classmethod
    def refusal(cls, body: Body) -> str | None:
        """Why a body's joint cannot have it, in words; None where it can."""
        if cls.hinges_only and body.joint.slides:
            return "slides; only hinges"
        return None

    def on_spec(self, spec: Spec) -> Spec:
        """The world with this effect; raises ValueError where the effect cannot act."""
        return spec


class NumberEffect(Effect):
    """Base class of the effects that change one number of the spec."""

    number: ClassVar[str]
    """Name of that number, such as 'drive.kp_nm_rad'; drive, command, encoder and body are per
    joint."""
    relative: ClassVar[bool] = False
    """Whether the magnitude is relative to that number instead of an amount."""

    @classmethod
    def spec_fields(cls) -> tuple[str, ...]:
        """See `Effect.spec_fields`."""
        return (cls.number,)

    def changed(self, value: float) -> float:
        """The number after the effect."""
        return value * (1 + self.magnitude) if self.relative else value + self.magnitude

    @final
    def on_spec(self, spec: Spec) -> Spec:
        """See `Effect.on_spec`."""
        part, field = self.number.split(".")
        if self.per_joint:
            return with_effects(spec, (self,))
        if part == "taxels":
            hand = dataclasses.replace(spec.hand, taxels=self._on(spec.hand.taxels, field))
            return dataclasses.replace(spec, hand=hand)
        return dataclasses.replace(spec, **{part: self._on(getattr(spec, part), field)})

    def note(self, spec: Spec, numbers: "Numbers") -> None:
        """Write the changed number for every joint that it acts on."""
        part, field = self.number.split(".")
        joints = self.joints(spec)
        for body in spec.hand.driven:
            if body.joint.name in joints:
                home = body if part == "body" else getattr(body.joint, part)
                known = numbers.setdefault(body.joint.name, {}).setdefault(part, {})
                known[field] = self.changed(known.get(field, getattr(home, field)))

    def _on(self, part: Any, field: str) -> Any:
        return dataclasses.replace(part, **{field: self.changed(getattr(part, field))})


Numbers = dict[str, dict[str, dict[str, float]]]
"""Numbers of joints that differ from those of a world: by joint, part and field."""


def with_effects(spec: Spec, effects: Iterable[Effect]) -> Spec:
    """The world with these effects, applied in order.

    Raises ValueError where an effect cannot act. Changes to joints are collected and built once,
    because a diagnosis builds thousands of worlds with ten effects each.
    """
    numbers: Numbers = {}
    for effect in effects:
        if isinstance(effect, NumberEffect) and effect.per_joint:
            effect.note(spec, numbers)
        else:
            spec = effect.on_spec(_built(spec, numbers))
            numbers = {}
    return _built(spec, numbers)


def _built(spec: Spec, numbers: Numbers) -> Spec:
    if not numbers:
        return spec
    return spec.with_driven(_body(b, numbers.get(b.joint.name, {})) for b in spec.hand.driven)


def _body(body: Body, parts: dict[str, dict[str, float]]) -> Body:
    of_joint: dict[str, Any] = {
        part: dataclasses.replace(getattr(body.joint, part), **fields)
        for part, fields in parts.items()
        if part != "body"
    }
    own: dict[str, Any] = dict(parts.get("body", {}))
    if of_joint:
        own["joint"] = dataclasses.replace(body.joint, **of_joint)
    return dataclasses.replace(body, **own) if own else body


def description(kind: type[Effect]) -> tuple[str, dict[str, str]]:
    """What an effect's docstring says: what the magnitude is, and the text of each of `POINTS`."""
    first, _, rest = inspect.cleandoc(kind.__doc__ or "").partition("\n\n")
    parts = re.split(rf"^({'|'.join(POINTS)}): ", rest, flags=re.MULTILINE)[1:]
    texts = (" ".join(part.split()) for part in parts[1::2])
    return " ".join(first.split()), dict(zip(parts[::2], texts, strict=True))


def magnitudes(kind: type[Effect]) -> str:
    """The allowed magnitudes in the usual unit, such as '0 to 10 deg'."""
    size = UNITS[kind.unit][1]
    low, high = (f"{bound / size:g}" for bound in kind.bounds)
    return f"{low} to {high} {kind.unit}"
