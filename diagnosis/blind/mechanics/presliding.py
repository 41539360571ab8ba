"""A plant with presliding friction: a reversal shows long before anything slides.

    i    = clip(kp band(target - motor) - kd speed), once a millisecond
    F    = (level + stiction exp(-|w| / V)) z
    z    = (z1 + z2 + z3) / 3,   zi' = w / di held within -1 to 1       Maxwell slip
    or z' = (w - |w| z) / d                                             Dahl

di are 0.4, 1.2 and 2 d. The level has a quarter of the data sheet's Coulomb friction as stiction on
top, always. Everything else is `_two_mass`.

Maxwell slip: D. D. Rizos and S. D. Fassois, Chaos 14, 2004; the same elements stand in F. Al-Bender
et al., IEEE Transactions on Automatic Control 50, 2005. Dahl: Aerospace report TOR-0158, 1968.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numba

from backends.state import Array
from diagnosis.blind.mechanics import _geared, _two_mass
from diagnosis.blind.mechanics._geared import PERIOD_S, Geared, pd


@dataclass(frozen=True, kw_only=True)
class Baseline(_geared.Baseline):
    """The small faults of every robot of this plant."""

    bend_rad: float = 1e-3
    """d."""
    stiction: float = 0.25
    """Stiction over the Coulomb friction of the data sheet."""
    slips: float = 1.0
    """Maxwell slip from 0.5 on, Dahl below."""

    ranges = {
        "bend_rad": (5e-4, 1.5e-3),
        "slips": (0.0, 1.0),
    }


@numba.njit(_two_mass.FRICTION, cache=True)
def friction(speed, own, state):
    """Mean bend of three elements that slip one after the other, or of one bristle."""
    if own[1] < 0.5:
        state[6] = _two_mass.bristle(speed, own[0], state[6])
        return state[6]
    total = 0.0
    for i in range(3):
        slid = _two_mass.TICK_S * speed / (own[0] * (0.4 + 0.8 * i))
        state[6 + i] = min(max(state[6 + i] + slid, -1.0), 1.0)
        total += state[6 + i] / 3
    return total


class Mechanics(Geared):
    """Limbs of one or two parallel hinges."""

    baseline, laws = Baseline, (pd, friction)

    def stiction(self, base: Baseline, numbers: Mapping[str, Array]) -> Array:
        """A share of the Coulomb friction."""
        return base.stiction * numbers["coulomb"]

    def chassis(self, base: Baseline, limit_nm: Array) -> _two_mass.Chassis:
        """See `Geared`."""
        return _two_mass.Chassis(period_s=PERIOD_S)

    def own(self, base: Baseline, limit_nm: Array) -> list:
        """See `Geared`."""
        return [base.bend_rad, base.slips]
