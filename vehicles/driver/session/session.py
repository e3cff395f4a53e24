"""The MAVLink session with one vehicle over one link: packs, parses and dispatches messages."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.driver.session.arrivals import Arrivals
from wil_campaign.vehicles.driver.session.second_vehicle import SecondVehicle
from wil_campaign.vehicles.links.link import Link, TellsUnread
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.mavlink.heartbeats import HeartbeatKind, heartbeat_kind
from wil_campaign.vehicles.mavlink.vehicle_frames import VehicleFrames

Handler = Callable[[Any, float], None]
"""Takes a message and the run clock's time of its arrival."""

PayloadHandler = Callable[[bytes, float], None]
"""Takes a message's payload, trailing zeros missing, and the time of its arrival."""


class HeartbeatSender(NamedTuple):
    """The sender of heartbeats in the session: its ids do not tell two of them apart."""

    system: int
    component: int
    kind: HeartbeatKind

    @property
    def target(self) -> MavlinkTarget:
        """Return the ids by which messages are sent to it."""
        return MavlinkTarget(self.system, self.component)


@dataclass(frozen=True, slots=True)
class ReceivedHeartbeat:
    """A sender's last heartbeat in the session, its time of arrival and MAVLink version."""

    heartbeat: Any
    t_s: float
    mavlink_version: int

    @property
    def autopilot(self) -> int:
        """Return the sender's MAV_AUTOPILOT."""
        return int(self.heartbeat.autopilot)

    @property
    def vehicle_type(self) -> int:
        """Return the sender's MAV_TYPE."""
        return int(self.heartbeat.type)


