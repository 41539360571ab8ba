"""A real side in the engine DART; no solver may be tuned on it.

Links move by DART's articulated bodies, every rotor is a body of its own. Dry friction is DART's:
a constraint that holds until it is overcome, so it sticks; viscous friction is implicit.

    i' = (sat(kp band(target - motor) - kd w) - i) / T                            the current loop
    J w' = i (1 + r sin(n motor)) - gear - viscous w - F,  |F| <= limit at rest   DART
    gear = k(motor) x + c w_x min(x / X, 1), x the teeth's depth, teeth only push
    limit = coulomb + stiction exp(-|w| / V) + load |gear| + lock where the load drives the motor

The speed w that the servo uses is the motor encoder's difference over one period of 0.2 ms.
Motor angles are logged as the servo last read them, a period before the joints'.

On top of the effects there is always a little hard play, dry friction at the rotor and in the
link's bearing, ripple of the torque, teeth that are stiffer here than there, and the current loop's
lag (`Baseline`).

DART: J. Lee et al., Journal of Open Source Software 3(22), 2018.
"""

from dataclasses import dataclass

import dartpy as dart
import numpy as np

from backends.spec import Body
from backends.state import Array
from diagnosis.blind import plant
from diagnosis.blind.mechanics import _faults
from diagnosis.blind.plant import Course, Limb

