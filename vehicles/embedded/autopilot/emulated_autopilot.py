"""The base of both emulated autopilots: MAVLink in and out, common commands and services."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight import telemetry
from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import Identity, State
from wil_campaign.vehicles.embedded.autopilot.flight.flight import Flight, FlightStyle
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import Item, ItemRules
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import Parameters
from wil_campaign.vehicles.embedded.autopilot.services import discovery, mission_service
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    FAILED,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Command,
    from_int,
    from_long,
    marked,
    on_command,
    on_message,
)
from wil_campaign.vehicles.embedded.autopilot.services.fence_items import (
    EmulatedFence,
    emulated_fence,
)
from wil_campaign.vehicles.embedded.autopilot.services.file_service import FileService
from wil_campaign.vehicles.embedded.autopilot.services.log_formats import LogWriter
from wil_campaign.vehicles.embedded.autopilot.services.log_service import FlightLogs
from wil_campaign.vehicles.embedded.autopilot.services.outbox import INFO, Outbox
from wil_campaign.vehicles.embedded.autopilot.services.parameter_service import ParameterService
from wil_campaign.vehicles.embedded.autopilot.services.stream_intervals import StreamIntervals
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.physics.body import Body
from wil_campaign.vehicles.mavlink.fence_areas import FenceItemError
from wil_campaign.vehicles.poses.truth import Thrusts

COMPONENT: int = mavlink.MAV_COMP_ID_AUTOPILOT1
_EARLIEST_UNIX_US, _LATEST_UNIX_US = 1_230_768_000_000_000, 1 << 62
"""From 2009 on: an earlier time means a clock that was never set."""
_HIGHEST_INTERVAL_ID = 65535
"""Message ids in MESSAGE_INTERVAL have 16 bits."""
_LONGEST_INTERVAL_US = 2**31 - 1
"""Intervals in MESSAGE_INTERVAL are signed 32-bit integers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Aircraft:
    """What an emulated autopilot flies. overrides: of its parameters. dt_s: of a physics step.

    full_streams: whether it sends all streams of the firmware, not only those that a run needs.
    body: its simulator's ground truth is the autopilot's, and its step runs the law.
    """

    identity: Identity
    airframe: Airframe
    dt_s: float
    body: Body
    overrides: Mapping[str, float]
    full_streams: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Firmware:
    """What a firmware has, and how it differs in services that both have.

    mode_entries: in AVAILABLE_MODES. other_mode: MISSION_CURRENT.mission_mode outside of missions.
    first_mission_item: 1 where item 0 is home. refused: MAV_RESULT of an arm or disarm command that
    the checks refuse. set_mode_ack: what acknowledges SET_MODE. gps_time_s: when the GPS receiver
    has the time of day, s since boot. numbers_texts: gives each STATUSTEXT an id. bytewise: an
    integer parameter's bits travel in the float field. strict_parameters: see
    `ParameterService`. files: served over MAVLink, by path. heights_relative: reads the
    height of a command by its frame, not always as above mean sea level.
    """

    mav_autopilot: int
    parameter_file: Path
    bytewise: bool
    strict_parameters: bool
    files: Mapping[str, Callable[[Parameters], bytes]]
    item_rules: ItemRules
    first_mission_item: int
    mode_entries: tuple[discovery.ModeEntry, ...]
    other_mode: int
    refused: int
    set_mode_ack: int
    heights_relative: bool
    numbers_texts: bool
    log_format: Callable[[int, Parameters], LogWriter]
    first_log: int
    gps_time_s: float


