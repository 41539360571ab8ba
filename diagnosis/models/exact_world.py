"""A limb's world by the replay of our drive law that no expansion about the motion takes part in.

It is what an engine would do, tick by tick: where play rattles, only it follows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.evidence.evidence import Evidence
from diagnosis.models.parameters import Parameter
from diagnosis.models.world import World
from diagnosis.motion.along import turned
from diagnosis.motion.columns import by_name, with_numbers
from diagnosis.motion.limb import block_means
from diagnosis.motion.recordings import CHANNELS
from diagnosis.replay import lanes
from diagnosis.replay.replay import Batch, Commands, is_closed, replays


def world(evidence: Evidence, parameters: Sequence[Parameter], exact: bool) -> World:
    """A limb's world: where its law is ours, as exact as an engine is, if it has a closed form."""
    limb = evidence.limb
    kind = ExactWorld if exact and not limb.rigid and is_closed(limb.spec) else World
    return kind(evidence, parameters)


class ExactWorld(World):
    """See `World`; of limbs with two-mass drives alone that have a closed form."""

    def blocks(self, u: Mapping[int, float], nudge: float = 0.0) -> Array:
        """See `World.blocks`."""
        self.runs += 1
        limb = self.evidence.limb
        batch = replace(self._commands, start=self._commands.start + nudge * self.evidence.size)
        episodes = replays(self._spec(*self.numbers(u)), batch)
        rows = [lanes.CHANNELS.index(name) for name in CHANNELS]
        pairs = zip(episodes, limb.edges, strict=True)
        means = (block_means(shown[rows].transpose(1, 0, 2), edges) for shown, edges in pairs)
        return np.concatenate(list(means))

    @cached_property
    def _commands(self) -> Batch:
        limb = self.evidence.limb
        return Batch.of(
            [
                Commands(
                    ticks=np.round(one.time_s / limb.dt).astype(np.int64),
                    target=one.command,
                    load=one.push,
                    start=one.start,
                )
                for one in limb.recordings
            ]
        )

    def _spec(self, numbers: Array, tilt: Array) -> Spec:
        """The limb with these numbers of its joints and gravity turned by `tilt`."""
        spec = self.evidence.limb.spec
        other = replace(spec, gravity_m_s2=turned(spec.gravity_m_s2, tilt))
        joints = spec.hand.joint_names
        return with_numbers(other, dict(zip(joints, map(by_name, numbers), strict=True)))
