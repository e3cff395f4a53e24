"""The mission protocol: upload, read-back and clearing of missions, fences and rally points.

https://mavlink.io/en/services/mission.html
"""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.embedded.autopilot.flight.mission_items import Item

MISSION: int = mavlink.MAV_MISSION_TYPE_MISSION
FENCE: int = mavlink.MAV_MISSION_TYPE_FENCE
RALLY: int = mavlink.MAV_MISSION_TYPE_RALLY
_ALL: int = mavlink.MAV_MISSION_TYPE_ALL
ACCEPTED: int = mavlink.MAV_MISSION_ACCEPTED
_ASK_AGAIN_S = 0.5
_GIVE_UP_S = 5.0
_MOST_ITEMS = 700


class _Upload:
    """An upload under way."""

    def __init__(self, *, kind: int, count: int, peer: tuple[int, int], t_s: float) -> None:
        self.kind = kind
        self.count = count
        self.peer = peer
        self.items: list[Item] = []
        self.heard_s = self.asked_s = t_s


Accept = Callable[[int, tuple[Item, ...]], int]
"""Takes the kind and the items of a whole upload; returns a MAV_MISSION_RESULT."""


class MissionService:
    """Keeps the three lists and speaks the protocol for them.

    home: gives item 0 of every mission, as in ArduPilot, where it is home and not the user's; None
    where a mission begins with the user's first item, as in PX4.
    """

    def __init__(
        self, *, send: Callable[[Any], None], accept: Accept, home: Callable[[], Item] | None
    ) -> None:
        self._send = send
        self._accept = accept
        self._home = home
        self._lists: dict[int, tuple[Item, ...]] = {MISSION: (), FENCE: (), RALLY: ()}
        self._upload: _Upload | None = None

    def items(self, kind: int) -> tuple[Item, ...]:
        """Return a list; an ArduPilot mission starts with home."""
        items = self._lists.get(kind, ())
        if kind == MISSION and self._home is not None:
            return (self._home(), *items[1:])
        return items

    def handle(self, message: Any, t_s: float) -> None:
        """Take any message of the protocol."""
        name = message.get_type()
        if name == "MISSION_COUNT":
            self._begin(message, t_s)
        elif name in {"MISSION_ITEM_INT", "MISSION_ITEM"}:
            self._take(message, t_s)
        elif name == "MISSION_REQUEST_LIST":
            self._count(message)
        elif name in {"MISSION_REQUEST_INT", "MISSION_REQUEST"}:
            self._give(message)
        elif name == "MISSION_CLEAR_ALL":
            self._clear(message)

    def turn(self, t_s: float) -> None:
        """Ask again for an item that did not come; give up in the end."""
        upload = self._upload
        if upload is None:
            return
        if t_s - upload.heard_s > _GIVE_UP_S:
            self._upload = None
            self._ack(upload.peer, mavlink.MAV_MISSION_OPERATION_CANCELLED, upload.kind)
        elif t_s - upload.asked_s > _ASK_AGAIN_S:
            self._ask(upload, t_s)

    def _begin(self, message: Any, t_s: float) -> None:
        peer, kind = _peer(message), message.mission_type
        if kind not in self._lists:
            self._ack(peer, mavlink.MAV_MISSION_UNSUPPORTED, kind)
        elif message.count > _MOST_ITEMS:
            self._ack(peer, mavlink.MAV_MISSION_NO_SPACE, kind)
        elif message.count == 0:
            self._finish(peer, kind, ())
        else:
            self._upload = _Upload(kind=kind, count=message.count, peer=peer, t_s=t_s)
            self._ask(self._upload, t_s)

    def _take(self, message: Any, t_s: float) -> None:
        upload, peer = self._upload, _peer(message)
        if upload is None or upload.peer != peer or upload.kind != message.mission_type:
            return
        upload.heard_s = t_s
        if message.seq != len(upload.items):
            self._ask(upload, t_s)
            return
        upload.items.append(_item(message))
        if len(upload.items) < upload.count:
            self._ask(upload, t_s)
            return
        self._upload = None
        self._finish(peer, upload.kind, tuple(upload.items))

    def _finish(self, peer: tuple[int, int], kind: int, items: tuple[Item, ...]) -> None:
        result = self._accept(kind, items)
        if result == ACCEPTED:
            self._lists[kind] = items
        self._ack(peer, result, kind)

    def _ask(self, upload: _Upload, t_s: float) -> None:
        upload.asked_s = t_s
        self._send(
            mavlink.MAVLink_mission_request_int_message(
                *upload.peer, len(upload.items), upload.kind
            )
        )

    def _count(self, message: Any) -> None:
        kind = message.mission_type
        count = len(self.items(kind))
        self._send(mavlink.MAVLink_mission_count_message(*_peer(message), count, kind))

    def _give(self, message: Any) -> None:
        kind, peer = message.mission_type, _peer(message)
        items = self.items(kind)
        if message.seq >= len(items):
            self._ack(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)
            return
        item = items[message.seq]
        head = (*peer, message.seq, item.frame, item.command, 0, item.autocontinue, *item.params)
        if message.get_type() == "MISSION_REQUEST_INT":
            self._send(
                mavlink.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, kind)
            )
        else:
            self._send(
                mavlink.MAVLink_mission_item_message(
                    *head, item.x * 1e-7, item.y * 1e-7, item.z, kind
                )
            )

    def _clear(self, message: Any) -> None:
        kind = message.mission_type
        kinds = tuple(self._lists) if kind == _ALL else (kind,)
        results = [self._accept(each, ()) for each in kinds if each in self._lists]
        for each in kinds:
            if each in self._lists:
                self._lists[each] = ()
        refused = [result for result in results if result != ACCEPTED]
        self._ack(_peer(message), refused[0] if refused else ACCEPTED, kind)

    def _ack(self, peer: tuple[int, int], result: int, kind: int) -> None:
        self._send(mavlink.MAVLink_mission_ack_message(*peer, result, kind))


def _peer(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _item(message: Any) -> Item:
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        x, y = round(x * 1e7), round(y * 1e7)
    return Item(
        message.frame,
        message.command,
        (message.param1, message.param2, message.param3, message.param4),
        x,
        y,
        message.z,
        message.autocontinue,
    )
