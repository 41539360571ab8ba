"""Effects that no part of a diagnosis looks for are said, so that none is ignored in silence."""

from collections.abc import Mapping

from backends.effect import Effect, NumberEffect
from diagnosis.motion.columns import COLUMNS
from diagnosis.verdict.in_hand import missing
from diagnosis.verdict.sensors import LOSS, NOISE, RESOLUTION, STEP

SENSED = (NOISE, RESOLUTION, LOSS, STEP)
"""Numbers that sensors and packets show by themselves."""
WHY = "not looked for: neither replays, sensors nor grasps here show it"


def not_looked_for(catalogue: Mapping[str, type[Effect]]) -> tuple[str, ...]:
    """What to say of the effects of a catalogue that nothing looks for; nothing of none."""
    return missing((name for name, kind in catalogue.items() if not _is_sought(kind)), WHY)


def _is_sought(kind: type[Effect]) -> bool:
    if kind.shows_in_hand() or set(kind.spec_fields()) & set(SENSED):
        return True
    replayed = not issubclass(kind, NumberEffect) or kind.number in COLUMNS
    return replayed and kind.least is not None
