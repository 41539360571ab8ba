"""The curve of confidence is the share of right answers, on makes that it was not fitted on."""

import json
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.blind import calibrate
from diagnosis.blind.calibrate import NAMED, NONE, UNKNOWN, Row
from diagnosis.verdict.probability import probability

TRUE = {
    NAMED: {"constant": 1.0, "unshared": -0.6, "left": -0.5, "tied": -1.0, "more": -0.2, "lead": 1},
    UNKNOWN: {"constant": 0.5, "gap": 1.2, "share": -0.8},
    NONE: {"constant": 1.5, "gap": -1.0},
}
MAKES = ("dart", "pwm", "cascade", "filtered")


def drawn(count: int, seed: int, shift: float = 0.0) -> list[Row]:
    """Verdicts whose answers are right as `TRUE` says; `shift` moves the first make's."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        make, kind = MAKES[k % len(MAKES)], (NAMED, NAMED, UNKNOWN, NONE)[rng.integers(4)]
        features = {
            "constant": 1.0,
            "unshared": float(np.log(rng.uniform(0.001, 0.6))),
            "share": float(rng.uniform()),
            "gap": float(rng.normal()),
            "left": float(rng.normal()),
            "tied": float(rng.integers(2)),
            "more": float(rng.integers(2)),
            "lead": float(rng.uniform()),
        }
        chance = np.clip(probability(kind, features, TRUE) + shift * (make == MAKES[0]), 0.0, 1.0)
        found.append(Row(make=make, kind=kind, features=features, right=rng.uniform() < chance))
    return found


def test_a_known_curve_is_found():
    """Come within 0.03 of the true probability on average, over a thousand fresh rows."""
    curve = calibrate.fit(drawn(4000, 0))
    fresh = drawn(1000, 1)
    said, known = ([probability(r.kind, r.features, by) for r in fresh] for by in (curve, TRUE))
    assert np.abs(np.subtract(said, known)).mean() < 0.03
    for kind, true in TRUE.items():
        assert list(curve[kind]) == list(calibrate.FEATURES[kind]) == list(true)


def test_every_bin_is_as_right_as_it_is_sure():
    """Stay within three standard errors in each of four bins, every make left out in turn."""
    found = calibrate.calibrate(drawn(1200, 2))
    table = found.table.set_index("of")
    assert list(table.index[:1]) == ["all"] and table.loc["all", "cases"] == 1200
    assert sum(table.loc[f"bin {k}", "cases"] for k in range(1, 5)) == 1200
    for name in ("all", "bin 1", "bin 2", "bin 3", "bin 4"):
        row = table.loc[name]
        error = np.sqrt(row["confidence"] * (1 - row["confidence"]) / row["cases"])
        assert abs(row["excess"]) < 3 * error + 0.01
    assert ((found.left_out > 0) & (found.left_out < 1)).all()


def test_a_make_is_tried_by_the_others_alone():
    """Show the excess of a make that is worse than all others instead of learning it."""
    found = calibrate.calibrate(drawn(2000, 3, shift=-0.4))
    table = found.table.set_index("of")
    assert table.loc[MAKES[0], "excess"] > 0.25
    assert table.loc[MAKES[1], "excess"] < 0.0


def test_few_rows_claim_little():
    """Stay near the share that is right where there are a dozen rows."""
    rows = [r for r in drawn(60, 4) if r.kind == NAMED][:12]
    curve = calibrate.fit(rows)
    said = [probability(row.kind, row.features, curve) for row in rows]
    assert np.mean(said) == pytest.approx(np.mean([row.right for row in rows]), abs=0.03)
    assert probability(NONE, rows[0].features, curve) == 0.5


def test_what_explains_more_is_never_less_sure():
    """Learn nothing of rows that are right where less is explained, for few rows have such luck."""
    rows = [r for r in drawn(200, 7) if r.kind == NAMED]
    odd = [replace(row, right=row.features["unshared"] > -1.5) for row in rows]
    assert calibrate.fit(odd)[NAMED]["unshared"] == 0.0


def test_one_make_is_refused():
    """Refuse rows of one make: there is none to try the curve on."""
    rows = [row for row in drawn(40, 5) if row.make == "dart"]
    with pytest.raises(ValueError, match="all cases are of one real side, dart"):
        calibrate.calibrate(rows)


def test_coefficients_are_plain_numbers():
    """Write coefficients as JSON by kind and feature, and read the same."""
    curve = calibrate.fit(drawn(200, 6))
    assert json.loads(json.dumps(curve)) == curve
    assert set(curve) == {NAMED, UNKNOWN, NONE}
