"""Step Bullet from compiled code through its C interface, without Python in between.

A pybullet call costs 3.5 us on top of a step of 19 us. Most of that time goes into building tuples
and taking them apart. The same library exports the C interface below these calls. Every C function
takes the client's pointer as its first argument. The library does not export that pointer, so it is
looked up in the symbol table.
"""

import ctypes

import numba
import numpy as np
from numba.core import types

from backends._calls import address, array_at, find, function, motor_step
from backends.state import Array

_CLIENTS = "sPhysicsClients1"
"""pybullet's table of clients, indexed by client number (examples/pybullet/pybullet.c)."""
_SUBMIT = "b3SubmitClientCommandAndWaitStatus"
_TORQUE_CONTROL, _BASE, _WORLD_FRAME = 1, -1, 2
_MOST_NUMBERS = 128
"""Bullet's own limit on coordinates; a hand has fewer."""
_MOST_CONTACTS = 32
"""Largest number of contacts between hand and stick; four per fingertip are rare."""
_CONTACT_WORDS, _LINK, _FIRST_AT, _SECOND_AT, _NORMAL, _LOAD = 22, 3, 3, 6, 9, 13
"""Size of a `b3ContactPointData` in 64-bit words, and the place of each field; the link takes half
a word."""
_SECTION = np.dtype(
    {
        "names": ["type", "offset", "size", "link"],
        "formats": ["<u4", "<u8", "<u8", "<u4"],
        "offsets": [4, 24, 32, 40],
        "itemsize": 64,
    }
)
"""The fields that are read from a section header of a 64-bit ELF file."""
_SYMBOL = np.dtype(
    {"names": ["name", "value"], "formats": ["<u4", "<u8"], "offsets": [0, 8], "itemsize": 24}
)
_SYMBOL_TABLE = 2
"""Type of the section that lists all symbols, exported or not."""

_library = find("pybullet", "pybullet.*.so")
_at, _int = types.uintp, types.intc
_submit = function(_library, _SUBMIT, _at, _at, _at)
_control = function(_library, "b3JointControlCommandInit2", _at, _at, _int, _int)
_set_torque = function(
    _library, "b3JointControlSetDesiredForceTorque", _int, _at, _int, types.double
)
_force = function(_library, "b3ApplyExternalForceCommandInit", _at, _at)
_set_force = function(_library, "b3ApplyExternalForce", types.void, _at, _int, _int, _at, _at, _int)
_step = function(_library, "b3InitStepSimulationCommand", _at, _at)
_ask = function(_library, "b3RequestActualStateCommandInit", _at, _at, _int)
_answer = function(_library, "b3GetStatusActualState", _int, *[_at] * 8)
_ask_touch = function(_library, "b3InitRequestContactPointInformation", _at, _at)
_first = function(_library, "b3SetContactFilterBodyA", types.void, _at, _int)
_second = function(_library, "b3SetContactFilterBodyB", types.void, _at, _int)
_touch = function(_library, "b3GetContactPointInformation", types.void, _at, _at)


@numba.njit(cache=True)
def _step_world(client, hand, places, torque):
    """Step one world once under joint torques (J,)."""
    command = _control(client, hand, _TORQUE_CONTROL)
    for j in range(len(torque)):
        _set_torque(command, places[1, j], torque[j])
    _submit(client, command)
    _submit(client, _step(client))


@numba.njit(cache=True)
def _read(client, body):
    """Coordinates and speeds of a body: views of the client's memory.

    They are valid until the client's next command.
    """
    answer = np.empty(2, dtype=np.uintp)
    status = _submit(client, _ask(client, body))
    _answer(status, 0, 0, 0, 0, answer.ctypes.data, answer.ctypes.data + answer.itemsize, 0)
    return array_at(answer[0], _MOST_NUMBERS), array_at(answer[1], _MOST_NUMBERS)


@numba.njit(cache=True)
def _read_world(client, hand, places, angle, speed):
    """Read the joints of one world."""
    q, u = _read(client, hand)
    for j in range(len(angle)):
        angle[j], speed[j] = q[places[0, j]], u[places[1, j]]


@numba.njit(cache=True)
def _carry(client, stick, force):
    """Apply a force (3,) at the stick's centre during the next step."""
    q, _ = _read(client, stick)
    center, command = q[:3].copy(), _force(client)
    place = command, stick, _BASE, force.ctypes.data, center.ctypes.data, _WORLD_FRAME
    _set_force(*place)
    _submit(client, command)


