"""Compare answers and verdicts: one row per case, and one per true effect."""

import numpy as np
import pandas as pd

from backends.catalogue import catalogue
from backends.effect import UNITS
from diagnosis.blind import rigs
from diagnosis.blind.draw import Case
from diagnosis.blind.faults import Fault
from diagnosis.blind.near import is_near, plain_names
from diagnosis.blind.oracle import Oracle, Shown
from diagnosis.verdict.ordinary import HEALTHY_LEAST, HEALTHY_MORE

NONE, UNKNOWN = "none", "unknown"
TOP = 3
ORDINARY_FLOORS = 4.0
"""Ordinary gap of healthy robots; with less than this left, both `none` and `unknown` are right."""
FAULT_COLUMNS = (
    *("number", "mode", "real", "rig", "protocols", "channels", "effect", "level", "magnitude"),
    *("unit", "oracle_floors", "detectable", "found", "joints_right", "error", "covered"),
)


def case_row(case: Case, said: dict, oracle: Oracle, healthy: int = 0) -> dict:
    """One case: the truth, the solver's verdict, and where it is right."""
    verdict = said.get("verdict", ["refused"])
    truth = _truth(case)
    names = [f.effect for f in case.faults]
    first = case.faults[0] if case.faults else None
    beyond = oracle.beyond and not is_ordinary(case, healthy)
    right, near = rightness(case, said, beyond)
    return _of_case(case) | {
        "truth": " + ".join(truth),
        "hidden": "; ".join(_written(f) for f in case.faults),
        "excluded": ", ".join(case.excluded),
        "level": first.level if first else None,
        "oracle_floors": min(
            (s.floors for s in oracle.shown if s.floors is not None), default=None
        ),
        "oracle_nats": min((s.nats for s in oracle.shown if s.nats is not None), default=None),
        "detectable": beyond if case.mode == UNKNOWN else oracle.detectable,
        "verdict": " + ".join(sorted(verdict)),
        "right": right,
        "right_or_tied": right or _tied(verdict, truth, said),
        "near": near,
        "right_or_near": right or near,
        "residual_floors": case.residual_floors,
        "left_floors": case.left_floors,
        "accuses": not {NONE, UNKNOWN, "refused"} >= set(verdict),
        "one_of": bool(set(names) & set(verdict)),
        "spurious": bool(set(names) & set(verdict)) and bool(set(verdict) - set(names)),
        "in_top": bool(names) and names[0] in _top(said),
        "joints_right": _joints_right(first, said, case) if first else None,
        "confidence": said.get("confidence"),
        "gap": said.get("gap_nominal"),
        "gap_oracle": oracle.gap,
        "left": said.get("left"),
        "left_oracle": oracle.left,
        "share": said.get("share"),
        "share_oracle": oracle.share,
        "first": next(iter(said.get("leading", [])), None),
        "catalogue": len(catalogue()) - len(said["excluded"]),
        "cpu_s": said.get("cpu_s"),
        "refused": said["refused"],
        "wrong": not right,
        "says_none": verdict == [NONE],
        "shrinkage_ratio": said["share"] / oracle.share
        if said.get("share") is not None and (oracle.share or 0.0) > 0.0
        else None,
    }


def rightness(case: Case, said: dict, beyond: bool) -> tuple[bool, bool]:
    """Whether a verdict is right, and whether it is near the true fault instead.

    `beyond`: whether a fault outside of the catalogue leaves more than is ordinary; else `none` is
    right as well.
    """
    verdict = said.get("verdict", ["refused"])
    right = sorted(verdict) == _truth(case)
    if rigs.robot(case.rig) is not None:
        named, true = (plain_names(names, case.channels) for names in (verdict, _truth(case)))
        right = named == true
    unknown = case.mode == UNKNOWN and bool(case.faults)
    right = right or (unknown and not beyond and verdict == [NONE])
    return right, unknown and _near(case.faults[0], said, case)


