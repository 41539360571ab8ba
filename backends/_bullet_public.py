"""Step Bullet by pybullet's public calls: the functions of `_bullet_calls`, for any wheel."""

from backends._bullet_quiet import p
from backends._calls import motor_step
from backends.state import Array


def pointer(client: int) -> int:
    """What the calls below take for the client with this number: the number."""
    return client


def rollout(
    clients: Array,
    hands: Array,
    places: Array,
    torque: Array,
    angle: Array,
    speed: Array,
    sticks: Array,
    carried: Array,
    force: Array,
) -> None:
    """See `_bullet_calls.rollout`."""
    for n, (client, hand) in enumerate(zip(clients.tolist(), hands.tolist(), strict=True)):
        joints, stick = places[n, 2].tolist(), int(sticks[n])
        for tick in range(torque.shape[1]):
            if tick < carried[n]:
                _push(client, stick, force[n].tolist())
            _step(client, hand, joints, torque[n, tick])
            _read(client, hand, joints, angle[n], speed[n])


def drive(
    clients: Array,
    hands: Array,
    places: Array,
    args: int,
    ticks: int,
    angle: Array,
    speed: Array,
    sticks: Array,
    carried: Array,
    force: Array,
) -> None:
    """See `_bullet_calls.drive`."""
    for n, (client, hand) in enumerate(zip(clients.tolist(), hands.tolist(), strict=True)):
        joints, stick = places[n, 2].tolist(), int(sticks[n])
        for tick in range(ticks):
            if tick < carried[n]:
                _push(client, stick, force[n].tolist())
            _step(client, hand, joints, motor_step(args, n, tick, angle[n], speed[n]))
            _read(client, hand, joints, angle[n], speed[n])


def read_sticks(
    clients: Array, sticks: Array, pos: Array, quat_wxyz: Array, vel: Array, omega: Array
) -> None:
    """See `_bullet_calls.read_sticks`."""
    for n, (client, stick) in enumerate(zip(clients.tolist(), sticks.tolist(), strict=True)):
        pos[n], (x, y, z, w) = p.getBasePositionAndOrientation(stick, client)
        quat_wxyz[n] = w, x, y, z
        vel[n], omega[n] = p.getBaseVelocity(stick, client)


def read_contacts(clients: Array, hands: Array, sticks: Array, tip_of_link: Array) -> list[tuple]:
    """See `_bullet_calls.read_contacts`."""
    rows = []
    for n, (client, hand, stick) in enumerate(zip(clients, hands, sticks, strict=True)):
        for touch in p.getContactPoints(int(hand), int(stick), physicsClientId=int(client)):
            link, first, second, normal, load = (touch[i] for i in (3, 5, 6, 7, 9))
            moment = (load * (a + b) / 2 for a, b in zip(first, second, strict=True))
            rows.append((n, tip_of_link[link], load, *moment, *(load * i for i in normal)))
    return rows


def _push(client: int, stick: int, force_n: list[float]) -> None:
    """Apply a force, world frame, at the stick's centre during the next step."""
    center, _ = p.getBasePositionAndOrientation(stick, client)
    p.applyExternalForce(stick, -1, force_n, center, p.WORLD_FRAME, client)


def _step(client: int, hand: int, joints: list[int], torque: Array) -> None:
    """Step one world once under joint torques (J,)."""
    kind = p.TORQUE_CONTROL
    p.setJointMotorControlArray(hand, joints, kind, forces=torque.tolist(), physicsClientId=client)
    p.stepSimulation(client)


def _read(client: int, hand: int, joints: list[int], angle: Array, speed: Array) -> None:
    """Read the joints of one world."""
    for j, state in enumerate(p.getJointStates(hand, joints, client)):
        angle[j], speed[j] = state[:2]
