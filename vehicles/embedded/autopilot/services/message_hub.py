"""An emulated autopilot's messages, in and out: whose method handles what, answers, streams."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import AutopilotState
from wil_campaign.vehicles.embedded.autopilot.flight.telemetry import Builder
from wil_campaign.vehicles.embedded.autopilot.services import discovery
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    UNSUPPORTED,
    ReceivedCommand,
    command_from_int,
    command_from_long,
    on_command,
    on_message,
    registered_handlers,
)
from wil_campaign.vehicles.embedded.autopilot.services.outbox import INFO, Outbox
from wil_campaign.vehicles.embedded.autopilot.services.stream_intervals import StreamIntervals

COMPONENT: int = mavlink.MAV_COMP_ID_AUTOPILOT1
_HIGHEST_INTERVAL_ID = 65535
"""Message ids in MESSAGE_INTERVAL have 16 bits."""
_LONGEST_INTERVAL_US = 2**31 - 1
"""Intervals in MESSAGE_INTERVAL are signed 32-bit integers."""


_STOP_US, _DEFAULT_US = -1.0, 0.0
"""Intervals of SET_MESSAGE_INTERVAL that are none."""
_TO_ANY_SYSTEM = {
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
    mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION,
}
_TO_ONE_SYSTEM = ("COMMAND_", "PARAM_", "MISSION_")


class MessageRules(NamedTuple):
    """How a firmware answers about messages.

    takes_broadcasts: obeys commands, parameters and missions to system 0. no_stream, no_message:
    MAV_RESULT of an interval that it refuses, and of a request for a message that it has not.
    shortest_us: an interval below is refused; None: sent as often as it can.
    """

    takes_broadcasts: bool
    no_stream: int
    no_message: int
    shortest_us: float | None


class MessageHub:
    """The messages of an emulated autopilot, in and out.

    Its parts are objects with methods marked by `on_message`, `on_command` and `on_request`.
    builders: of messages by id, from the state. modes: in AVAILABLE_MODES. rules: the firmware's.
    """

    def __init__(
        self,
        *,
        system_id: int,
        state: AutopilotState,
        streams: StreamIntervals,
        outbox: Outbox,
        builders: Mapping[int, Builder],
        modes: tuple[discovery.ModeEntry, ...],
        rules: MessageRules,
    ) -> None:
        self._system_id = system_id
        self._state = state
        self._streams = streams
        self._outbox = outbox
        self._builders = builders
        self._modes = modes
        self._rules = rules
        self._arrived_s = 0.0
        self.messages: dict[str, Callable[[Any], None]] = {}
        self.commands: dict[int, Callable[[ReceivedCommand], int]] = {}
        self._requests: dict[int, Callable[[], Any]] = {}

    def serve(self, *parts: object) -> None:
        """Have marked methods of these parts handle their messages; a later part's replaces."""
        for part in parts:
            self.messages |= registered_handlers(part, "mav_messages")
            self.commands |= registered_handlers(part, "mav_commands")
            self._requests |= registered_handlers(part, "mav_requests")

    def handle(self, message: Any, arrived_s: float) -> None:
        """Handle one MAVLink message; messages to other systems are ignored.

        arrived_s: its time of arrival, after the last step and before the next.
        """
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        if system not in {0, self._system_id} or component not in {0, COMPONENT}:
            return
        if system == 0 and not self._takes_broadcast(message):
            return
        handler = self.messages.get(message.get_type())
        if handler is not None:
            self._arrived_s = arrived_s
            handler(message)
            self._outbox.release()

    def _takes_broadcast(self, message: Any) -> bool:
        """Return whether the firmware obeys this message to all systems (evaluate_target_ok)."""
        if self._rules.takes_broadcasts or not message.get_type().startswith(_TO_ONE_SYSTEM):
            return True
        return getattr(message, "command", None) in _TO_ANY_SYSTEM

    def send_due(self) -> None:
        """Queue the messages of all streams that are due."""
        for message_id in self._streams.due(self._state.clock_s):
            self.send(message_id)

    def send(self, message_id: int) -> bool:
        """Queue a message by id; False when the autopilot has none, or not yet."""
        builder, request = self._builders.get(message_id), self._requests.get(message_id)
        if builder is not None:
            message = builder(self._state)
        else:
            message = request() if request is not None else None
        self._outbox.send(message)
        return message is not None

    def acknowledge(self, number: int, result: int, peer: tuple[int, int]) -> None:
        """Queue the COMMAND_ACK of a command by a system and component."""
        self._outbox.send(mavlink.MAVLink_command_ack_message(number, result, 0, 0, *peer))

    def _do(self, command: ReceivedCommand) -> None:
        handler = self.commands.get(command.number)
        result = handler(command) if handler is not None else UNSUPPORTED
        self.acknowledge(command.number, result, (command.from_system, command.from_component))

    @on_message("COMMAND_LONG")
    def _on_command_long(self, message: Any) -> None:
        self._do(command_from_long(message))

    @on_message("COMMAND_INT")
    def _on_command_int(self, message: Any) -> None:
        self._do(command_from_int(message))

    @on_message("TIMESYNC")
    def _on_timesync(self, message: Any) -> None:
        if message.tc1 == 0:
            now_ns = self._state.stamp_us(self._arrived_s) * 1000
            self._outbox.send(mavlink.MAVLink_timesync_message(now_ns, message.ts1))

    @on_message("PING")
    def _on_ping(self, message: Any) -> None:
        if message.target_system == 0:
            peer = (message.get_srcSystem(), message.get_srcComponent())
            self._outbox.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *peer))

    @on_command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
    def _set_interval(self, command: ReceivedCommand) -> int:
        number, interval_us = command.whole(0), command.params[1]
        if number not in mavlink.mavlink_map or math.isnan(interval_us) or command.whole(2):
            return self._rules.no_stream
        if self._is_too_fast(interval_us):
            self._outbox.send_text(
                INFO, f"Requested rate for message ID {number} too fast. Increase SCHED_LOOP_RATE"
            )
            return self._rules.no_stream
        if interval_us == _DEFAULT_US:
            self._streams.reset_rate(number, now_s=self._state.clock_s)
        else:
            rate_hz = 1e6 / interval_us if interval_us > 0.0 else 0.0
            self._streams.set_rate(number, rate_hz, now_s=self._state.clock_s)
        return ACCEPTED

    def _is_too_fast(self, interval_us: float) -> bool:
        shortest_us = self._rules.shortest_us
        if shortest_us is None or interval_us in {_STOP_US, _DEFAULT_US}:
            return False
        return interval_us < shortest_us

    @on_command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL)
    def _get_interval(self, command: ReceivedCommand) -> int:
        message_id = command.whole(0)
        if not 0 <= message_id <= _HIGHEST_INTERVAL_ID:
            return DENIED
        interval_s = self._streams.interval_s(message_id)
        interval_us = -1
        if interval_s is not None:
            interval_us = round(min(interval_s * 1e6, _LONGEST_INTERVAL_US))
        self._outbox.send(mavlink.MAVLink_message_interval_message(message_id, interval_us))
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_REQUEST_MESSAGE)
    def _request_message(self, command: ReceivedCommand) -> int:
        message_id = command.whole(0)
        if message_id == discovery.AVAILABLE_MODES:
            modes = discovery.available_modes(self._modes, command.whole(1))
            for message in modes:
                self._outbox.send_later(message)
            return ACCEPTED if modes else self._rules.no_message
        return ACCEPTED if self.send(message_id) else self._rules.no_message

    @on_command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES)
    def _request_capabilities(self, _: ReceivedCommand) -> int:
        self.send(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_GET_HOME_POSITION)
    def _get_home(self, _: ReceivedCommand) -> int:
        return (
            ACCEPTED if self.send(mavlink.MAVLINK_MSG_ID_HOME_POSITION) else self._rules.no_message
        )
