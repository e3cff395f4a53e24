"""What both autopilots have in common: MAVLink in and out, telemetry, commands, parameters."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.embedded.airframe import Airframe
from vehicles.embedded.autopilot import telemetry
from vehicles.embedded.autopilot.commands import (
    ACCEPTED,
    DENIED,
    FAILED,
    UNSUPPORTED,
    Command,
    from_int,
    from_long,
    marked,
    on_command,
    on_message,
)
from vehicles.embedded.autopilot.flight import Flight, FlightStyle
from vehicles.embedded.autopilot.parameters import Parameters, ParameterServer
from vehicles.embedded.autopilot.place import Place
from vehicles.embedded.autopilot.state import Identity, State
from vehicles.embedded.autopilot.streams import Streams
from vehicles.embedded.battery import Charge
from vehicles.embedded.states import Motion, Thrusts

COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1
_TEXT_BYTES = 50
GCS_SILENT_AFTER_S = 2.5
"""PX4's own limit for a heartbeat of a ground station to count as present."""


class EmbeddedAutopilot(ABC):
    """An autopilot between MAVLink messages and motor thrusts.

    Pure: `handle` takes messages, `step` takes the estimate and gives thrusts, both may leave
    messages in `take_messages`. Times are the vehicle's own clock, s since boot.
    """

    builders: ClassVar[dict[int, telemetry.Builder]]
    style: ClassVar[FlightStyle]

    def __init__(
        self,
        *,
        identity: Identity,
        airframe: Airframe,
        dt_s: float,
        charge: Charge,
        parameters: Parameters,
        rates_hz: Mapping[int, float],
    ) -> None:
        self.identity = identity
        self.parameters = parameters
        self.state = State(place=Place(identity.origin), charge=charge)
        self.flight = Flight(style=self.style, airframe=airframe, dt_s=dt_s)
        self.streams = Streams(rates_hz, shortest_s=dt_s)
        self.never_ready = False
        self.refusal: str | None = None
        """Faults for tests: why it never becomes ready, or refuses to arm."""
        self._parameter_server = ParameterServer(parameters, index_on_set=self.index_on_set)
        self._commands = marked(type(self), "mav_commands")
        self._messages = marked(type(self), "mav_messages")
        self._out: list[Any] = []
        self._texts: list[tuple[int, str]] = []
        self._text_id = 0
        self._gcs_heard_s = -math.inf

    index_on_set: ClassVar[bool]
    """Whether the answer to PARAM_SET carries the parameter's index, and checks its type."""

    # What each autopilot does in its own way.

    @abstractmethod
    def heartbeat(self) -> Any:
        """Return the HEARTBEAT of now."""

    @abstractmethod
    def supervise(self) -> None:
        """Check modes, failsafes and readiness; called at 50 Hz."""

    @abstractmethod
    def set_mode(self, base_mode: int, mode: int, submode: int) -> int:
        """Do MAV_CMD_DO_SET_MODE; return a MAV_RESULT."""

    @abstractmethod
    def arm(self, *, force: bool) -> int:
        """Arm; return a MAV_RESULT."""

    @abstractmethod
    def disarm(self, *, force: bool) -> int:
        """Disarm; return a MAV_RESULT."""

    @abstractmethod
    def strike(self, thing: str) -> None:
        """Take note that the airframe has hit something: its motors stand."""

    @abstractmethod
    def autopilot_version(self) -> Any:
        """Return AUTOPILOT_VERSION."""

    # The loop.

    def handle(self, message: Any) -> None:
        """Take one MAVLink message; what is for others is left alone."""
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        if system not in (0, self.identity.system_id) or component not in (0, COMPONENT):
            return
        name = self._messages.get(message.get_type())
        if name is not None:
            getattr(self, name)(message)

    def step(
        self, now: Motion, clock_s: float, *, touching: bool, charge: Charge, turn: bool
    ) -> Thrusts:
        """Return the thrusts for this estimate; `turn` marks every 20 ms, for what is slow."""
        state = self.state
        state.now = now
        state.clock_s = clock_s
        state.touching = touching
        state.charge = charge
        if turn:
            self.supervise()
            self._out.extend(self._parameter_server.due())
            self._flush_texts()
        thrusts = self.flight.step(now, clock_s, touching=touching)
        if clock_s >= self.streams.next_due_s:
            for message_id in self.streams.due(clock_s):
                self.send_id(message_id)
        return thrusts

    def take_messages(self) -> list[Any]:
        """Return what is to be sent now, in order, and forget it."""
        if not self._out:
            return self._out
        out, self._out = self._out, []
        return out

    # For the parts and subclasses.

    @property
    def t_s(self) -> float:
        """Return the vehicle's clock."""
        return self.state.clock_s

    @property
    def gcs_silent_s(self) -> float:
        """Return how long no ground station's heartbeat came; inf before the first."""
        return self.state.clock_s - self._gcs_heard_s

    def send(self, message: Any | None) -> None:
        """Queue a message; None is nothing."""
        if message is not None:
            self._out.append(message)

    def send_id(self, message_id: int) -> bool:
        """Queue a message by id; False when there is no such message here."""
        builder = self.builders.get(message_id)
        if builder is not None:
            self.send(builder(self.state))
            return True
        own = self.own_message(message_id)
        self.send(own)
        return own is not None

    def own_message(self, message_id: int) -> Any | None:
        """Return a message that only this autopilot knows how to fill."""
        if message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return self.heartbeat()
        if message_id == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return self.autopilot_version()
        return None

    def text(self, severity: int, text: str) -> None:
        """Say something; it goes out after the acknowledgement of what caused it."""
        self._texts.append((severity, text))

    def hears_texts(self) -> bool:
        """Return whether the peer is one that is sent STATUSTEXT."""
        return True

    def _flush_texts(self) -> None:
        texts, self._texts = self._texts, []
        if not self.hears_texts():
            return
        for severity, text in texts:
            data = text.encode()
            chunks = [data[i : i + _TEXT_BYTES] for i in range(0, len(data), _TEXT_BYTES)]
            number = self._next_text_id(len(chunks))
            for seq, chunk in enumerate(chunks):
                self.send(mavlink.MAVLink_statustext_message(severity, chunk, number, seq))

    def _next_text_id(self, chunks: int) -> int:
        """Return the id that joins the chunks of a long text; 0 for a short one."""
        if chunks < 2:
            return 0
        self._text_id = self._text_id % 65535 + 1
        return self._text_id

    # Messages that both take alike.

    @on_message("HEARTBEAT")
    def _on_heartbeat(self, message: Any) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            self._gcs_heard_s = self.state.clock_s

    @on_message("TIMESYNC")
    def _on_timesync(self, message: Any) -> None:
        if message.tc1 == 0:
            self.send(mavlink.MAVLink_timesync_message(self.state.boot_us * 1000, message.ts1))

    @on_message("PING")
    def _on_ping(self, message: Any) -> None:
        if message.target_system == 0:
            self.send(
                mavlink.MAVLink_ping_message(
                    message.time_usec,
                    message.seq,
                    message.get_srcSystem(),
                    message.get_srcComponent(),
                )
            )

    @on_message("PARAM_REQUEST_LIST")
    def _on_parameter_list(self, _: Any) -> None:
        self._parameter_server.request_list()

    @on_message("PARAM_REQUEST_READ")
    def _on_parameter_read(self, message: Any) -> None:
        self._out.extend(self._parameter_server.read(message))

    @on_message("PARAM_SET")
    def _on_parameter_set(self, message: Any) -> None:
        name, answer = self._parameter_server.write(message)
        self._out.extend(answer)
        if name is not None:
            self.parameter_changed(name)

    def parameter_changed(self, name: str) -> None:
        """Take note of a parameter that was set."""

    @on_message("COMMAND_LONG")
    def _on_command_long(self, message: Any) -> None:
        self._do(from_long(message))

    @on_message("COMMAND_INT")
    def _on_command_int(self, message: Any) -> None:
        self._do(from_int(message))

    @on_message("SET_MODE")
    def _on_set_mode(self, message: Any) -> None:
        """Take the message that old ground stations send instead of the command."""
        custom = message.custom_mode
        mode, submode = self.split_mode(custom)
        self.set_mode(message.base_mode, mode, submode)

    def split_mode(self, custom_mode: int) -> tuple[int, int]:
        """Return (mode, submode) of a custom_mode."""
        return custom_mode, 0

    def _do(self, command: Command) -> None:
        name = self._commands.get(command.number)
        result = getattr(self, name)(command) if name is not None else UNSUPPORTED
        self.send(
            mavlink.MAVLink_command_ack_message(
                command.number, result, 0, 0, command.from_system, command.from_component
            )
        )

    # Commands that both do alike.

    @on_command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
    def _set_interval(self, command: Command) -> int:
        message_id, interval_us = int(command.params[0]), command.params[1]
        if message_id not in mavlink.mavlink_map:
            return DENIED
        if interval_us == 0.0:
            self.streams.reset_rate(message_id, now_s=self.t_s)
        else:
            rate_hz = 1e6 / interval_us if interval_us > 0.0 else 0.0
            self.streams.set_rate(message_id, rate_hz, now_s=self.t_s)
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL)
    def _get_interval(self, command: Command) -> int:
        message_id = int(command.params[0])
        interval_s = self.streams.interval_s(message_id)
        interval_us = -1 if interval_s is None else round(interval_s * 1e6)
        self.send(mavlink.MAVLink_message_interval_message(message_id, interval_us))
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_REQUEST_MESSAGE)
    def _request_message(self, command: Command) -> int:
        return ACCEPTED if self.send_id(int(command.params[0])) else FAILED

    @on_command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES)
    def _request_capabilities(self, _: Command) -> int:
        self.send(self.autopilot_version())
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_DO_SET_MODE)
    def _set_mode(self, command: Command) -> int:
        base_mode, mode, submode, _ = command.params
        return self.set_mode(int(base_mode), int(mode), int(submode))

    @on_command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    def _arm_disarm(self, command: Command) -> int:
        forced = self.is_forced(command)
        if command.params[0] == 1.0:
            return self.arm(force=forced)
        if command.params[0] == 0.0:
            return self.disarm(force=forced)
        return UNSUPPORTED

    @abstractmethod
    def is_forced(self, command: Command) -> bool:
        """Return whether an arm or disarm command skips the checks."""

    @on_command(mavlink.MAV_CMD_GET_HOME_POSITION)
    def _get_home(self, _: Command) -> int:
        home = telemetry.home_position(self.state)
        self.send(home)
        return ACCEPTED if home is not None else FAILED