TICK_S = 2e-4
STRIBECK_RAD_S = 0.05
"""V: speed at which stiction has faded to a third."""
ROTOR_AXIS = (0.0, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """The small faults of every joint."""

    play_rad: float = 2.5e-4
    """Half play."""
    rotor_share: float = 1e-3
    """Dry friction at the rotor over the torque limit."""
    bearing_share: float = 1e-3
    """Dry friction between the links over the torque limit."""
    ripple: float = 0.01
    """Amplitude of the torque's ripple as a share of it."""
    mesh: float = 0.05
    """Amplitude of the teeth's stiffness as a share of it."""
    per_rad: float = 63.0
    """Angular frequency of both: ten teeth through a gear of some 40 turn as fast as six poles."""
    soft_rad: float = 1e-4
    """X: depth from which teeth damp in full."""
    current_s: float = 1e-4
    """T: time constant of the current loop."""


class Mechanics(plant.Mechanics):
    """Limbs of any number of hinges."""

    tick_s: float = TICK_S

    def __init__(self, baseline: Baseline | None = None) -> None:
        self._baseline = baseline or Baseline()

    def __call__(self, limb: Limb, wanted_rad: Array, push_nm: Array) -> Course:
        """Angles at every tick, motor angles and torques at every sample; see the protocol."""
        return _World(limb, self._baseline).run(wanted_rad, push_nm)


class _World:
    """A limb and its rotors in DART, with a servo per joint."""

    def __init__(self, limb: Limb, baseline: Baseline) -> None:
        self._base, self._numbers = baseline, limb.numbers
        self._nominal_nm = [b.joint.drive.torque_limit_nm for b in limb.bodies if b.joint.drive]
        self._world = dart.simulation.World()
        self._world.setTimeStep(TICK_S)
        self._world.setGravity(limb.gravity_m_s2)
        awake = dart.simulation.DeactivationOptions()
        awake.mEnabled = False  # DART puts what rests for half a second to sleep, friction or not
        self._world.setDeactivationOptions(awake)
        self._chain = dart.dynamics.Skeleton("limb")
        self._links, self._lifts = [], []
        node = None
        for body in limb.bodies:
            joint, node = _link(self._chain, node, body)
            self._links.append(joint)
            lift = -body.carried * body.mass_kg * np.array(limb.gravity_m_s2)
            self._lifts.append((node, lift, body.com_m))
        for joint, limit in zip(self._links, self._nominal_nm, strict=True):
            joint.setCoulombFriction(0, baseline.bearing_share * limit)
        self._world.addSkeleton(self._chain)
        self._rotors = [
            self._rotor(inertia, viscous)
            for inertia, viscous in zip(limb.numbers["rotor"], limb.numbers["viscous"], strict=True)
        ]

    def _rotor(self, inertia_kgm2: float, viscous_nms_rad: float) -> dart.dynamics.RevoluteJoint:
        skeleton = dart.dynamics.Skeleton(f"rotor {self._world.getNumSkeletons()}")
        joint, node = skeleton.createRevoluteJointAndBodyNodePair()
        joint.setAxis(ROTOR_AXIS)
        joint.setDampingCoefficient(0, viscous_nms_rad)
        node.setGravityMode(False)
        node.setMomentOfInertia(inertia_kgm2, inertia_kgm2, inertia_kgm2, 0.0, 0.0, 0.0)
        self._world.addSkeleton(skeleton)
        return joint

    def run(self, wanted_rad: Array, push_nm: Array) -> Course:
        """The course from rest at `wanted_rad[0]`."""
        joints, samples = len(self._links), len(push_nm)
        steps = (len(wanted_rad) - 1) // (samples - 1)
        angle = np.zeros(wanted_rad.shape)
        motor, torque = np.zeros(push_nm.shape), np.zeros(push_nm.shape)
        servos = [self._servo(j, float(wanted_rad[0, j])) for j in range(joints)]
        wanted, push = wanted_rad.tolist(), push_nm.tolist()
        for tick in range(len(wanted_rad)):
            angle[tick] = self._chain.getPositions()
            sample, left = divmod(tick, steps)
            if left == 0:
                motor[sample] = [servo.motor_rad for servo in servos]
                torque[sample] = [servo.current_nm for servo in servos]
            if tick + 1 < len(wanted_rad):
                for j, servo in enumerate(servos):
                    servo.drive(wanted[tick][j], push[sample][j])
                for node, lift, center in self._lifts:
                    node.addExtForce(lift, center, False, True)
                self._world.step()
        return angle, motor, torque

    def _servo(self, j: int, start_rad: float) -> "_Servo":
        self._links[j].setPosition(0, start_rad)
        self._rotors[j].setPosition(0, start_rad)
        numbers = {name: float(values[j]) for name, values in self._numbers.items()}
        return _Servo(numbers, self._base, self._nominal_nm[j], self._links[j], self._rotors[j])


class _Servo:
    """The servo, current loop, teeth and friction of one joint."""

    def __init__(
        self,
        numbers: dict[str, float],
        baseline: Baseline,
        nominal_nm: float,
        link: dart.dynamics.RevoluteJoint,
        rotor: dart.dynamics.RevoluteJoint,
    ) -> None:
        self._n, self._base = numbers, baseline
        self._link, self._rotor = link, rotor
        self._play_rad = numbers["play"] + baseline.play_rad
        self._dry_nm = numbers["coulomb"] + baseline.rotor_share * nominal_nm
        self._keeps = float(np.exp(-TICK_S / baseline.current_s)) if baseline.current_s else 0.0
        self.motor_rad: float = rotor.getPosition(0)
        """The encoder's last reading."""
        self.current_nm = 0.0
        """The current, as the torque that it would give without ripple."""
        self._heat = 0.0

    def drive(self, wanted_rad: float, push_nm: float) -> None:
        """Put the forces of one tick on rotor and link."""
        n, base, rotor, link = self._n, self._base, self._rotor, self._link
        motor, speed = rotor.getPosition(0), rotor.getVelocity(0)
        read = (motor - self.motor_rad) / TICK_S
        self.motor_rad = motor
        error = wanted_rad - motor
        error -= min(max(error, -n["dead"]), n["dead"])
        asked = min(max(n["kp"] * error - n["kd"] * read, -n["limit"]), n["limit"])
        self.current_nm = asked + self._keeps * (self.current_nm - asked)
        self.current_nm = _faults.reached(self.current_nm, speed, n["limit"], n["emf"])
        turn = np.sin(base.per_rad * motor)
        pushed = self.current_nm * (1 + base.ripple * turn)
        if n["fade"] or n["cogging"]:
            self._heat = _faults.warmed(self._heat, self.current_nm / n["limit"], TICK_S)
            pushed *= _faults.faded(n["fade"], self._heat)
            pushed += _faults.cogged(n["cogging"], motor)
        gear = self._teeth(
            motor - link.getPosition(0), speed - link.getVelocity(0), 1 + base.mesh * turn
        )
        free = speed + TICK_S / n["rotor"] * (pushed - gear)
        held = self._dry_nm + n["stiction"] * np.exp(-abs(speed) / STRIBECK_RAD_S)
        held += n["load"] * abs(gear) + _faults.one_way(n["uneven"], speed)
        if free * gear < 0.0 and free * pushed <= 0.0:
            held += n["lock"]
        rotor.setCoulombFriction(0, held)
        rotor.setForce(0, pushed - gear)
        angle = link.getPosition(0)
        if n["stop"]:
            stop = (n[name] for name in ("stop", "lower", "upper", "kp", "kd"))
            push_nm += _faults.stopped(angle, link.getVelocity(0), *stop)
        link.setForce(0, gear + push_nm)

    def _teeth(self, bend_rad: float, rate_rad_s: float, stiffer: float) -> float:
        """The torque of the flank that touches; none pulls."""
        depth = abs(bend_rad) - self._play_rad
        if depth <= 0.0:
            return 0.0
        side = 1.0 if bend_rad > 0.0 else -1.0
        wet = min(depth / self._base.soft_rad, 1.0) if self._base.soft_rad else 1.0
        force = stiffer * self._n["stiffness"] * depth
        force += wet * self._n["damping"] * side * rate_rad_s
        return side * max(force, 0.0)


def _link(
    chain: dart.dynamics.Skeleton, carrier: dart.dynamics.BodyNode | None, body: Body
) -> tuple[dart.dynamics.RevoluteJoint, dart.dynamics.BodyNode]:
    """A hinge and its link at the end of a chain; frames are parallel at the zero pose."""
    carried = () if carrier is None else (carrier,)
    joint, node = chain.createRevoluteJointAndBodyNodePair(*carried)
    place = dart.math.Isometry3()
    place.set_translation(body.origin_m)
    joint.setTransformFromParentBodyNode(place)
    joint.setAxis(body.joint.axis)
    node.setMass(body.mass_kg)
    node.setLocalCOM(body.com_m)
    node.setMomentOfInertia(*body.inertia_kgm2, *body.products_kgm2)
    return joint, node