class MavlinkSession:
    """The MAVLink session with a vehicle: packs what we send, dispatches what it sends.

    Messages without a handler are not decoded. Until `target` is set, heartbeats of all systems
    are kept in `heartbeats` and dispatched; afterwards only the target's messages are, and of
    heartbeats with its ids those of its kind. The state of a second vehicle with its ids is left
    out where sequence numbers tell the two apart; `second_vehicle` says that there is one. sender:
    sends our messages; None to write their frames to the link.
    """

    def __init__(
        self, *, link: Link, own: MavlinkTarget, sender: Callable[[Any], None] | None = None
    ) -> None:
        self.link = link
        self._sender = sender
        self.own = own
        self.target: MavlinkTarget | None = None
        self._kind: HeartbeatKind | None = None
        """Of the target's heartbeats; None for any."""
        self.heartbeats: dict[HeartbeatSender, ReceivedHeartbeat] = {}
        self.others: dict[HeartbeatKind, float] = {}
        """Other senders of heartbeats with the target's ids, and when each was first received."""
        self.on_other: Callable[[HeartbeatKind, float], None] | None = None
        """Called with each new one of `others`."""
        self.second_vehicle = SecondVehicle()
        self._frames = VehicleFrames()
        self.last_received_s: float | None = None
        self.arrivals = Arrivals()
        self.codec = MavlinkCodec(system_id=own.system, component_id=own.component)
        self.on_arrival: Callable[[float], None] | None = None
        """Called with the time of each arrival of the target, before its messages."""
        self._handlers: dict[int, list[Handler]] = {}
        self._payload_handlers: dict[int, list[PayloadHandler]] = {}
        self.on(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, self._note_version)
        link.receive(self.received)
        if isinstance(link, TellsUnread):
            link.on_unread(self.received_unread)

    def select(self, vehicle: HeartbeatSender | None) -> None:
        """Dispatch the messages of a vehicle alone from now on; None for all heartbeats again."""
        self.others.clear()
        self._frames, self.second_vehicle = VehicleFrames(), SecondVehicle()
        if vehicle is None:
            self.target = self._kind = None
            return
        self.target, self._kind = vehicle.target, vehicle.kind
        for sender, received in self.heartbeats.items():
            if sender.target == vehicle.target and sender != vehicle:
                self.others[sender.kind] = received.t_s

    def write_frames(self) -> None:
        """Write frames to the link from now on: the command backend is gone."""
        self._sender = None

    def on(self, message_id: int, handler: Handler) -> None:
        """Register a handler of one of the vehicle's messages in the session."""
        self._handlers.setdefault(message_id, []).append(handler)

    def on_payload(self, message_id: int, handler: PayloadHandler) -> None:
        """Register a handler of a frequent message's payload, not decoded."""
        self._payload_handlers.setdefault(message_id, []).append(handler)

    def off(self, message_id: int, handler: Handler) -> None:
        """Remove the session's handler of a message."""
        handlers = [each for each in self._handlers.get(message_id, ()) if each != handler]
        if handlers:
            self._handlers[message_id] = handlers
        else:
            self._handlers.pop(message_id, None)

    def send(self, message: Any) -> None:
        """Send a message in the session."""
        if self._sender is None:
            self.link.write(self.codec.pack(message))
        else:
            self._sender(message)

    def send_together(self, messages: Iterable[Any]) -> None:
        """Send messages in the session, as one packet when it writes frames."""
        if self._sender is None:
            self.link.write(b"".join([self.codec.pack(message) for message in messages]))
        else:
            for message in messages:
                self._sender(message)

    def received(self, data: bytes, t_s: float) -> None:
        """Dispatch the messages in the link's bytes."""
        target = self.target
        for frame in self.codec.split(data):
            if target is None:
                self._note_heartbeat(frame, t_s)
            elif frame.system == target.system and frame.component == target.component:
                kind = heartbeat_kind(frame)
                if kind is not None and self._kind not in {None, kind}:
                    self._note_other(kind, t_s)
                    continue
                self._receive(frame, t_s)

    def received_unread(self, arrived_s: Sequence[float]) -> None:
        """Note the arrival times of frames that were dropped: the vehicle was not silent then."""
        for t_s in arrived_s if self.target is not None else ():
            if self.last_received_s is None or t_s > self.last_received_s:
                self._note_arrival(t_s)

    def _note_arrival(self, t_s: float) -> None:
        if self.on_arrival is not None:
            self.on_arrival(t_s)
        self.last_received_s = t_s
        self.arrivals.note(t_s)

    def _note_version(self, message: Any, t_s: float) -> None:
        self.second_vehicle.version(message, t_s)

    def _receive(self, frame: MavlinkFrame, t_s: float) -> None:
        """Dispatch a frame with the target's ids, unless it is of a second sender with them."""
        own, others = self._frames.split(frame, t_s)
        for _ in others:
            self.second_vehicle.second_frame(t_s, are_two=self._frames.are_two)
        for one in own:
            if t_s != self.last_received_s:
                self._note_arrival(t_s)
            self._dispatch(one, t_s)

    def _note_other(self, kind: HeartbeatKind, t_s: float) -> None:
        if kind in self.others:
            return
        self.others[kind] = t_s
        if self.on_other is not None:
            self.on_other(kind, t_s)

    def _note_heartbeat(self, frame: MavlinkFrame, t_s: float) -> None:
        if frame.message_id != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return
        message = self.codec.decode(frame)
        if message is None:
            return
        sender = HeartbeatSender(
            frame.system, frame.component, HeartbeatKind(message.type, message.autopilot)
        )
        self.heartbeats[sender] = ReceivedHeartbeat(message, t_s, frame.version)
        for handler in self._handlers.get(frame.message_id, ()):
            handler(message, t_s)

    def _dispatch(self, frame: MavlinkFrame, t_s: float) -> None:
        match frame.message_id:
            case mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                self.second_vehicle.position(frame.payload, t_s)
            case mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self.second_vehicle.heartbeat(frame.raw, t_s)
        for payload_handler in self._payload_handlers.get(frame.message_id, ()):
            payload_handler(frame.payload, t_s)
        handlers = self._handlers.get(frame.message_id)
        if handlers is None:
            return
        message = self.codec.decode(frame)
        if message is not None:
            for handler in handlers:
                handler(message, t_s)
