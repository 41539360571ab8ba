"""The physics checks fail when a world is not the one that was asked for."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from backends.engine import Engine
from backends.mujoco import Backend
from backends.spec import Spec
from benchmark.physics import contact, drive, free, grasp, parity, pinch, rigid, skin, slide
from benchmark.physics.check import Check, Measure

Change = Callable[[Spec], Spec]


def faulty(change: Change) -> type[Engine]:
    """A real engine that builds other worlds than it is given."""

    class Faulty(Backend):
        def __init__(self, specs: Sequence[Spec]) -> None:
            super().__init__([change(spec) for spec in specs])

    return Faulty


def scaled(part: str, field: str, by: float) -> Change:
    """Multiply a number of the stick, the contact, every drive or every body."""

    def change(spec: Spec) -> Spec:
        def on(item: Any) -> Any:
            value = getattr(item, field)
            new = tuple(v * by for v in value) if isinstance(value, tuple) else value * by
            return dataclasses.replace(item, **{field: new})

        if part == "drive":
            return spec.with_drives(on(d) for d in spec.drives)
        if part == "body":
            return spec.with_driven(on(b) for b in spec.hand.driven)
        if part == "tip":
            hand = dataclasses.replace(spec.hand, fingertips=tuple(map(on, spec.hand.fingertips)))
            return dataclasses.replace(spec, hand=hand)
        return (
            on(spec)
            if part == "spec"
            else dataclasses.replace(spec, **{part: on(spec.__dict__[part])})
        )

    return change


@pytest.mark.parametrize(
    ("change", "measure", "found"),
    [
        (scaled("spec", "gravity_m_s2", 1 + 1e-9), free.fall, "free fall, distance"),
        (scaled("timing", "weightless_s", 0.98), free.fall, "mass of the stick"),
        (scaled("body", "inertia_kgm2", 1.001), free.pendulum, "pendulum, period"),
        (scaled("body", "origin_m", 1.0001), rigid.tips, "fingertips by touch"),
        (scaled("body", "mass_kg", 1 + 1e-5), rigid.masses, "masses and inertias of the hand"),
        (scaled("body", "com_m", 1 + 1e-5), rigid.gravity, "gravity torques of the hand"),
        (scaled("body", "com_m", 1 + 1e-9), rigid.swing, "free swing"),
        (scaled("drive", "kp_nm_rad", 1.001), drive.step, "step response, steady error"),
        (scaled("drive", "kd_nms_rad", 1.1), drive.step, "step response, overshoot"),
        (scaled("drive", "rotor_inertia_kgm2", 1.1), drive.step, "step response, error of dt"),
        (scaled("drive", "gear_stiffness_nm_rad", 1.01), drive.sag, "sag under ten g, joints"),
        (scaled("drive", "play_rad", 1.001), drive.push_test, "play of 1.0 deg"),
        (scaled("drive", "lock_nm", 0.01), drive.self_lock, "pushed worm joint"),
        (scaled("stick", "mass_kg", 1 + 1e-5), contact.rest, "resting stick, sum"),
        (scaled("stick", "friction", 1.03), pinch.slip, "slip across it"),
        (scaled("stick", "friction", 1.03), pinch.slip, "sliding along"),
        (scaled("contact", "torsion_radius_m", 1.03), pinch.spin, "spin at the pinch"),
        (scaled("stick", "length_m", 1.005), pinch.swing, "swing of the pinched stick"),
        (scaled("stick", "friction", 3.0), slide.touch, "sliding in a grip"),
        (scaled("contact", "torsion_radius_m", 1.5), slide.spin, "spin under"),
        (scaled("tip", "radius_m", 0.99), skin.taxels, "sinking of the stick into the skin at 0.5"),
        (scaled("stick", "friction", 0.9), grasp.slip, "slip of the three-finger grasp"),
    ],
)
def test_fault_is_found(change: Change, measure: Measure, found: str) -> None:
    """Fail the check that is about what is wrong with the world."""
    failed = [check.name for check in measure(faulty(change)) if not check.passed]
    assert [name for name in failed if name.startswith(found)]


def test_worn_out_drive_differs_from_the_reference() -> None:
    """Fail the comparison of free responses when a gain is 1 % off."""
    checks = tuple(parity.response(faulty(scaled("drive", "kp_nm_rad", 1.01)), Backend))
    assert not any(check.passed for check in checks[:2])


@pytest.mark.parametrize(
    ("figure", "passed"),
    [(1.0, True), (1.1, True), (0.9, True), (1.11, False), (float("nan"), False)],
)
def test_figure_off_its_bound_fails(figure: float, passed: bool) -> None:
    """Pass within the bound, both ends included, and fail beyond it or where there is no figure."""
    check = Check(name="n", figure=figure, unit="1", expected=1.0, bound=0.1 + 1e-12, why="w")
    assert check.passed is passed
