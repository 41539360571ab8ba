"""Compare answers and verdicts: one row per case, and one per true effect."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from backends.effect import UNITS, Effect
from diagnosis.blind import rigs
from diagnosis.blind.draw import Case, Fault
from diagnosis.blind.near import is_near, plain_names
from diagnosis.blind.oracle import Oracle

NONE, UNKNOWN = "none", "unknown"
TOP = 3
ORDINARY_FLOORS = 4.0
"""Ordinary gap of healthy robots; with less than this left, both `none` and `unknown` are right."""
HEALTHY_MORE, HEALTHY_LEAST = 1.3, 1.2
"""The same with healthy logs: this multiple of their gap, but at least this."""
FAULT_COLUMNS = (
    *("number", "mode", "real", "rig", "protocols", "channels", "effect", "level", "magnitude"),
    *("unit", "oracle_nats", "detectable", "found", "joints_right", "error", "covered"),
)


def case_row(
    case: Case,
    said: dict,
    sysid: dict,
    oracle: Oracle,
    catalogue: Mapping[str, type[Effect]],
    healthy: int = 0,
) -> dict:
    """One case: the truth, the verdicts of solver and rival, and where they are right."""
    verdict = said.get("verdict", ["refused"])
    truth = _truth(case)
    names = [f.effect for f in case.faults]
    greedy = said.get("greedy", {"effect": None, "shrinkage": None})
    first = case.faults[0] if case.faults else None
    right, near = rightness(case, said, catalogue, healthy)
    return {
        "number": case.number,
        "mode": case.mode,
        "real": case.real,
        "rig": rigs.family(case.rig),
        "channels": "+".join(case.channels),
        "protocols": "+".join(case.protocols),
        "truth": " + ".join(truth),
        "hidden": "; ".join(_written(f, catalogue) for f in case.faults),
        "excluded": ", ".join(case.excluded),
        "level": first.level if first else None,
        "oracle_nats": min((n for n in oracle.nats if n is not None), default=None),
        "left_nats": _left_nats(said, oracle),
        "detectable": oracle.detectable,
        "strong": oracle.strong,
        "verdict": " + ".join(sorted(verdict)),
        "right": right,
        "right_or_tied": right or _tied(verdict, truth, said),
        "near": near,
        "right_or_near": right or near,
        "residual_floors": case.residual_floors,
        "left_floors": case.left_floors,
        "ordinary": _is_ordinary(case, healthy),
        "accuses": not {NONE, UNKNOWN, "refused"} >= set(verdict),
        "one_of": bool(set(names) & set(verdict)),
        "spurious": bool(set(names) & set(verdict)) and bool(set(verdict) - set(names)),
        "in_top": bool(names) and names[0] in _top(said),
        "joints_right": _joints_right(first, said, case, catalogue) if first else None,
        "confidence": said.get("confidence"),
        "shrinkage": said.get("shrinkage"),
        "shrinkage_nominal": said.get("shrinkage_nominal"),
        "shrinkage_greedy": greedy["shrinkage"],
        "shrinkage_oracle": oracle.shrinkage,
        "shrinkage_sysid": sysid.get("shrinkage"),
        "greedy": greedy["effect"],
        "sysid": sysid.get("effect"),
        "catalogue": len(said["catalogue"]),
        "cpu_s": said.get("cpu_s"),
        "rules_version": said["rules_version"],
        "solver_sha256": said["solver_sha256"],
        "refused": said["refused"],
    }


def rightness(
    case: Case, said: dict, catalogue: Mapping[str, type[Effect]], healthy: int = 0
) -> tuple[bool, bool]:
    """Whether a verdict is right, and whether it is near the true fault instead."""
    verdict = said.get("verdict", ["refused"])
    right = sorted(verdict) == _truth(case)
    if rigs.robot(case.rig) is not None:
        named, true = (plain_names(names, case.channels) for names in (verdict, _truth(case)))
        right = named == true
    right = right or (_is_ordinary(case, healthy) and verdict == [NONE])
    unknown = case.mode == UNKNOWN and bool(case.faults)
    return right, unknown and _near(case.faults[0], said, case, catalogue)


def fault_rows(
    case: Case, said: dict, oracle: Oracle, catalogue: Mapping[str, type[Effect]]
) -> list[dict]:
    """One row per true effect of a case that its solver could name."""
    if case.mode not in ("single", "pair"):
        return []
    return [
        {
            "number": case.number,
            "mode": case.mode,
            "real": case.real,
            "rig": rigs.family(case.rig),
            "protocols": "+".join(case.protocols),
            "channels": "+".join(case.channels),
            "effect": fault.effect,
            "level": fault.level,
            "magnitude": abs(fault.magnitude) / UNITS[catalogue[fault.effect].unit][1],
            "unit": catalogue[fault.effect].unit,
            "oracle_nats": nats,
            "detectable": oracle.detectable,
            "found": fault.effect in said.get("verdict", []),
            **_measured(fault, said, case, catalogue),
        }
        for fault, nats in zip(case.faults, oracle.nats, strict=True)
    ]


def _truth(case: Case) -> list[str]:
    """What the verdict should be."""
    if case.mode == UNKNOWN:
        return [UNKNOWN]
    return sorted(f.effect for f in case.faults) or [NONE]


def _is_ordinary(case: Case, healthy: int) -> bool:
    """Whether a fault outside of the catalogue leaves no more than healthy robots do."""
    if case.mode != UNKNOWN or case.left_floors is None or case.residual_floors is None:
        return False
    most = max(HEALTHY_MORE * case.residual_floors, HEALTHY_LEAST) if healthy else ORDINARY_FLOORS
    return case.left_floors <= most


def _near(first: Fault, said: dict, case: Case, catalogue: Mapping[str, type[Effect]]) -> bool:
    """Whether what is named is near the true fault, and on one of its joints."""
    joints, named = _joints(first, case, catalogue), said.get("joints", [])
    on = not joints or not named or bool(joints & set(named))
    return on and is_near(first.effect, said.get("verdict", []))


def _tied(verdict: list[str], truth: list[str], said: dict) -> bool:
    """Whether one effect is named that the solver says it cannot tell from the true one."""
    pair = sorted([*verdict, *truth])
    return len(verdict) == 1 and pair in [sorted(tie) for tie in said.get("indistinguishable", [])]


def _left_nats(said: dict, oracle: Oracle) -> float | None:
    """By how much the solver's best fit, whatever it named, costs more than the oracle's."""
    if oracle.cost_nats is None or not said.get("ranking") or "leading" in said:
        return None
    best: dict[tuple, float] = {}
    for row in said["ranking"]:
        limb = tuple(row["limb"])
        best[limb] = min(best.get(limb, row["cost_nats"]), row["cost_nats"])
    return sum(best.values()) - oracle.cost_nats


def _written(fault: Fault, catalogue: Mapping[str, type[Effect]]) -> str:
    """A fault as on the command line; one that no catalogue has in SI units."""
    where = f"@{fault.joint}" if fault.joint else ""
    if fault.effect not in catalogue:
        return f"{fault.effect}={fault.magnitude:.3g}{where}"
    unit = catalogue[fault.effect].unit
    return f"{fault.effect}={fault.magnitude / UNITS[unit][1]:.3g}{unit}{where}"


def _top(said: dict) -> list[str]:
    """The first different effects of the ranking: by how far they improve on the nominal refit."""
    if "leading" in said:
        names = [*said.get("verdict", [])[:1], *said["leading"]]
        return [n for n in dict.fromkeys(names) if n not in (NONE, UNKNOWN)][:TOP]
    ranking = said.get("ranking", [])
    bare = {tuple(r["limb"]): r["cost_nats"] for r in ranking if r["effects"] == [NONE]}
    singles = [r for r in ranking if len(r["effects"]) == 1 and r["effects"] != [NONE]]
    singles.sort(key=lambda r: r["cost_nats"] - bare.get(tuple(r["limb"]), 0.0))
    names = [*said.get("verdict", [])[:1], *(r["effects"][0] for r in singles)]
    return [n for n in dict.fromkeys(names) if n not in (NONE, UNKNOWN)][:TOP]


def _joints(fault: Fault, case: Case, catalogue: Mapping[str, type[Effect]]) -> set[str]:
    """Joints that a fault acts on; none of what acts on the whole rig."""
    if fault.effect not in catalogue:
        return {fault.joint} if fault.joint else set()
    effect = catalogue[fault.effect](magnitude=fault.magnitude, joint=fault.joint)
    return set(effect.joints(rigs.nominal(case.rig)))


def _joints_right(
    fault: Fault, said: dict, case: Case, catalogue: Mapping[str, type[Effect]]
) -> bool | None:
    """Whether the effect was found on just its joints; None where it has none or was not named."""
    named = [m for m in said.get("magnitudes", []) if m["effect"] == fault.effect]
    joints = _joints(fault, case, catalogue)
    if not named or not joints:
        return None
    return {j for m in named for j in m["joints"]} == joints


def _measured(fault: Fault, said: dict, case: Case, catalogue: Mapping[str, type[Effect]]) -> dict:
    """Relative error of the magnitude and whether the interval holds it, on the right joints."""
    named = [m for m in said.get("magnitudes", []) if m["effect"] == fault.effect]
    right = _joints_right(fault, said, case, catalogue)
    if not named or right is False:
        return {"joints_right": right, "error": None, "covered": None}
    errors = [abs(m["magnitude"] - fault.magnitude) / abs(fault.magnitude) for m in named]
    inside = [m["interval"][0] <= fault.magnitude <= m["interval"][1] for m in named]
    return {
        "joints_right": right,
        "error": float(np.mean(errors)),
        "covered": all(inside),
    }


def frames(rows: list[dict], faults: list[dict]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows as tables, by number; without effects the second table has no rows."""
    cases = pd.DataFrame(rows).sort_values("number", ignore_index=True)
    return cases, pd.DataFrame(faults, columns=FAULT_COLUMNS)