class EmulatedAutopilot(ABC):
    """An emulated autopilot between MAVLink messages and motor thrusts.

    Pure: `handle` takes messages, `step` takes the estimate and returns thrusts; messages to send
    are in `outbox`. Times are the vehicle's own clock, s since start.
    """

    name: ClassVar[str]
    """Of the autopilot, in campaigns."""
    builders: ClassVar[dict[int, telemetry.Builder]]
    style: ClassVar[FlightStyle]
    firmware: ClassVar[Firmware]

    def __init__(
        self, aircraft: Aircraft, *, parameters: Parameters, rates_hz: Mapping[int, float]
    ) -> None:
        self.identity = identity = aircraft.identity
        firmware = self.firmware
        airframe, dt_s = aircraft.airframe, aircraft.dt_s
        self.parameters = parameters
        self._body = body = aircraft.body
        self.state = State(
            frame=identity.origin,
            charge=body.battery.charge,
            estimate=body.estimate,
            simulator=lambda: body.truth,
            max_thrust_n=airframe.max_thrust_n,
        )
        self.flight = Flight(
            style=self.style,
            airframe=airframe,
            dt_s=dt_s,
            parameters=parameters,
            law_array=body.law_array,
        )
        body.flown_by(self.style.law.advance)
        self.streams = StreamIntervals(rates_hz, shortest_s=dt_s)
        self.outbox = Outbox(count_all=firmware.numbers_texts)
        self.fence = EmulatedFence()
        self.missions = mission_service.MissionService(
            send=self.outbox.send,
            accept=self._accept_items,
            home=self._home_item if firmware.first_mission_item else None,
            rules=firmware.item_rules,
            go_to=self._go_to_item,
        )
        self.files = FileService(
            {path: partial(content, parameters) for path, content in firmware.files.items()}
        )
        self.logs = FlightLogs(
            send=self.outbox.send,
            begin=lambda t_us: firmware.log_format(t_us, parameters),
            first=firmware.first_log,
        )
        self.never_ready = False
        self.refusal: str | None = None
        """Injected faults: it never becomes ready; it refuses to arm for this reason."""
        self.reboot_requested = False
        self._configured = parameters.changes
        self._arrived_s = 0.0
        self._announced_unused: set[str] = set()
        self._parameter_server = ParameterService(parameters, strict=firmware.strict_parameters)
        self._commands = marked(type(self), "mav_commands")
        self._messages = marked(type(self), "mav_messages")
        self._requests = marked(type(self), "mav_requests")
        self.gcs_last_received_s = -math.inf
        """When a ground station's heartbeat was last received."""

    # What differs between the autopilots.

    @abstractmethod
    def supervise(self) -> None:
        """Check the emulated autopilot's modes, failsafes, readiness; at 50 Hz."""

    @abstractmethod
    def set_mode(self, mode: int, submode: int) -> int:
        """Execute MAV_CMD_DO_SET_MODE; return a MAV_RESULT."""

    @abstractmethod
    def arm(self, *, force: bool) -> int:
        """Arm the emulated autopilot; return a MAV_RESULT."""

    @abstractmethod
    def disarm(self, *, force: bool) -> int:
        """Disarm the emulated autopilot; return a MAV_RESULT."""

    @abstractmethod
    def strike(self, thing: str) -> None:
        """Handle a collision of the airframe with an object: the motors stop."""

    @abstractmethod
    def _is_forced(self, command: Command) -> bool:
        """Return whether an arm or disarm command skips the checks."""

    def _is_own_gcs(self, heartbeat: Any) -> bool:
        """Return whether a HEARTBEAT is of a ground station whose silence is a failsafe."""
        return bool(heartbeat.type == mavlink.MAV_TYPE_GCS)

    def _sends_texts(self) -> bool:
        return True

    def _split_mode(self, custom_mode: int) -> tuple[int, int]:
        """Return (mode, submode) of a custom_mode."""
        return custom_mode, 0

    def _fence_result(self, fence: EmulatedFence) -> int:  # noqa: ARG002 - subclasses look at it
        """Return the MAV_MISSION_RESULT of an uploaded fence."""
        return mission_service.ACCEPTED

    def _go_to_item(self, item: Item) -> int:  # noqa: ARG002 - ArduCopter looks at it
        """Fly to a MISSION_ITEM at once ("guided" item); return a MAV_MISSION_RESULT."""
        return int(mavlink.MAV_MISSION_ERROR)

    # The loop.

    def handle(self, message: Any, arrived_s: float) -> None:
        """Handle one MAVLink message; messages to other systems are ignored.

        arrived_s: its time of arrival, after the last step and before the next.
        """
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        if system not in {0, self.identity.system_id} or component not in {0, COMPONENT}:
            return
        name = self._messages.get(message.get_type())
        if name is not None:
            self._arrived_s = arrived_s
            getattr(self, name)(message)
            self.outbox.release()

    def step(self, clock_s: float, *, turn: bool) -> Thrusts:
        """Return the thrusts after a step of the body; `turn` marks every 20 ms."""
        state, body = self.state, self._body
        state.known = None
        state.clock_s = clock_s
        state.touching = body.touching
        state.charge = body.battery.charge
        if turn:
            if self.parameters.changes != self._configured:
                self._configured = self.parameters.changes
                self.flight.law.configure(self.parameters)
            self.supervise()
            self._take_gps_time()
            self.missions.turn(clock_s)
            self.logs.turn(clock_s, armed=self.flight.armed, now=state.now)
            for message in self._parameter_server.due():
                self.outbox.send(message)
            self.outbox.turn(send_texts=self._sends_texts())
        thrusts = state.thrusts = self.flight.step(state, flown=body.flown)
        state.target = self.flight.target
        if clock_s >= self.streams.next_due_s:
            for message_id in self.streams.due(clock_s):
                self._send_id(message_id)
        return thrusts

    @property
    def t_s(self) -> float:
        """Return the emulated autopilot's clock."""
        return self.state.clock_s

    def _send_id(self, message_id: int) -> bool:
        """Queue a message by id; False when the autopilot has none, or not yet."""
        builder, name = self.builders.get(message_id), self._requests.get(message_id)
        if builder is not None:
            message = builder(self.state)
        else:
            message = getattr(self, name)() if name is not None else None
        self.outbox.send(message)
        return message is not None

    def _take_gps_time(self) -> None:
        state = self.state
        if state.gps_unix_offset_us is not None and state.clock_s >= self.firmware.gps_time_s:
            state.unix_offset_us = state.gps_unix_offset_us

    # Messages that both handle alike.

    @on_message("HEARTBEAT")
    def _on_heartbeat(self, message: Any) -> None:
        if self._is_own_gcs(message):
            self.gcs_last_received_s = self.t_s

    @on_message("TIMESYNC")
    def _on_timesync(self, message: Any) -> None:
        if message.tc1 == 0:
            now_ns = self.state.stamp_us(self._arrived_s) * 1000
            self.outbox.send(mavlink.MAVLink_timesync_message(now_ns, message.ts1))

    @on_message("PING")
    def _on_ping(self, message: Any) -> None:
        if message.target_system == 0:
            peer = (message.get_srcSystem(), message.get_srcComponent())
            self.outbox.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *peer))

    @on_message("SYSTEM_TIME")
    def _on_system_time(self, message: Any) -> None:
        """Set the time of day from a companion computer or a GCS; GPS time has priority."""
        if _EARLIEST_UNIX_US < message.time_unix_usec < _LATEST_UNIX_US:
            self.state.unix_offset_us = message.time_unix_usec - self.state.boot_us

    @on_message("FILE_TRANSFER_PROTOCOL")
    def _on_file_transfer(self, message: Any) -> None:
        for answer in self.files.answers(message):
            self.outbox.send(answer)

    @on_message("LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOG_ERASE")
    def _on_logs(self, message: Any) -> None:
        self.logs.handle(message)

    @on_message("PARAM_REQUEST_LIST")
    def _on_parameter_list(self, _: Any) -> None:
        self._parameter_server.request_list()

    @on_message("PARAM_REQUEST_READ")
    def _on_parameter_read(self, message: Any) -> None:
        for answer in self._parameter_server.read(message):
            self.outbox.send(answer)

    @on_message("PARAM_SET")
    def _on_parameter_set(self, message: Any) -> None:
        for answer in self._parameter_server.write(message):
            self.outbox.send(answer)
        name = message.param_id
        if name in self.parameters and self.parameters.is_in_vain(name):
            self._announce_unused(name)

    def _announce_unused(self, name: str) -> None:
        """Send a STATUSTEXT, once, that nothing acts on a parameter."""
        if name not in self._announced_unused:
            self._announced_unused.add(name)
            self.outbox.send_text(INFO, f"{name} has no effect in this emulation")

    @on_message(
        "MISSION_COUNT",
        "MISSION_ITEM_INT",
        "MISSION_ITEM",
        "MISSION_REQUEST_LIST",
        "MISSION_REQUEST_INT",
        "MISSION_REQUEST",
        "MISSION_CLEAR_ALL",
    )
    def _on_mission(self, message: Any) -> None:
        self.missions.handle(message, self.t_s)

    @on_message("COMMAND_LONG")
    def _on_command_long(self, message: Any) -> None:
        self._do(from_long(message))

    @on_message("COMMAND_INT")
    def _on_command_int(self, message: Any) -> None:
        self._do(from_int(message))

    @on_message("SET_MODE")
    def _on_set_mode(self, message: Any) -> None:
        """Handle SET_MODE, which old ground stations send."""
        custom = message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        result = self.set_mode(*self._split_mode(message.custom_mode)) if custom else DENIED
        self.outbox.send(
            mavlink.MAVLink_command_ack_message(
                self.firmware.set_mode_ack,
                result,
                0,
                0,
                message.get_srcSystem(),
                message.get_srcComponent(),
            )
        )

    def _do(self, command: Command) -> None:
        name = self._commands.get(command.number)
        result = getattr(self, name)(command) if name is not None else UNSUPPORTED
        self.outbox.send(
            mavlink.MAVLink_command_ack_message(
                command.number, result, 0, 0, command.from_system, command.from_component
            )
        )

    # Commands that both handle alike.

    @on_command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
    def _set_interval(self, command: Command) -> int:
        number, interval_us = command.whole(0), command.params[1]
        if number not in mavlink.mavlink_map or math.isnan(interval_us):
            return DENIED
        if interval_us == 0.0:
            self.streams.reset_rate(number, now_s=self.t_s)
        else:
            rate_hz = 1e6 / interval_us if interval_us > 0.0 else 0.0
            self.streams.set_rate(number, rate_hz, now_s=self.t_s)
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL)
    def _get_interval(self, command: Command) -> int:
        message_id = command.whole(0)
        if not 0 <= message_id <= _HIGHEST_INTERVAL_ID:
            return DENIED
        interval_s = self.streams.interval_s(message_id)
        interval_us = -1
        if interval_s is not None:
            interval_us = round(min(interval_s * 1e6, _LONGEST_INTERVAL_US))
        self.outbox.send(mavlink.MAVLink_message_interval_message(message_id, interval_us))
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_REQUEST_MESSAGE)
    def _request_message(self, command: Command) -> int:
        message_id = command.whole(0)
        if message_id == discovery.AVAILABLE_MODES:
            modes = discovery.available_modes(self.firmware.mode_entries, command.whole(1))
            for message in modes:
                self.outbox.send_later(message)
            return ACCEPTED if modes else FAILED
        return ACCEPTED if self._send_id(message_id) else FAILED

    @on_command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES)
    def _request_capabilities(self, _: Command) -> int:
        self._send_id(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_DO_SET_MODE)
    def _set_mode(self, command: Command) -> int:
        if not command.whole(0) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return DENIED
        return self.set_mode(command.whole(1), command.whole(2))

    @on_command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    def _arm_disarm(self, command: Command) -> int:
        forced = self._is_forced(command)
        if command.params[0] == 1.0:
            return self.arm(force=forced)
        if command.params[0] == 0.0:
            return self.disarm(force=forced)
        return UNSUPPORTED

    @on_command(mavlink.MAV_CMD_GET_HOME_POSITION)
    def _get_home(self, _: Command) -> int:
        return ACCEPTED if self._send_id(mavlink.MAVLINK_MSG_ID_HOME_POSITION) else FAILED

    @on_command(mavlink.MAV_CMD_DO_SET_HOME)
    def _set_home(self, command: Command) -> int:
        if command.params[0] == 1.0:
            self.state.home_ned_m = self.state.now.position_ned_m
        elif command.has_place:
            self.state.home_ned_m = self.state.frame.to_ned(command.x, command.y, command.z)
        else:
            return DENIED
        self.outbox.send_later(telemetry.home_position(self.state))
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN)
    def _reboot(self, command: Command) -> int:
        if self.flight.armed:
            return TEMPORARILY_REJECTED
        if command.params[0] != 1.0:
            return UNSUPPORTED
        self.reboot_requested = True
        return ACCEPTED

    # Missions and fences.

    def _accept_items(self, kind: int, items: tuple[Item, ...]) -> int:
        if kind == mission_service.FENCE:
            try:
                fence = emulated_fence(items, self.state.frame)
            except FenceItemError:
                return int(mavlink.MAV_MISSION_INVALID)
            result = self._fence_result(fence)
            if result == mission_service.ACCEPTED:
                self.fence = fence
            return result
        if kind == mission_service.MISSION:
            self.state.mission_seq = 0
            self.state.mission_total = len(items)
        return mission_service.ACCEPTED

    def _home_item(self) -> Item:
        frame, home = self.state.frame, self.state.home_ned_m
        here = frame.to_geodetic(home or (0.0, 0.0, 0.0))
        return Item(
            mavlink.MAV_FRAME_GLOBAL,
            mavlink.MAV_CMD_NAV_WAYPOINT,
            (0.0, 0.0, 0.0, 0.0),
            round(here.latitude_deg * 1e7),
            round(here.longitude_deg * 1e7),
            here.altitude_m,
        )
