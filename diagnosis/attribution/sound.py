"""What logs of a sound mechanism leave beside the nominal world, and what that excuses.

No nominal world is the mechanism: teeth, friction and currents differ from it somewhat, always. The
rules allow for what worlds of other equations left. Where there are logs of the mechanism while
nothing was wrong with it, they say it themselves, and a verdict asks for more than they show.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from diagnosis.attribution.rules import Rules


@dataclass(frozen=True, kw_only=True)
class Sound:
    """The most that the nominal refit leaves of one limb in any log of a sound mechanism."""

    surprise: float = 0.0
    """Whiteness z-score of the innovations."""
    unevenness: float = 0.0
    """The same in the worst protocol."""
    lack_of_fit: float = 0.0
    """Cross-validated gain of what follows the motion [nats]."""
    bent: float = 0.0
    """How far the nominal parameter that is farthest off is, in its standard deviations."""
    sizes: Mapping[str, float] = field(default_factory=dict)
    """Magnitudes of effects that seem to be there, by name; what a sound mechanism has of them."""

    def most(self, effect: str, rule: Rules) -> float:
        """An effect may be so large and no more than what a sound mechanism has of it."""
        return rule.sound_more * self.sizes.get(effect, 0.0)

    def excused(self, rule: Rules) -> Rules:
        """The rules, so much wider that none of these logs would be of an unknown effect.

        Prior limits of nominal parameters widen together, by what the farthest of them asks.
        """
        wider = max(1.0, self.bent / rule.alone_stds)
        return rule.model_copy(
            update={
                "white_sd": max(rule.white_sd, rule.sound_more * self.surprise),
                "uneven_sd": max(rule.uneven_sd, rule.sound_more * self.unevenness),
                "law_nats": max(rule.law_nats, rule.sound_more * self.lack_of_fit),
                "alone_stds": wider * rule.alone_stds,
                "bent_stds": wider * rule.bent_stds,
                "pair_stds": wider * rule.pair_stds,
            }
        )


def worst(sounds: Sequence[Sound]) -> Sound:
    """The most of each that any of one limb's logs shows."""
    names = {name for one in sounds for name in one.sizes}
    return Sound(
        surprise=max((one.surprise for one in sounds), default=0.0),
        unevenness=max((one.unevenness for one in sounds), default=0.0),
        lack_of_fit=max((one.lack_of_fit for one in sounds), default=0.0),
        bent=max((one.bent for one in sounds), default=0.0),
        sizes={name: max(one.sizes.get(name, 0.0) for one in sounds) for name in sorted(names)},
    )
