"""One mechanism recorded under several settings: fitted on some of them, judged on the others.

Each setting, such as a gain, is a log with a nominal world of its own; an effect is the same in all
of them. A cause that is right holds under settings that it was not fitted on.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.evidence import Evidence
from diagnosis.logs.log import LogError


@dataclass(frozen=True, kw_only=True)
class Conditions(Evidence):
    """The evidence for one limb under every setting; its numbers are of the first."""

    parts: tuple[Evidence, ...]

    @property
    def settings(self) -> tuple[Evidence, ...]:
        """See `Evidence.settings`."""
        return self.parts

    def knowing(self, effects: Sequence[Effect]) -> "Conditions":
        """See `Evidence.knowing`: each setting by itself."""
        parts = tuple(part.knowing(effects) for part in self.parts)
        return replace(self, nominal=parts[0].nominal, parts=parts)

    def residual(
        self, effects: Sequence[Effect], judged: bool | None = None, compress: bool = True
    ) -> Array:
        """See `Evidence.residual`: settings follow each other."""
        return np.concatenate([p.residual(effects, judged, compress) for p in self._with(judged)])

    def innovations(
        self, effects: Sequence[Effect], judged: bool | None = None, compress: bool = True
    ) -> Array:
        """See `Evidence.innovations`: settings follow each other."""
        return np.concatenate(
            [p.innovations(effects, judged, compress) for p in self._with(judged)]
        )

    def tracks(self, judged: bool | None = None) -> Array:
        """See `Evidence.tracks`: settings follow each other."""
        return np.concatenate([p.tracks(judged) for p in self._with(judged)])

    def protocols(self, judged: bool | None = None) -> Array:
        """See `Evidence.protocols`: settings follow each other."""
        return np.concatenate([p.protocols(judged) for p in self._with(judged)])

    def allowing_for(self, effects: Sequence[Effect]) -> "Conditions":
        """See `Evidence.allowing_for`: each setting by itself."""
        return replace(self, parts=tuple(part.allowing_for(effects) for part in self.parts))

    def forgiving(
        self, effects: Sequence[Effect], moved: Sequence[Sequence[Effect]]
    ) -> "Conditions":
        """The evidence of each setting with its prediction spread."""
        return replace(self, parts=tuple(part.forgiving(effects, moved) for part in self.parts))

    def _with(self, judged: bool | None) -> list[Evidence]:
        """The settings with samples for judging, for fitting, or any (None)."""
        if judged is None:
            return list(self.parts)
        return [p for p in self.parts if any((r.judged == judged).any() for r in p.recordings)]

    def unrest(self, effects: Sequence[Effect], moved: Sequence[Effect]) -> float:
        """How chaotic replays are: root mean square over the settings that judge."""
        apart = [part.unrest(effects, moved) for part in self._with(True)]
        return float(np.sqrt(np.mean(np.square(apart))))


def join(parts: Sequence[Evidence], judging: Collection[int]) -> Conditions:
    """One limb's evidence under several settings, judged on those numbered in `judging`.

    Raises LogError where the joints differ, or none or all of the settings would judge.
    """
    if len({part.joints for part in parts}) > 1:
        raise LogError("these logs are of different joints; give logs of one mechanism")
    if not 0 < len(set(judging)) < len(parts):
        raise LogError(
            f"{len(set(judging))} of {len(parts)} settings would judge; name at least one, and "
            "leave one to fit on"
        )
    split = tuple(_whole(part, k in judging) for k, part in enumerate(parts))
    return Conditions(
        nominal=split[0].nominal,
        recordings=tuple(r for part in split for r in part.recordings),
        sigma=split[0].sigma,
        floor=split[0].floor,
        size=split[0].size,
        parts=split,
    )


def _whole(part: Evidence, judges: bool) -> Evidence:
    """The evidence with all of its samples for judging, or all for fitting."""
    recordings = (replace(r, judged=np.full(len(r.judged), judges)) for r in part.recordings)
    return replace(part, recordings=tuple(recordings))
