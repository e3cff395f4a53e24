"""What the orchestrator and the guard's process say to each other; pure.

One message is one packet of a SOCK_SEQPACKET Unix socket: a byte that names its kind, then its
body, little-endian. Frequent kinds have a fixed layout, the others msgpack:

    kind  who            body
    1     orchestrator   Charter: a map, see `charter`
    2     orchestrator   Start: [vehicle, [argument, ...], {variable: value}]
    3     both           Bytes: u8 vehicle, f64 t_s, MAVLink frames
    4     orchestrator   Position: u8 vehicle, f64 t_s, 3 position, 4 attitude, 3 velocity
    5     orchestrator   Alive: empty
    6     orchestrator   Order: [order, text]
    7     orchestrator   AnchorAt: [vehicle, [north, east, down], turn]
    8     orchestrator   End: empty
    9     orchestrator   GoDark: [vehicle, seconds]
    10    orchestrator   NewFences: [who, {vehicle: fence}, only proposed]
    11    orchestrator   Follow: []
    16    guard          Opened: [pid, [port, ...]]
    17    guard          Started: [vehicle, pid]
    18    guard          Ended: [vehicle, exit code or nil, last words]
    19    guard          OnWire: u8 vehicle, f64 t_s, one command frame that went to the vehicle
    20    guard          Event: [t_s, kind, vehicle, text]
    21    guard          Status: [latched or nil, all down, at rest, [phase, ...]]
    22    guard          Failed: [text]
    23    guard          Pace: [wall clock, run clock, run seconds for each of the wall's]

Vehicles go by their place in the charter. Times are CLOCK_MONOTONIC, which all processes
share; under the scaled clock the run clock, as Pace lays it down.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import fields
from typing import Any, cast, get_args

import msgpack  # type: ignore[import-untyped]  # ships no types

from safety.fence_plain import fence_of_plain, plain_fence
from safety.guard.contingency import Phase
from safety.guard.events import Cause, EventKind, GuardEvent
from safety.guard.messages import (
    Alive,
    AnchorAt,
    Bytes,
    CharterMessage,
    End,
    Ended,
    Failed,
    Follow,
    GoDark,
    Message,
    NewFences,
    OnWire,
    Opened,
    Order,
    OrderKind,
    Pace,
    Position,
    Start,
    Started,
    Status,
    Told,
)

LONGEST_MESSAGE_BYTES = 1 << 17
_ORDERS: frozenset[str] = frozenset(get_args(OrderKind))
_EVENTS: frozenset[str] = frozenset(get_args(EventKind))
_CAUSES: frozenset[str] = frozenset(get_args(Cause))
_head = struct.Struct("<BBd")
_position = struct.Struct("<BBd10d")


class ProtocolError(ValueError):
    """A packet that is none of the protocol's; says why."""


def encode(message: Message) -> bytes:
    """Return the packet of a message. Raises ProtocolError when it is too long."""
    match message:
        case Bytes(index, t_s, data):
            packet = _head.pack(3, index, t_s) + data
        case OnWire(index, t_s, frame):
            packet = _head.pack(19, index, t_s) + frame
        case Position(index, t_s, position, q_wxyz, velocity):
            packet = _position.pack(4, index, t_s, *position, *q_wxyz, *velocity)
        case Alive():
            packet = b"\x05"
        case End():
            packet = b"\x08"
        case _:
            kind, body = _plain(message)
            packet = bytes((kind,)) + cast("bytes", msgpack.packb(body))
    if len(packet) > LONGEST_MESSAGE_BYTES:
        raise ProtocolError(f"a message of {len(packet)} bytes is too long")
    return packet


def _plain(message: Message) -> tuple[int, Any]:
    """Return kind and body of a message that is not frequent."""
    kind = _KINDS.get(type(message))
    if kind is None:
        raise ProtocolError(f"{type(message).__name__} is no message")
    match message:
        case CharterMessage(plain):
            return kind, plain
        case NewFences(who, fences, proposed):
            plain = {name: plain_fence(fence) for name, fence in fences.items()}
            return kind, [who, plain, proposed]
        case Told(event):
            return kind, [event.t_s, event.kind, event.vehicle, event.text]
        case Status(latched, all_down, at_rest, phases):
            return kind, [latched, all_down, at_rest, [phase.name for phase in phases]]
        case _:
            return kind, [getattr(message, one.name) for one in fields(message)]


def decode(packet: bytes) -> Message:
    """Return the message of a packet. Raises ProtocolError for what is none."""
    if not packet:
        raise ProtocolError("an empty packet")
    read = _READERS.get(packet[0])
    if read is None:
        raise ProtocolError(f"kind {packet[0]} is not known")
    try:
        return read(packet)
    except ProtocolError:
        raise
    except (struct.error, ValueError, TypeError, KeyError, msgpack.UnpackException) as error:
        raise ProtocolError(f"kind {packet[0]}: {error}") from error


def _read_bytes(packet: bytes) -> Message:
    kind, index, t_s = _head.unpack_from(packet)
    _require_finite(t_s)
    data = packet[_head.size :]
    return Bytes(index, t_s, data) if kind == 3 else OnWire(index, t_s, data)


