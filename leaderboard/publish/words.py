"""Small words that several blocks say alike."""

from collections.abc import Iterable, Sequence

SHOWN = {
    **{"mujoco": "MuJoCo", "bullet": "Bullet", "sapien": "SAPIEN", "plant": "plain plant"},
    "mujoco-warp": "MuJoCo Warp",
    **{"exudyn": "Exudyn", "drake": "Drake", "dart": "DART", "bristle": "bristle plant"},
    **{"plain": "plain MuJoCo"},
}
"""How engines and plants are called in running text, in their order."""
EFFECTS = {"built": "hand as built", "none": "ideal hand"}


def in_order(names: Iterable[str]) -> list[str]:
    """Engines and plants as they are shown, others behind them."""
    known = list(SHOWN)
    return sorted(names, key=lambda n: (known.index(n) if n in known else len(known), n))


def shown(name: str) -> str:
    """An engine or a plant in running text."""
    return SHOWN.get(name, name)


def listed(words: Sequence[str]) -> str:
    """Words in a sentence: a, b and c."""
    if not words:
        return "none"
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def world(name: str) -> str:
    """A world in words, from its engine and effects."""
    backend, effects = name.split(" ", 1)
    return f"{shown(backend)} ({EFFECTS.get(effects, effects)})"


def million(steps: int) -> str:
    """A number of steps."""
    return f"{steps / 1e6:g} million"


def percent(share: float) -> str:
    """A share as tables show it."""
    return f"{share:.1%}".replace("%", " %")