@numba.njit(cache=True)
def rollout(clients, hands, places, torque, angle, speed, sticks, carried, force):
    """Step every world T times under torques (N, T, J), and read its joints each time.

    `clients` (N,) are pointers, `hands` (N,) are body numbers, and `places` (N, 3, J) are the
    indices of the joints in Bullet's coordinates and speeds, and among its joints. Forces (N, 3)
    act on the sticks in the first `carried` (N,) steps.
    """
    for n in range(len(clients)):
        for tick in range(torque.shape[1]):
            if tick < carried[n]:
                _carry(clients[n], sticks[n], force[n])
            _step_world(clients[n], hands[n], places[n], torque[n, tick])
            _read_world(clients[n], hands[n], places[n], angle[n], speed[n])


@numba.njit(cache=True)
def drive(clients, hands, places, args, ticks, angle, speed, sticks, carried, force):
    """`rollout` of `ticks` steps under the drives whose `DriveCallArgs` are at `args`."""
    for n in range(len(clients)):
        for tick in range(ticks):
            if tick < carried[n]:
                _carry(clients[n], sticks[n], force[n])
            torque = motor_step(args, n, tick, angle[n], speed[n])
            _step_world(clients[n], hands[n], places[n], torque)
            _read_world(clients[n], hands[n], places[n], angle[n], speed[n])


@numba.njit(cache=True)
def read_sticks(clients, sticks, pos, quat_wxyz, vel, omega):
    """Read the pose and twist of the stick in every world."""
    for n in range(len(clients)):
        q, u = _read(clients[n], sticks[n])
        for i in range(3):
            pos[n, i], vel[n, i], omega[n, i] = q[i], u[i], u[3 + i]
            quat_wxyz[n, 1 + i] = q[3 + i]
        quat_wxyz[n, 0] = q[6]


@numba.njit(cache=True)
def read_contacts(clients, hands, sticks, tip_of_link):
    """Every contact between hand and stick: one row each, in the layout of `_pool_contacts`."""
    table, count = np.empty((len(clients) * _MOST_CONTACTS, 9)), 0
    for n in range(len(clients)):
        links, words = _touching(clients[n], hands[n], sticks[n])
        for k in range(min(len(words), _MOST_CONTACTS)):
            c, row = words[k], table[count]
            load = c[_LOAD]
            row[0], row[1], row[2] = n, tip_of_link[links[k, _LINK]], load
            for i in range(3):
                row[3 + i] = load * (c[_FIRST_AT + i] + c[_SECOND_AT + i]) / 2
                row[6 + i] = load * c[_NORMAL + i]
            count += 1
    return table[:count]


@numba.njit(cache=True)
def _touching(client, hand, stick):
    """Contacts between hand and stick: rows of the client's memory, as integers and as words."""
    command, answer = _ask_touch(client), np.zeros(2, dtype=np.uintp)
    _first(command, hand)
    _second(command, stick)
    _submit(client, command)
    _touch(client, answer.ctypes.data)
    count = np.int64(answer[0] & np.uintp(0xFFFFFFFF))
    words = array_at(answer[1], (count, _CONTACT_WORDS))
    return words.view(np.int32), words


def pointer(client: int) -> int:
    """Address of the client with this number."""
    size = ctypes.sizeof(ctypes.c_void_p)
    found = ctypes.c_void_p.from_address(_TABLE + size * client).value
    if not found:
        raise RuntimeError(f"pybullet has no client {client}; connect a client first")
    return found


def _symbol_values(library: str, names: tuple[str, ...]) -> dict[str, int]:
    """Addresses of symbols within a 64-bit ELF file (System V ABI, "Object Files")."""
    file = np.memmap(library, mode="r")
    start, count = int(file[40:48].view("<u8")[0]), int(file[60:62].view("<u2")[0])
    sections = file[start : start + count * _SECTION.itemsize].view(_SECTION)

    def content(section: np.void) -> Array:
        return file[int(section["offset"]) : int(section["offset"] + section["size"])]

    tables = sections[sections["type"] == _SYMBOL_TABLE]
    if len(tables) == 0:
        raise ImportError(f"{library} was stripped of its symbols; install pybullet's own wheel")
    symbols = content(tables[0]).view(_SYMBOL)
    text = content(sections[tables[0]["link"]]).tobytes()
    places = {name: text.find(f"\0{name}\0".encode()) + 1 for name in names}
    return {name: int(symbols["value"][symbols["name"] == at][0]) for name, at in places.items()}


def _table() -> int:
    """Address of pybullet's table of clients."""
    values = _symbol_values(_library, (_SUBMIT, _CLIENTS))
    return address(_library, _SUBMIT) - values[_SUBMIT] + values[_CLIENTS]


_TABLE = _table()
