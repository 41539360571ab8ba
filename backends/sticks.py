"""Sticks of several shapes, weights and surfaces, after the paper's figure of novel sticks."""

from backends.spec import Stick

_ALL = (
    Stick(
        name="reference",
        shape="capsule",
        length_m=0.20,
        radius_m=4.5e-3,
        mass_kg=0.030,
        friction=1.0,
    ),
    Stick(
        name="steel", shape="capsule", length_m=0.20, radius_m=4.0e-3, mass_kg=0.079, friction=0.7
    ),
    Stick(
        name="fabric", shape="capsule", length_m=0.20, radius_m=6.0e-3, mass_kg=0.025, friction=1.2
    ),
    Stick(
        name="thin", shape="capsule", length_m=0.20, radius_m=3.0e-3, mass_kg=0.018, friction=1.0
    ),
    Stick(
        name="thick", shape="capsule", length_m=0.20, radius_m=7.0e-3, mass_kg=0.045, friction=1.0
    ),
    Stick(name="square", shape="box", length_m=0.20, radius_m=4.5e-3, mass_kg=0.030, friction=1.0),
)

STICKS: dict[str, Stick] = {stick.name: stick for stick in _ALL}
"""Sticks by name; policies are trained on 'reference'."""
