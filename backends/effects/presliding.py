"""Dry friction whose asperities bend like bristles before they slide."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Torque of the friction where it slides, beside the Coulomb torque that has a sharp edge.

    Law: friction = magnitude z; z' = (m' - |m'| z) / d, with d = 3 mrad at the joint where
      `drive.presliding_rad` says no other: a spring of magnitude / d before it slides, Coulomb
      friction from a few d on.
    Source: Dahl, *A solid friction model*, Aerospace Corporation TOR-0158(3107-18), 1968; LuGre
      without its damping, Canudas de Wit et al., IEEE Trans. Automatic Control 40 (1995).
    Hardware: No published range at the joint of a hand found.
    Log: As coulomb-friction, with rounded reversals, and a joint that springs back a little where a
      push ends.
    Confused with: coulomb-friction, which holds without a bend; series-elasticity, which bends
      without a limit.
    """

    group = "gears and joints"
    dimension, unit = "torque", "mNm"
    bounds = (0.0, 1.0)
    levels = (0.02, 0.06, 0.15)
    number = "drive.presliding_nm"
    least = 0.01
    most = 1.0
    family = "dry friction"
    near = ("coulomb-friction", "stiction")
