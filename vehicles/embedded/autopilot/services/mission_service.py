"""The autopilot's side of the mission protocol: missions, fences and rally points.

https://mavlink.io/en/services/mission.html
"""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import (
    ACCEPTED,
    EmulatedMissionItem,
    ItemRules,
    mission_item_fault,
    mission_item_of,
    stored_mission_frame,
)
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import on_message
from wil_campaign.vehicles.embedded.autopilot.services.outbox import CRITICAL, INFO, WARNING

__all__ = ["ACCEPTED", "FENCE", "MISSION", "RALLY", "Accept", "MissionService"]

MISSION: int = mavlink.MAV_MISSION_TYPE_MISSION
FENCE: int = mavlink.MAV_MISSION_TYPE_FENCE
RALLY: int = mavlink.MAV_MISSION_TYPE_RALLY
_ALL: int = mavlink.MAV_MISSION_TYPE_ALL
_REQUEST_AGAIN_S, _COPTER_AGAIN_S = 0.25, 1.0
_GIVE_UP_S, _COPTER_GIVES_UP_S = 5.0, 8.0
"""MAVLINK_MISSION_*_TIMEOUT_DEFAULT of PX4; recv_timeout_ms and upload_timeout_ms of ArduPilot."""
_GUIDED = 2
"""MISSION_ITEM.current of an item to fly to at once."""

_Peer = tuple[int, int]
"""A client: system, component."""


class _Upload:
    """A mission upload under way."""

    def __init__(self, *, kind: int, count: int, peer: _Peer, t_s: float) -> None:
        self.kind = kind
        self.count = count
        self.peer = peer
        self.items: list[EmulatedMissionItem] = []
        self.last_received_s = self.requested_s = t_s


class _Download:
    """A download under way in PX4: who reads which list, and how far it is (mavlink_mission.cpp).

    Items are sent in their order, and nothing else is taken until the client acknowledges the end,
    or is silent for 5 s.
    """

    def __init__(self, *, kind: int, count: int, peer: _Peer, t_s: float) -> None:
        self.kind = kind
        self.peer = peer
        self.last_received_s = t_s
        self._count = count
        self._sent = 0

    def may_restart(self, kind: int, peer: _Peer) -> bool:
        """Return whether a client may ask for a list now: the same again, or after the end."""
        return self._sent == self._count or (self.kind, self.peer) == (kind, peer)

    def takes(self, seq: int) -> bool:
        """Return whether an item is the next one, or the last one again; count it as sent."""
        if seq == self._sent < self._count:
            self._sent += 1
            return True
        return seq == self._sent - 1


Accept = Callable[[int, tuple[EmulatedMissionItem, ...]], int]
"""Takes the kind and the items of a whole upload; returns a MAV_MISSION_RESULT."""


