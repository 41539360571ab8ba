"""`bench excite` and `bench import`: commands for a user's robot, and published recordings."""

import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Table

from backends.effect import UNITS
from benchmark.errors import UsageError
from benchmark.parts import registry
from benchmark.settings.quantities import measured
from benchmark.settings.run_spec import RunSpec, ideal
from diagnosis.logs.log import LogError, check_target, name_of, write_log
from diagnosis.recording.excitation import FREE, Excitation, Joints, hand_joints
from files.atomic import write_atomically

_RANGE = re.compile(r"([-+0-9.eE]+):([-+0-9.eE]+)(rad|mrad|deg|m|mm)")
_FORM = "LOW:HIGH with rad, mrad, deg, m or mm, such as -60:60deg"
_HOW = (
    "play each episode from rest at this rate and log a row per sample: episode, t_s, the command "
    "columns, position columns named like them, and torque, velocity, motor and push where known; "
    "where push is not zero, load the joint with about that torque and log what it was; "
    "docs/reference/log-format.md shows the eight lines of log.yaml that go with the CSV"
)


def excite(
    out: Path,
    protocol: str,
    joints: str | None,
    ranges: str | None,
    limit: str | None,
    rate_hz: float,
    seed: int,
    one_at_a_time: bool,
    force: bool = False,
) -> dict:
    """Write commands as CSV; returns what was written. Raises UsageError."""
    if out.suffix.lower() != ".csv":
        raise UsageError(f"--out is {out}; allowed: a file name that ends in .csv")
    if out.exists() and not force:
        raise UsageError(f"{out} exists; choose another --out, or --force to replace it")
    described, linear = _joints(joints, ranges, limit)
    episodes = [FREE[p](described, rate_hz, seed) for p in _protocols(protocol, limit, joints)]
    if one_at_a_time:
        episodes = [e.alone(j) for e in episodes for j in range(len(described.names))]
    frames = [_frame(e, described.names, linear) for e in episodes]
    table = pd.concat(frames, keys=range(len(frames)), names=["episode"]).reset_index("episode")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, table.to_csv(index=False, float_format="%.9g"))
    return {
        "status": "done",
        "written": str(out),
        "joints": list(described.names),
        "episodes": [e.protocol for e in episodes],
        "seconds": round(sum(float(e.t_s[-1]) for e in episodes), 2),
        "rate_hz": rate_hz,
        "how_to_log": _HOW,
    }


def _joints(joints: str | None, ranges: str | None, limit: str | None) -> tuple[Joints, bool]:
    """The joints to move, and whether they are linear: the user's, or those of the TRX hand."""
    if joints is None:
        if ranges is not None or limit is not None:
            raise UsageError("--range and --limit need --joints; give the names of your joints")
        return hand_joints(ideal(RunSpec.hand, RunSpec.stick).hand), False
    names = tuple(name.strip() for name in joints.split(",") if name.strip())
    if not names or len(set(names)) < len(names):
        raise UsageError(f"--joints is '{joints}'; allowed: different names, separated by commas")
    if ranges is None:
        raise UsageError(f"--joints needs --range; allowed: {_FORM}, one for all or one for each")
    parts = [part.strip() for part in ranges.split(",")]
    if len(parts) not in (1, len(names)):
        raise UsageError(f"--range has {len(parts)} entries for {len(names)} joints; give 1 or all")
    read = [_range(part) for part in parts] * (len(names) // len(parts))
    if len({linear for _, linear in read}) > 1:
        raise UsageError("--range mixes angles and lengths; write one file for each kind of joint")
    ends = np.array([pair for pair, _ in read])
    return Joints(
        names=names,
        center_rad=ends.mean(axis=1),
        range_rad=ends,
        limit_nm=_limits(limit, names, read[0][1]),
    ), read[0][1]


def _limits(text: str | None, names: tuple[str, ...], linear: bool) -> np.ndarray:
    """The largest load of each joint [Nm or N]; zeros if none is given."""
    if text is None:
        return np.zeros(len(names))
    parts = [part.strip() for part in text.split(",")]
    if len(parts) not in (1, len(names)):
        raise UsageError(f"--limit has {len(parts)} entries for {len(names)} joints; give 1 or all")
    wanted = "force" if linear else "torque"
    found = [measured(part, "--limit", "N" if linear else "Nm") for part in parts]
    for part, (value, dimension) in zip(parts, found, strict=True):
        if dimension != wanted or not (math.isfinite(value) and value > 0):
            raise UsageError(f"--limit is '{part}'; allowed: a {wanted} above 0")
    return np.full(len(names), [value for value, _ in found])


def _range(text: str) -> tuple[tuple[float, float], bool]:
    """Lowest and highest target [rad or m], and whether it is a length."""
    match = _RANGE.fullmatch(text)
    try:
        low, high = (float(match.group(k)) for k in (1, 2)) if match else (math.nan, math.nan)
    except ValueError:
        low = high = math.nan
    if match is None or not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise UsageError(f"--range is '{text}'; allowed: {_FORM}, the lower end first")
    dimension, size = UNITS[match.group(3)]
    return (low * size, high * size), dimension == "length"


def _protocols(text: str, limit: str | None, joints: str | None) -> list[str]:
    """Protocols to write; without a limit, all but the push."""
    pushes = joints is None or limit is not None
    if text == "all":
        return [name for name in FREE if pushes or name != "push"]
    names = [word.strip() for word in text.split(",") if word.strip()]
    if not names or not set(names) <= set(FREE) or len(set(names)) < len(names):
        raise UsageError(
            f"--protocol is '{text}'; allowed: all, or some of {', '.join(FREE)}, each once"
        )
    if "push" in names and not pushes:
        raise UsageError("the push needs --limit, the largest drive torque [Nm] or force [N]")
    return names


def _frame(excitation: Excitation, names: tuple[str, ...], linear: bool) -> pd.DataFrame:
    columns: dict[str, object] = {"protocol": excitation.protocol, "t_s": excitation.t_s}
    for j, name in enumerate(names):
        columns[name_of("command", name, linear)] = excitation.target_rad[:, j]
    for j, name in enumerate(names):
        columns[name_of("push", name, linear)] = excitation.push_nm[:, j]
    return pd.DataFrame(columns)


def import_logs(
    kind: str, path: Path, out: Path, form: str, force: bool = False
) -> tuple[dict, Table]:
    """Write the logs of a recording of a known kind: one to `out`, several to folders in it.

    Raises UsageError.
    """
    importer = registry.load("importer", kind)()
    try:
        logs = importer.read(path)
        folders = {name: out if len(logs) == 1 else out / name for name in logs}
        for folder in folders.values():
            check_target(folder, form, force)
        for name, log in logs.items():
            write_log(log, folders[name], form, force=force)
    except LogError as error:
        raise UsageError(str(error)) from error
    written = [
        {
            "dir": str(folders[name]),
            "source": log.meta.source,
            "joints": list(log.joints),
            "episodes": len(log.episodes),
            "samples": len(log.samples),
            "said": list(log.said),
        }
        for name, log in logs.items()
    ]
    table = Table("folder", "source", "joints", "samples", "remark", header_style="bold")
    for one in written:
        remarks, joints = "; ".join(one["said"]), ", ".join(one["joints"])
        table.add_row(one["dir"], one["source"], joints, f"{one['samples']}", remarks)
    return {"status": "done", "written": written}, table