def _read_position(packet: bytes) -> Message:
    # NaN in a position is for the core to judge: it says so once and goes on.
    _, index, t_s, n, e, d, w, x, y, z, vn, ve, vd = _position.unpack(packet)
    _require_finite(t_s)
    return Position(index, t_s, (n, e, d), (w, x, y, z), (vn, ve, vd))


def _body(packet: bytes) -> Any:
    return msgpack.unpackb(packet[1:], strict_map_key=True)


def _read_charter(packet: bytes) -> Message:
    plain = _body(packet)
    if not isinstance(plain, dict):
        raise ProtocolError("a charter is a map")
    return CharterMessage(plain)


def _read_start(packet: bytes) -> Message:
    vehicle, argv, environment = _body(packet)
    texts = [vehicle, *argv, *environment, *environment.values()]
    if not argv:
        raise ProtocolError("nothing to start")
    _texts(*texts)
    return Start(vehicle, tuple(argv), environment)


def _read_order(packet: bytes) -> Message:
    kind, text = _texts(*_body(packet))
    if kind not in _ORDERS:
        raise ProtocolError(f"order {kind!r} is not known")
    return Order(cast("OrderKind", kind), text)


def _read_fences(packet: bytes) -> Message:
    who, fences, proposed = _body(packet)
    _texts(who, *fences)
    read = {name: fence_of_plain(plain) for name, plain in fences.items()}
    return NewFences(who, read, bool(proposed))


def _read_anchor(packet: bytes) -> Message:
    vehicle, (north, east, down), turn = _body(packet)
    _texts(vehicle)
    _require_finite(north, east, down, turn)
    return AnchorAt(vehicle, (float(north), float(east), float(down)), float(turn))


def _read_go_dark(packet: bytes) -> Message:
    vehicle, duration_s = _body(packet)
    _texts(vehicle)
    _require_finite(duration_s)
    return GoDark(vehicle, float(duration_s))


def _read_opened(packet: bytes) -> Message:
    pid, ports = _body(packet)
    return Opened(_integers(pid)[0], _integers(*ports))


def _read_started(packet: bytes) -> Message:
    vehicle, pid = _body(packet)
    return Started(_texts(vehicle)[0], _integers(pid)[0])


def _read_ended(packet: bytes) -> Message:
    vehicle, code, words = _body(packet)
    vehicle, words = _texts(vehicle, words)
    return Ended(vehicle, None if code is None else _integers(code)[0], words)


def _read_event(packet: bytes) -> Message:
    t_s, kind, vehicle, text = _body(packet)
    _require_finite(t_s)
    kind, vehicle, text = _texts(kind, vehicle, text)
    if kind not in _EVENTS:
        raise ProtocolError(f"event {kind!r} is not known")
    return Told(GuardEvent(float(t_s), cast("EventKind", kind), vehicle, text))


def _read_status(packet: bytes) -> Message:
    latched, all_down, at_rest, phases = _body(packet)
    if latched is not None and latched not in _CAUSES:
        raise ProtocolError(f"cause {latched!r} is not known")
    return Status(
        cast("Cause | None", latched),
        bool(all_down),
        bool(at_rest),
        tuple(Phase[name] for name in _texts(*phases)),
    )


def _read_pace(packet: bytes) -> Message:
    wall_s, run_s, rate = _body(packet)
    _require_finite(wall_s, run_s, rate)
    if rate < 0.0:
        raise ProtocolError(f"a clock does not go back: {rate!r}")
    return Pace(float(wall_s), float(run_s), float(rate))


def _read_failed(packet: bytes) -> Message:
    (text,) = _texts(*_body(packet))
    return Failed(text)


def _texts(*values: Any) -> tuple[str, ...]:
    if not all(isinstance(value, str) for value in values):
        raise ProtocolError(f"{values!r} are not all texts")
    return values


def _integers(*values: Any) -> tuple[int, ...]:
    if not all(type(value) is int for value in values):
        raise ProtocolError(f"{values!r} are not all integers")
    return values


def _require_finite(*values: Any) -> None:
    if not all(isinstance(value, float | int) and math.isfinite(value) for value in values):
        raise ProtocolError(f"{values!r} are not all finite numbers")


_KINDS: dict[type[Any], int] = {
    CharterMessage: 1,
    Start: 2,
    Order: 6,
    AnchorAt: 7,
    GoDark: 9,
    NewFences: 10,
    Follow: 11,
    Opened: 16,
    Started: 17,
    Ended: 18,
    Told: 20,
    Status: 21,
    Failed: 22,
    Pace: 23,
}
_READERS: dict[int, Callable[[bytes], Message]] = {
    1: _read_charter,
    2: _read_start,
    3: _read_bytes,
    4: _read_position,
    5: lambda _: Alive(),
    6: _read_order,
    7: _read_anchor,
    8: lambda _: End(),
    9: _read_go_dark,
    10: _read_fences,
    11: lambda _: Follow(),
    16: _read_opened,
    17: _read_started,
    18: _read_ended,
    19: _read_bytes,
    20: _read_event,
    21: _read_status,
    22: _read_failed,
    23: _read_pace,
}