class MissionService:
    """Serves the mission protocol for the three item lists.

    clock: of the vehicle, s. home: returns item 0 of every mission, which is home in ArduPilot;
    None when a mission begins with the user's first item, as in PX4. rules: of the items that the
    firmware accepts. go_to: flies to a "guided" MISSION_ITEM (current of 2), which is not part of
    an upload; returns a MAV_MISSION_RESULT. tell: sends a STATUSTEXT.
    """

    def __init__(
        self,
        *,
        send: Callable[[Any], None],
        tell: Callable[[int, str], None],
        clock: Callable[[], float],
        accept: Accept,
        home: Callable[[], EmulatedMissionItem] | None,
        rules: ItemRules,
        go_to: Callable[[EmulatedMissionItem], int],
    ) -> None:
        self._send = send
        self._tell = tell
        self._clock = clock
        self._accept = accept
        self._home = home
        self._is_px4 = home is None
        self._rules = rules
        self._go_to = go_to
        self._lists: dict[int, tuple[EmulatedMissionItem, ...]] = {
            MISSION: (),
            FENCE: (),
            RALLY: (),
        }
        self._upload: _Upload | None = None
        self._download: _Download | None = None
        """Of PX4; ArduPilot sends any item at any time."""
        self._finished: tuple[tuple[int, int], int] | None = None
        """The sender and kind of the last finished upload."""

    def items(self, kind: int) -> tuple[EmulatedMissionItem, ...]:
        """Return a mission list; an ArduPilot mission starts with home."""
        items = self._lists.get(kind, ())
        if kind == MISSION and self._home is not None:
            return (self._home(), *items[1:])
        return items

    @on_message(
        "MISSION_COUNT",
        "MISSION_ITEM_INT",
        "MISSION_ITEM",
        "MISSION_REQUEST_LIST",
        "MISSION_REQUEST_INT",
        "MISSION_REQUEST",
        "MISSION_CLEAR_ALL",
        "MISSION_ACK",
    )
    def _on_mission(self, message: Any) -> None:
        name, t_s = message.get_type(), self._clock()
        if name == "MISSION_COUNT":
            self._begin(message, t_s)
        elif name in {"MISSION_ITEM_INT", "MISSION_ITEM"}:
            self._take_item(message, t_s)
        elif name == "MISSION_REQUEST_LIST":
            self._list(message, t_s)
        elif name in {"MISSION_REQUEST_INT", "MISSION_REQUEST"}:
            if self._may_send(message, t_s):
                self._send_item(message)
        elif name == "MISSION_CLEAR_ALL":
            self._clear(message)
        elif self._is_px4:
            self._take_ack(message)

    def turn(self, t_s: float) -> None:
        """Request a missing mission item again; end a transfer after a time-out."""
        upload, download = self._upload, self._download
        if download is not None and t_s - download.last_received_s > _GIVE_UP_S:
            self._download = None
            self._tell(CRITICAL, "Operation timeout\t")
        if upload is None:
            return
        if t_s - upload.last_received_s > (_GIVE_UP_S if self._is_px4 else _COPTER_GIVES_UP_S):
            self._give_up(upload)
        elif t_s - upload.requested_s > (_REQUEST_AGAIN_S if self._is_px4 else _COPTER_AGAIN_S):
            self._request_next(upload, t_s)

    def _give_up(self, upload: _Upload) -> None:
        self._upload = None
        if self._is_px4:
            self._tell(CRITICAL, "Operation timeout\t")
            return
        self._ack(upload.peer, mavlink.MAV_MISSION_OPERATION_CANCELLED, upload.kind)
        self._tell(WARNING, "Mission upload timeout")

    # PX4's downloads.

    def _list(self, message: Any, t_s: float) -> None:
        """Send a list's count; PX4 begins a download, if it has nothing else to do."""
        kind, peer = message.mission_type, _peer(message)
        if self._is_px4:
            before = self._download
            if self._upload is not None or (before and not before.may_restart(kind, peer)):
                self._tell(INFO, "Mission download request ignored, already active\t")
                return
            count = len(self._lists.get(kind, ()))
            self._download = _Download(kind=kind, count=count, peer=peer, t_s=t_s)
        self._send_count(message)

    def _may_send(self, message: Any, t_s: float) -> bool:
        """Return whether an item is sent; one out of its order ends PX4's download."""
        download, peer = self._download, _peer(message)
        if not self._is_px4:
            return True
        if download is None or (download.kind, download.peer) != (message.mission_type, peer):
            return False
        download.last_received_s = t_s
        if download.takes(message.seq):
            return True
        self._download = None
        self._reject(peer, message.mission_type, "WPM: REJ. CMD: Req. WP was unexpected\t")
        return False

    def _take_ack(self, message: Any) -> None:
        """End a download, or an upload that its client cancels."""
        download, upload, peer = self._download, self._upload, _peer(message)
        if download and (download.peer, download.kind) == (peer, message.mission_type):
            self._download = None
        cancelled = message.type == mavlink.MAV_MISSION_OPERATION_CANCELLED
        if upload and cancelled and upload.peer == peer:
            self._upload = None

    def _reject(self, peer: _Peer, kind: int, text: str) -> None:
        self._ack(peer, mavlink.MAV_MISSION_ERROR, kind)
        self._tell(CRITICAL, text)

    # Uploads.

    def _begin(self, message: Any, t_s: float) -> None:
        peer, kind, upload = _peer(message), message.mission_type, self._upload
        if kind not in self._lists:
            no_space, unsupported = mavlink.MAV_MISSION_NO_SPACE, mavlink.MAV_MISSION_UNSUPPORTED
            self._ack(peer, no_space if self._is_px4 else unsupported, kind)
        elif upload is not None and upload.peer != peer:
            busy = mavlink.MAV_MISSION_ERROR if self._is_px4 else mavlink.MAV_MISSION_DENIED
            self._ack(peer, busy, kind)
        elif self._download is not None:
            self._reject(peer, kind, "WPM: IGN MISSION_COUNT: Busy\t")
        elif self._is_px4 and upload is not None and upload.items:
            self._reject(peer, kind, "WPM: REJ. CMD: Busy\t")
        elif self._is_px4 and upload is not None and kind == upload.kind:
            # The request may have been lost; PX4 keeps the first count.
            self._request_next(upload, t_s)
        elif message.count > self._rules.most[kind]:
            self._ack(peer, mavlink.MAV_MISSION_NO_SPACE, kind)
        elif message.count == 0:
            self._finish(peer, kind, ())
        else:
            self._upload = _Upload(kind=kind, count=message.count, peer=peer, t_s=t_s)
            self._request_next(self._upload, t_s)

    def _take_item(self, message: Any, t_s: float) -> None:
        upload, peer, kind = self._upload, _peer(message), message.mission_type
        item = mission_item_of(message)
        if message.current == _GUIDED and upload is None and isinstance(item, EmulatedMissionItem):
            self._ack(peer, self._go_to(item), kind)
            return
        if upload is None or upload.peer != peer or upload.kind != kind:
            # A lossy link doubles items, and the final acknowledgement may have been lost.
            doubled = self._finished == (peer, kind) and message.seq < len(self._lists[kind])
            self._ack(peer, ACCEPTED if doubled else mavlink.MAV_MISSION_ERROR, kind)
            return
        upload.last_received_s = t_s
        if message.seq != len(upload.items):
            self._request_next(upload, t_s)
            return
        fault = self._fault(upload, item)
        if fault != ACCEPTED or isinstance(item, int):
            self._upload = None
            self._ack(peer, fault, kind)
            return
        upload.items.append(item)
        if len(upload.items) < upload.count:
            self._request_next(upload, t_s)
            return
        self._upload = None
        self._finish(peer, upload.kind, tuple(upload.items))

    def _fault(self, upload: _Upload, item: EmulatedMissionItem | int) -> int:
        """Return the MAV_MISSION_RESULT of the next item; ArduPilot's home is always accepted."""
        if isinstance(item, int):
            return item
        if upload.kind == MISSION and not self._is_px4 and not upload.items:
            return ACCEPTED
        return mission_item_fault(upload.kind, item, self._rules)

    def _finish(
        self, peer: tuple[int, int], kind: int, items: tuple[EmulatedMissionItem, ...]
    ) -> None:
        result = self._accept(kind, items)
        if result == ACCEPTED:
            self._lists[kind] = items
            self._finished = (peer, kind)
            if not self._is_px4 and kind == MISSION:
                self._tell(INFO, "Flight plan received")
        self._ack(peer, result, kind)

    def _request_next(self, upload: _Upload, t_s: float) -> None:
        upload.requested_s = t_s
        # ArduPilot requests by the old message and accepts both forms of items; PX4 by the new one.
        request: Callable[..., Any] = (
            mavlink.MAVLink_mission_request_int_message
            if self._is_px4
            else mavlink.MAVLink_mission_request_message
        )
        self._send(request(*upload.peer, len(upload.items), upload.kind))

    def _send_count(self, message: Any) -> None:
        kind, peer = message.mission_type, _peer(message)
        if kind not in self._lists and not self._is_px4:
            self._ack(peer, mavlink.MAV_MISSION_UNSUPPORTED, kind)
            return
        # Without a mission ArduPilot counts no home, though item 0 can be read.
        count = len(self._lists.get(kind, ()))
        self._send(mavlink.MAVLink_mission_count_message(*peer, count, kind))

    def _send_item(self, message: Any) -> None:
        kind, peer = message.mission_type, _peer(message)
        items = self.items(kind)
        if message.seq >= len(items):
            self._refuse_request(message, peer)
            return
        item = items[message.seq]
        frame = stored_mission_frame(item, self._rules) if kind == MISSION else item.frame
        head = (*peer, message.seq, frame, item.command, 0, item.autocontinue, *item.params)
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

    def _refuse_request(self, message: Any, peer: tuple[int, int]) -> None:
        """Answer a request beyond the end; ArduPilot tells a mission's count again."""
        if not self._is_px4 and message.mission_type == MISSION:
            self._send_count(message)
            self._ack(peer, mavlink.MAV_MISSION_ERROR, MISSION)
        else:
            self._ack(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE, message.mission_type)

    def _clear(self, message: Any) -> None:
        kind = message.mission_type
        if self._is_px4 and (self._download or self._upload):
            self._tell(CRITICAL, "WPM: IGN CLEAR CMD: Busy\t")
            return
        for each in self._lists if kind == _ALL else {kind} & self._lists.keys():
            self._accept(each, ())
            self._lists[each] = ()
        self._ack(_peer(message), ACCEPTED, kind)

    def _ack(self, peer: tuple[int, int], result: int, kind: int) -> None:
        self._send(mavlink.MAVLink_mission_ack_message(*peer, result, kind))


def _peer(message: Any) -> tuple[int, int]:
    """Return the sender of a mission message: system, component."""
    return message.get_srcSystem(), message.get_srcComponent()
