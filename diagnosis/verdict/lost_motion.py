"""Play by lost motion: where a held joint rests when it is pushed either way, and after that.

For logs whose samples are so far apart that no replay follows them (`evidence.SLOW_S`). Without
play a push P sets a joint of gain kp, teeth k and Coulomb friction f to either side by no more than

    (P - f) / kp + P / k     while it lasts, P / k where f > P
    min(f, P - f) / kp       after it, 0 where f > P

so friction takes from the one what it adds to the other. A play of 2h adds 2h to what lies between
the sides while the push lasts, and at most that after it. With L, the lost motion, between them:

    (L_pushed + L_released) / 2 - P (1 / kp + 1 / k)  <=  2h  <=  L_pushed - 2 P / k

It is the lower end where the drive yields, the upper one where friction holds the motor still:
without the motor's angle a log does not say which, so that its size is the one that the nominal
friction makes it. A loop that is closed on the joint pulls a part of the play back; there the lower
end holds. A dead zone of the drive shows as play does. What is
softer than nominal leaves no lost motion after a push.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from backends.catalogue import Catalogue, of_part
from diagnosis.evidence.evidence import Evidence
from diagnosis.motion.columns import COULOMB, KP, STIFFNESS
from diagnosis.motion.presses import Press, places, presses
from diagnosis.motion.recordings import Recording
from diagnosis.verdict.result import Z90, LimbResult, cause

PLAY, DEAD_ZONE = "drive.play_rad", "drive.dead_zone_rad"
SURE_Z = 3.5
"""Play is named so many standard deviations from none."""
HARD = 0.9
"""A push counts while it is this share of its largest."""
LEAST_REST = 4
"""Readings from the end of a push to what comes next; the later half of them counts."""
WHEN = ["pushed", "released"]
MOTOR_ANGLE = "log the motor's angle as well"


def with_play(
    result: LimbResult, evidence: Evidence, catalogue: Catalogue, uncertainty: float
) -> LimbResult:
    """The result of a slow log, of play alone where rests show play that friction is not.

    `uncertainty`: of gains and teeth, relative. Other logs' results stay as they are.
    """
    names = of_part(catalogue, "drive")
    if not evidence.only_rests or PLAY not in names:
        return result
    each = (play(evidence, j, uncertainty) for j in range(len(evidence.joints)))
    found = [one for one in each if one is not None]
    if not found:
        return result
    effect = names[PLAY]
    causes = tuple(
        cause(
            effect,
            (one.half_rad, *one.interval_rad),
            catalogue,
            joints=(one.joint,),
            share=one.share,
            at=evidence.place(evidence.joints.index(one.joint)),
        )
        for one in found
    )
    before, after = (max(getattr(one, name) for one in found) for name in ("before", "after"))
    return replace(
        result,
        verdict=(effect,),
        causes=causes,
        leading=causes,
        share=min(one.share for one in found),
        gap_nominal=before,
        left=after,
        tied=tuple((f"{names[DEAD_ZONE]}@{one.joint}",) for one in found if DEAD_ZONE in names),
        experiment=MOTOR_ANGLE,
        nominal=(),
        rested={one.joint: {PLAY: one.half_rad} for one in found},
    )


@dataclass(frozen=True, kw_only=True)
class Play:
    """The half play of a joint that no friction makes up."""

    joint: str
    half_rad: float
    """With which the nominal drive would show the same."""
    interval_rad: tuple[float, float]
    before: float
    """Gap of all rests from those of the nominal drive [floors]."""
    after: float
    """The same from their side's mean."""

    @property
    def share(self) -> float:
        """Share of the squared gap beyond one floor that it takes."""
        return 1.0 - max(self.after**2 - 1.0, 0.0) / max(self.before**2 - 1.0, 1e-9)


def play(evidence: Evidence, j: int, uncertainty: float) -> Play | None:
    """The play of joint `j`; None where friction may make up its lost motion."""
    found, numbers = rests(evidence, j), evidence.limb.nominal[j]
    if found.empty:
        return None
    sigma_rad = float(evidence.floor[0, j])
    pushed, released = lost_motion(found)
    push_nm = found["push_nm"].mean()
    give = 0.0 if evidence.limb.rigid else push_nm / numbers[STIFFNESS]
    yields = push_nm / numbers[KP] + give
    low, high = (pushed + released) / 2 - yields, pushed - 2 * give
    sides = found.groupby("side")[WHEN]
    variances = sides.var(ddof=0).clip(lower=sigma_rad**2).div(sides.size(), axis=0).sum()
    error = float(np.hypot(np.sqrt(variances.sum()) / 2, uncertainty * yields))
    if min(low / error, released / np.sqrt(variances["released"])) < SURE_Z:
        return None
    usual = np.outer(2 * found["side"] - 1, [yields, 0.0])
    before, after = (
        float(np.sqrt(np.mean((found[WHEN] - at).to_numpy() ** 2))) / sigma_rad
        for at in (usual, sides.transform("mean"))
    )
    return Play(
        joint=evidence.joints[j],
        half_rad=(low if push_nm > numbers[COULOMB] else high) / 2,
        interval_rad=(max(low - Z90 * error, 0.0) / 2, (high + Z90 * error) / 2),
        before=before,
        after=after,
    )


def lost_motion(found: pd.DataFrame) -> pd.Series:
    """Between `rests` on either side [rad], while pushed and after it: mean over the positions."""
    means = found.groupby(["side", "place"])[WHEN].mean().groupby("side").mean()
    return means.loc[1] - means.loc[0]


def rests(evidence: Evidence, j: int) -> pd.DataFrame:
    """Where joint `j` rests that is pushed one way and let go, at positions pushed both ways.

    A row per press: its `side`, `push_nm`, where the joint is about its command while it is
    `pushed` and when it is `released` [rad], and the number of the `place` that is held.
    """
    found = [one for recording in evidence.limb.recordings for one in _rests_of(recording, j)]
    rows = pd.DataFrame([row for _, row in found], columns=["side", "push_nm", *WHEN])
    groups = enumerate(places([press for press, _ in found]))
    of_place = {k: float(number) for number, group in groups for k in group}
    return rows.assign(place=pd.Series(of_place, dtype=float)).dropna()


def _rests_of(
    recording: Recording, j: int
) -> Iterator[tuple[Press, tuple[int, float, float, float]]]:
    """Press by press; a push shows in the reading after its row."""
    load, reading = recording.push[:, j], recording.measured[:, 0, j]
    for press in presses(recording.command[:, j], load):
        let_go, end = press.released.start, press.released.stop
        if end - let_go >= LEAST_REST:
            hard = press.hard(load, HARD)
            both = reading[hard + 1], reading[(let_go + end) // 2 : end]
            under, after = (float(np.median(part) - press.held_rad) for part in both)
            yield press, (press.side, float(np.abs(load[hard]).mean()), under, after)