def fault_rows(case: Case, said: dict, oracle: Oracle) -> list[dict]:
    """One row per true effect of a case that its solver could name."""
    if case.mode not in ("single", "pair"):
        return []
    return [
        _of_case(case)
        | {
            "effect": fault.effect,
            "level": fault.level,
            "magnitude": abs(fault.magnitude) / UNITS[catalogue()[fault.effect].unit][1],
            "unit": catalogue()[fault.effect].unit,
            "oracle_floors": shown.floors,
            "detectable": oracle.detectable,
            "found": fault.effect in said.get("verdict", []),
            **_measured(fault, said, case),
        }
        for fault, shown in zip(case.faults, oracle.shown or [Shown()] * 2, strict=False)
    ]


def _of_case(case: Case) -> dict:
    return {
        "number": case.number,
        "mode": case.mode,
        "real": case.real,
        "rig": rigs.family(case.rig),
        "channels": "+".join(case.channels),
        "protocols": "+".join(case.protocols),
    }


def _truth(case: Case) -> list[str]:
    """What the verdict should be."""
    if case.mode == UNKNOWN:
        return [UNKNOWN]
    return sorted(f.effect for f in case.faults) or [NONE]


def is_ordinary(case: Case, healthy: int) -> bool:
    """Whether a drawn robot's fault outside of the catalogue leaves no more than is ordinary."""
    if case.mode != UNKNOWN or case.left_floors is None or case.residual_floors is None:
        return False
    most = max(HEALTHY_MORE * case.residual_floors, HEALTHY_LEAST) if healthy else ORDINARY_FLOORS
    return case.left_floors <= most


def _near(first: Fault, said: dict, case: Case) -> bool:
    """Whether what is named is near the true fault, and on one of its joints."""
    joints, named = _joints(first, case), said.get("joints", [])
    on = not joints or not named or bool(joints & set(named))
    return on and is_near(first.effect, said.get("verdict", []))


def _tied(verdict: list[str], truth: list[str], said: dict) -> bool:
    """Whether one effect is named that the solver says it cannot tell from the true one."""
    pair = sorted([*verdict, *truth])
    return len(verdict) == 1 and pair in [sorted(tie) for tie in said.get("indistinguishable", [])]


def _written(fault: Fault) -> str:
    """A fault as on the command line; one that no catalogue has in SI units."""
    where = f"@{fault.joint}" if fault.joint else ""
    if fault.effect not in catalogue():
        return f"{fault.effect}={fault.magnitude:.3g}{where}"
    unit = catalogue()[fault.effect].unit
    return f"{fault.effect}={fault.magnitude / UNITS[unit][1]:.3g}{unit}{where}"


def _top(said: dict) -> list[str]:
    """The first different effects: what is named first, and the causes that lead."""
    names = [*said.get("verdict", [])[:1], *said.get("leading", [])]
    return [n for n in dict.fromkeys(names) if n not in (NONE, UNKNOWN)][:TOP]


def _joints(fault: Fault, case: Case) -> set[str]:
    """Joints that a fault acts on; none of what acts on the whole rig."""
    if fault.effect not in catalogue():
        return {fault.joint} if fault.joint else set()
    effect = catalogue()[fault.effect](magnitude=fault.magnitude, joint=fault.joint)
    return set(effect.joints(rigs.nominal(case.rig)))


def _joints_right(fault: Fault, said: dict, case: Case) -> bool | None:
    """Whether the effect was found on just its joints; None where it has none or was not named."""
    named = [m for m in said.get("magnitudes", []) if m["effect"] == fault.effect]
    joints = _joints(fault, case)
    if not named or not joints:
        return None
    return {j for m in named for j in m["joints"]} == joints


def _measured(fault: Fault, said: dict, case: Case) -> dict:
    """Relative error of the magnitude and whether the interval holds it, on the right joints."""
    named = [m for m in said.get("magnitudes", []) if m["effect"] == fault.effect]
    right = _joints_right(fault, said, case)
    if not named or right is False:
        return {"joints_right": right, "error": None, "covered": None}
    errors = [abs(m["magnitude"] - fault.magnitude) / abs(fault.magnitude) for m in named]
    inside = [m["interval"][0] <= fault.magnitude <= m["interval"][1] for m in named]
    return {"joints_right": right, "error": float(np.mean(errors)), "covered": all(inside)}


def frames(rows: list[dict], faults: list[dict]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows as tables, by number; without effects the second table has no rows."""
    cases = pd.DataFrame(rows).sort_values("number", ignore_index=True)
    return cases, pd.DataFrame(faults, columns=FAULT_COLUMNS)
