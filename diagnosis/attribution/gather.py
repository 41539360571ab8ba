"""What a log says of every limb, as the evidence that candidates are held against."""

import warnings
from collections.abc import Sequence

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.evidence import USED, Evidence, Recording
from diagnosis.logs.log import Log, LogError
from diagnosis.replay.parts import limbs
from diagnosis.replay.replay import Commands

FREE_AIR = ("steps", "triangle", "multisine", "push", "free")
"""Protocols without a stick in the hand."""
LEAST_SAMPLES = 100
"""An episode shorter than this is left out."""
LEAST_S = 2.5
"""Less free air than this does not tell causes apart [s]: 1 and 2 s made a play `unknown`."""
RATE_HZ = 200.0
"""Faster logs are compared this often: joints do nothing quicker."""
REST_SAMPLES = 3
"""The start is the mean of so many readings at rest."""
NOISY, HIDDEN_SD = 2.0, 3.0
"""That is too noisy beyond so many floors, and hides what is nearer to the target than this."""


def gather(log: Log, nominal: Spec, floor: dict[str, float]) -> tuple[Evidence, ...]:
    """The evidence for every limb of the nominal world.

    `floor` is the model's own error per channel: radians, and of torques a share of the limit.
    Raises LogError where the log lacks a joint or has no usable episode.
    """
    require_joints(log, nominal)
    numbers = [
        e.episode
        for e in log.episodes
        if e.protocol in FREE_AIR and len(_rows(log, nominal, e.episode)[0]) >= LEAST_SAMPLES
    ]
    if not numbers:
        raise LogError(
            f"not identifiable from this log: no free-air episode of {LEAST_SAMPLES} samples or "
            f"more, one per drive period; record {', '.join(FREE_AIR[:4])}"
        )
    lasts_s = sum(_lasts_s(log, number) for number in numbers)
    if lasts_s < LEAST_S:
        raise LogError(
            f"not identifiable from this log: {lasts_s:.1f} s in free air, allowed: from "
            f"{LEAST_S:g} s; record {', '.join(FREE_AIR[:4])}"
        )
    return tuple(_limb(log, part, numbers, floor) for part in limbs(nominal))


def require_joints(log: Log, nominal: Spec) -> None:
    """Raise LogError where the log lacks a joint of the nominal world."""
    missing = [name for name in nominal.hand.joint_names if name not in log.joints]
    if missing:
        raise LogError(
            f"this log has no commands for {', '.join(missing)}; it has: {', '.join(log.joints)}; "
            "record every joint"
        )


def _limb(log: Log, nominal: Spec, numbers: list[int], floor: dict[str, float]) -> Evidence:
    judged = _judged(log, numbers)
    recordings = tuple(_recording(log, nominal, n, judged[n], floor["position"]) for n in numbers)
    size = _sizes(nominal, recordings)
    limit = np.array([drive.torque_limit_nm for drive in nominal.drives])
    allowed = np.stack([floor[name] * (limit if name == "torque" else size) for name in USED])
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice")  # a channel that nobody logged
        noise = np.nanmedian([_noise(r.measured) for r in recordings], axis=0)
    sigma = np.sqrt(np.nan_to_num(noise) ** 2 + allowed**2)
    period = np.median(np.diff(recordings[0].commands.ticks)) * nominal.timing.drive_s
    return Evidence(
        nominal=nominal,
        recordings=recordings,
        sigma=sigma[:, None, :],
        floor=allowed[:, None, :],
        size=size,
        stride=max(1, round(1 / (RATE_HZ * period))),
    )


def _sizes(nominal: Spec, recordings: Sequence[Recording]) -> Array:
    """See `Evidence.size`."""
    position = np.concatenate([r.measured[0] for r in recordings])
    moved = np.maximum(np.nanmax(position, axis=0) - np.nanmin(position, axis=0), 1e-9)
    slides = [body.joint.slides for body in nominal.hand.driven]
    return np.where(slides, moved, 1.0)


def _start(measured: Array, target: Array, floor: float) -> Array:
    """Where joints rest before they move (J,), of channels (C, T, J) and the first targets (J,).

    As read; or at the target, where noise hides whether they are there: three readings of 5 mrad of
    noise would put a joint off by 3 mrad, which its motor then shows for a tenth of a second.
    """
    read = measured[0, :REST_SAMPLES].mean(axis=0)
    std = _noise(measured)[0] / np.sqrt(REST_SAMPLES)
    hidden = (std > NOISY * floor) & (np.abs(read - target) < HIDDEN_SD * std)
    return np.where(hidden, target, read)


def _recording(log: Log, nominal: Spec, number: int, judged: Array, floor_rad: float) -> Recording:
    names, (ticks, rows) = nominal.hand.joint_names, _rows(log, nominal, number)
    frame = log.episode(number).iloc[rows]

    def read(kind: str) -> Array:
        blank = np.full(len(frame), np.nan)
        columns = [log.column(kind, n) if log.has(kind, n) else None for n in names]
        return np.stack([blank if c is None else frame[c].to_numpy(float) for c in columns], axis=1)

    measured = np.stack([read(kind) for kind in USED])
    command = read("command")
    commands = Commands(
        ticks=ticks,
        target=command,
        load=np.nan_to_num(read("push")),
        start=_start(measured, command[0], floor_rad),
    )
    protocol = next(e.protocol for e in log.episodes if e.episode == number)
    return Recording(protocol=protocol, commands=commands, measured=measured, judged=judged[rows])


def _lasts_s(log: Log, number: int) -> float:
    """From the first sample of an episode to the last [s]."""
    return float(np.ptp(log.episode(number)["t_s"]))


def _rows(log: Log, nominal: Spec, number: int) -> tuple[Array, Array]:
    """Drive periods in which an episode has rows, and the first row of each; both (T,).

    Of what follows within the same period a replay knows nothing.
    """
    time_s = log.episode(number)["t_s"].to_numpy(float)
    ticks = np.round((time_s - time_s[0]) / nominal.timing.drive_s).astype(np.int64)
    return np.unique(ticks, return_index=True)


def _judged(log: Log, numbers: list[int]) -> dict[int, Array]:
    """Which samples judge: every second episode of a protocol, or the end of its only one."""
    seen: dict[str, int] = {}
    counts: dict[str, int] = {}
    protocol = {e.episode: e.protocol for e in log.episodes}
    for number in numbers:
        counts[protocol[number]] = counts.get(protocol[number], 0) + 1
    masks = {}
    for number in numbers:
        name, length = protocol[number], len(log.episode(number))
        seen[name] = seen.get(name, 0) + 1
        if counts[name] > 1:
            masks[number] = np.full(length, seen[name] % 2 == 0)
        else:
            masks[number] = np.arange(length) >= 0.6 * length
    return masks


def _noise(measured: Array) -> Array:
    """White noise of a recording (C, J): third differences take smooth motion away."""
    third = np.diff(measured, n=3, axis=1)
    return np.median(np.abs(third), axis=1) / 0.6745 / np.sqrt(20.0)
