"""The log that `bench demo` diagnoses, and its recorder: one joint in MuJoCo with gear play.

`python -m benchmark.demo.log FOLDER` records it again.
"""

import sys
from pathlib import Path

from backends.effect import with_effects
from backends.mjcf import mechanism
from backends.shard import simulate
from benchmark.parts import registry
from benchmark.settings.effects import parse_effects
from diagnosis.logs.log import DriveSettings, Log, MjcfMechanism, make_log, write_log
from diagnosis.recording.record import Plan, record

HIDDEN = "backlash=1.5deg@elbow"
"""What was put in; the log does not say so."""
NOISE = "encoder-noise=0.1mrad"
DECIMALS = 6
"""Of positions and commands in radians; the noise is a hundred times as large."""
_XML = """\
<mujoco model="elbow">
  <worldbody>
    <body name="forearm" pos="0 0 0.4">
      <inertial mass="0.6" pos="0.12 0 0" diaginertia="0.0004 0.003 0.003"/>
      <joint name="elbow" axis="0 1 0" armature="0.01"/>
    </body>
  </worldbody>
</mujoco>
"""
_DRIVES = {"elbow": DriveSettings(kp=30.0, kd=0.6, limit=6.0)}
_PLAN = Plan(protocols=("steps", "triangle"), channels=("command", "position"), rate_hz=100.0)


def recorded() -> Log:
    """Record the log: 20 s of small and large steps and slow strokes."""
    nominal = mechanism(_XML, _DRIVES)
    real = with_effects(nominal, parse_effects(f"{HIDDEN},{NOISE}", nominal.hand))
    engine = registry.load("backend", "mujoco")
    log = record(lambda specs: simulate(engine, specs, 1), real, _PLAN, "one joint, in MuJoCo")
    mechanics = MjcfMechanism(mjcf="elbow.xml", joints=_DRIVES)
    episodes = tuple(e.model_copy(update={"note": None}) for e in log.meta.episodes)
    update = {"mechanism": mechanics, "episodes": episodes, "channels": {}}
    meta = log.meta.model_copy(update=update)
    return make_log(meta, log.samples.round(DECIMALS), _XML)


if __name__ == "__main__":
    write_log(recorded(), Path(sys.argv[1]), "csv")
