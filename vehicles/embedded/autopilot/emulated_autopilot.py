"""The base of both emulated autopilots: its parts, its loop, modes, arming and sticks.

What handles messages is a part of its own: parameters, files, logs, missions, streams.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.aircraft import EmulatedAircraft, FirmwareTraits
from wil_campaign.vehicles.embedded.autopilot.flight import telemetry
from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import AutopilotState
from wil_campaign.vehicles.embedded.autopilot.flight.flight import Flight, FlightStyle
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    FollowBehaviour,
    GuidanceBehaviour,
)
from wil_campaign.vehicles.embedded.autopilot.flight.manoeuvres import Manoeuvres
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import EmulatedMissionItem
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import load_parameters
from wil_campaign.vehicles.embedded.autopilot.flight.setpoint_targets import (
    RELATIVE_ALTITUDE_FRAMES,
)
from wil_campaign.vehicles.embedded.autopilot.flight.sticks import (
    FlyBySticks,
    StickLimits,
    Sticks,
    sticks_of_manual,
)
from wil_campaign.vehicles.embedded.autopilot.missions import Missions
from wil_campaign.vehicles.embedded.autopilot.services import discovery, mission_service
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    FAILED,
    UNSUPPORTED,
    ReceivedCommand,
    on_command,
    on_message,
    on_request,
)
from wil_campaign.vehicles.embedded.autopilot.services.fence_items import (
    EmulatedFence,
    emulated_fence,
)
from wil_campaign.vehicles.embedded.autopilot.services.file_service import FileService
from wil_campaign.vehicles.embedded.autopilot.services.log_service import FlightLogs
from wil_campaign.vehicles.embedded.autopilot.services.message_hub import MessageHub
from wil_campaign.vehicles.embedded.autopilot.services.outbox import CRITICAL, Outbox
from wil_campaign.vehicles.embedded.autopilot.services.parameter_service import ParameterService
from wil_campaign.vehicles.embedded.autopilot.services.stream_intervals import StreamIntervals
from wil_campaign.vehicles.mavlink.fence_areas import FenceItemError
from wil_campaign.vehicles.poses.truth import Thrusts
from wil_campaign.worlds.frames import Vec3

_EARLIEST_UNIX_US, _LATEST_UNIX_US = 1_230_768_000_000_000, 1 << 62
"""From 2009 on: an earlier time means a clock that was never set."""


_REBOOTS = {1.0, 3.0}
"""Param1 of PREFLIGHT_REBOOT_SHUTDOWN: reboot, and to the bootloader."""


class FlownMode(Protocol):
    """A firmware's flight mode (protocol)."""

    @property
    def is_manual(self) -> bool:
        """Return whether a pilot's sticks fly the mode."""


Mode = TypeVar("Mode", bound=FlownMode)


class StandardModes(NamedTuple, Generic[Mode]):
    """A firmware's modes for common commands: mission, return, land."""

    mission: Mode
    return_home: Mode
    land: Mode


class EmulatedAutopilot(ABC, Generic[Mode]):
    """An emulated autopilot between MAVLink messages and motor thrusts, with modes of one kind.

    Pure: `handle` takes messages, `step` takes the estimate and returns thrusts; messages to send
    are in `outbox`. Times are the vehicle's own clock, s since start. A firmware's class has its
    modes and failsafes; its further parts serve messages by `hub`.
    """

    name: ClassVar[str]
    """Of the autopilot, in campaigns."""
    builders: ClassVar[dict[int, telemetry.Builder]]
    style: ClassVar[FlightStyle]
    firmware: ClassVar[FirmwareTraits]
    standard: StandardModes[Mode]
    no_mission_items: ClassVar[int] = 0
    """MISSION_CURRENT.total without a mission."""
    manoeuvres: Manoeuvres
    follow: FollowBehaviour

    def __init__(
        self, aircraft: EmulatedAircraft, *, rates_hz: Mapping[int, float], mode: Mode
    ) -> None:
        self.identity = identity = aircraft.identity
        firmware = self.firmware
        airframe, dt_s = aircraft.airframe, aircraft.dt_s
        self.parameters = parameters = load_parameters(
            firmware.parameter_file, bytewise=firmware.bytewise, overrides=aircraft.overrides
        )
        self._body = body = aircraft.body
        self.state = AutopilotState(
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
        self.outbox = outbox = Outbox(count_all=firmware.numbers_texts)
        self.streams = StreamIntervals(rates_hz, shortest_s=dt_s)
        self.fence = EmulatedFence()
        self._item_lists = mission_service.MissionService(
            send=outbox.send,
            tell=outbox.send_text,
            clock=lambda: self.t_s,
            accept=self._accept_items,
            home=self._home_item if firmware.first_mission_item else None,
            rules=firmware.item_rules,
            go_to=self._go_to_item,
        )
        self.missions = Missions(self, self._item_lists, no_items=self.no_mission_items)
        self.logs = FlightLogs(
            send=outbox.send,
            begin=lambda t_us: firmware.log_format(t_us, parameters),
            first=firmware.first_log,
        )
        self._parameter_server = ParameterService(
            parameters, outbox, strict=firmware.strict_parameters
        )
        files = {path: partial(content, parameters) for path, content in firmware.files.items()}
        self.hub = MessageHub(
            system_id=identity.system_id,
            state=self.state,
            streams=self.streams,
            outbox=outbox,
            builders=self.builders,
            modes=firmware.mode_entries,
            rules=firmware.messages,
        )
        self.hub.serve(
            self.hub,
            self._parameter_server,
            FileService(files, outbox.send),
            self.logs,
            self._item_lists,
            self.missions,
            self,
        )
        self.mode = mode
        self.failsafe = False
        self.sticks: Sticks | None = None
        self.never_ready = False
        self.refusal: str | None = None
        """Injected faults: it never becomes ready; it refuses to arm for this reason."""
        self.reboot_requested = False
        self._configured = parameters.changes
        self.gcs_last_received_s = -math.inf
        """When a ground station's heartbeat was last received."""

    # What differs between the firmwares.

    @abstractmethod
    def supervise(self) -> None:
        """Check the emulated autopilot's modes, failsafes, readiness; at 50 Hz."""

    @abstractmethod
    def set_mode(self, mode: int, submode: int) -> int:
        """Execute MAV_CMD_DO_SET_MODE; return a MAV_RESULT."""

    @abstractmethod
    def choose(self, mode: Mode) -> int:
        """Switch the autopilot to the user's mode if it can run; return a MAV_RESULT."""

    @abstractmethod
    def stop_motors(self, by: str) -> None:
        """Disarm the autopilot now, and report why."""

    @abstractmethod
    def strike(self, thing: str) -> None:
        """Handle a collision of the airframe with an object: the motors stop."""

    @abstractmethod
    def lift(self, down_m: float) -> GuidanceBehaviour | None:
        """Return the behaviour before a mission's waypoint from the ground; or None."""

    @abstractmethod
    def _behaviour(self, mode: Mode) -> GuidanceBehaviour:
        """Return the behaviour that a mode flies from here."""

    @abstractmethod
    def _is_forced(self, command: ReceivedCommand) -> bool:
        """Return whether an arm or disarm command skips the checks."""

    @abstractmethod
    def _arming_fault(self, *, force: bool) -> str | None:
        """Return the autopilot's STATUSTEXT for why it does not arm; None when it does."""

    @abstractmethod
    def _begin_flight(self) -> None:
        """Set home, send texts and reset failsafes after arming, before the mode is flown."""

    @abstractmethod
    def _custom_mode(self) -> int:
        """Return the mode's number in the HEARTBEAT."""

    @abstractmethod
    def _base_mode(self) -> int:
        """Return the flags of the HEARTBEAT, without the armed one."""

    @abstractmethod
    def _system_status(self) -> int:
        """Return the MAV_STATE of the HEARTBEAT."""

    @abstractmethod
    def _disarm_delay_s(self, *, after_flight: bool) -> float:
        """Return how long it stays armed on the ground; 0 means forever."""

    @abstractmethod
    def _stick_limits(self) -> StickLimits:
        """Return the demand of fully deflected sticks."""

    @abstractmethod
    def _sticks_last_s(self) -> float:
        """Return how long received sticks are valid."""

    def mission_fault(self, items: tuple[EmulatedMissionItem, ...]) -> str | None:  # noqa: ARG002 - PX4 looks at them
        """Return the text for why the firmware does not fly a mission; None when it does."""
        return None

    @property
    def takes_speeds(self) -> bool:
        """Return whether the mode takes a change of speed by command."""
        return True

    @property
    def flies_by_speeds(self) -> bool:
        """Return whether a changed speed holds for what is flown now."""
        return True

    def return_home(self) -> GuidanceBehaviour:
        """Return the behaviour that flies home."""
        return self.manoeuvres.go_home()

    def look_at(self, latitude_deg: float, longitude_deg: float) -> None:
        """Look at a region of interest: without a gimbal only ArduCopter's heading follows it."""

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

    def _go_to_item(self, item: EmulatedMissionItem) -> int:  # noqa: ARG002 - ArduCopter looks at it
        """Fly to a MISSION_ITEM at once ("guided" item); return a MAV_MISSION_RESULT."""
        return int(mavlink.MAV_MISSION_ERROR)

    def _report_not_landed(self) -> None:
        """Send a text that it is not disarmed in flight; ArduCopter sends none."""

    def _stays_armed(self) -> bool:
        """Return whether the vehicle is about to leave the ground."""
        return self.flight.takeoff_detected

    # The loop.

    def handle(self, message: Any, arrived_s: float) -> None:
        """Handle one MAVLink message; messages to other systems are ignored.

        arrived_s: its time of arrival, after the last step and before the next.
        """
        self.hub.handle(message, arrived_s)

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
            self._item_lists.turn(clock_s)
            self.logs.turn(clock_s, armed=self.flight.armed, now=state.now)
            self._parameter_server.turn()
            self.outbox.turn(send_texts=self._sends_texts())
        thrusts = state.thrusts = self.flight.step(state, flown=body.flown)
        state.target = self.flight.target
        if clock_s >= self.streams.next_due_s:
            self.hub.send_due()
        return thrusts

    @property
    def t_s(self) -> float:
        """Return the emulated autopilot's clock."""
        return self.state.clock_s

    def _take_gps_time(self) -> None:
        state = self.state
        if state.gps_unix_offset_us is not None and state.clock_s >= self.firmware.gps_time_s:
            state.unix_offset_us = state.gps_unix_offset_us

    @on_message("SYSTEM_TIME")
    def _on_system_time(self, message: Any) -> None:
        """Set the time of day from a companion computer or a GCS; GPS time has priority."""
        if _EARLIEST_UNIX_US < message.time_unix_usec < _LATEST_UNIX_US:
            self.state.unix_offset_us = message.time_unix_usec - self.state.boot_us

    @on_message("HEARTBEAT")
    def _on_heartbeat(self, message: Any) -> None:
        if self._is_own_gcs(message):
            self.gcs_last_received_s = self.t_s

    @on_request(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
    def _heartbeat(self) -> Any:
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.flight.armed else 0
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            self.firmware.mav_autopilot,
            self._base_mode() | armed,
            self._custom_mode(),
            self._system_status(),
            3,
        )

    @on_command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN)
    def _reboot(self, command: ReceivedCommand) -> int:
        if self.flight.armed:
            return FAILED
        if command.params[0] not in _REBOOTS:
            return UNSUPPORTED
        self.reboot_requested = True
        return ACCEPTED

    # Modes.

    @property
    def flies_missions(self) -> bool:
        """Return whether the mode is that of missions."""
        return self.mode == self.standard.mission

    def enter(self, mode: Mode) -> None:
        """Enter a mode and fly it."""
        if mode != self.mode:
            self.manoeuvres.forget_speeds()
        self.mode = mode
        if self.flight.armed:
            self.flight.fly(self._behaviour(mode))

    @on_request(discovery.CURRENT_MODE)
    def _current_mode(self) -> Any:
        return discovery.current_mode(self.firmware.mode_entries, self._custom_mode())

    @on_message("SET_MODE")
    def _on_set_mode(self, message: Any) -> None:
        """Handle SET_MODE, which old ground stations send."""
        result = self._mode_result(message.base_mode, *self._split_mode(message.custom_mode))
        if self.firmware.set_mode_ack is not None:
            peer = (message.get_srcSystem(), message.get_srcComponent())
            self.hub.acknowledge(self.firmware.set_mode_ack, result, peer)

    @on_command(mavlink.MAV_CMD_DO_SET_MODE)
    def _set_mode(self, command: ReceivedCommand) -> int:
        return self._mode_result(command.whole(0), command.whole(1), command.whole(2))

    def _mode_result(self, base_mode: int, mode: int, submode: int) -> int:
        if base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return self.set_mode(mode, submode)
        return self.set_base_mode(base_mode)

    def set_base_mode(self, base_mode: int) -> int:  # noqa: ARG002 - PX4 looks at it
        """Set the mode by MAV_MODE_FLAGs, without a custom mode; return a MAV_RESULT."""
        return DENIED

    @on_command(mavlink.MAV_CMD_NAV_LAND)
    def _land(self, _: ReceivedCommand) -> int:
        return self.choose(self.standard.land)

    @on_command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    def _return(self, _: ReceivedCommand) -> int:
        return self.choose(self.standard.return_home)

    # Arming.

    @on_command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    def _arm_disarm(self, command: ReceivedCommand) -> int:
        forced, action = self._is_forced(command), self._arming_action(command.params[0])
        if action == 1.0:
            return self.arm(force=forced)
        if action == 0.0:
            return self.disarm(force=forced)
        return UNSUPPORTED

    def _arming_action(self, number: float) -> float:
        """Return 1 to arm, 0 to disarm, of a command's number; PX4 rounds it."""
        return number

    def arm(self, *, force: bool) -> int:
        """Arm if the checks pass; the firmware decides which checks `force` skips."""
        if self.flight.armed:
            return ACCEPTED
        fault = self._arming_fault(force=force)
        if fault is not None:
            self.outbox.send_text(CRITICAL, fault)
            return self.firmware.refused
        self.flight.arm(self.t_s)
        self.failsafe = False
        self._begin_flight()
        self.enter(self.mode)
        return ACCEPTED

    def disarm(self, *, force: bool) -> int:
        """Disarm on the ground, in the air only by force."""
        if not self.flight.armed:
            return ACCEPTED
        if not (self._is_on_ground or force):
            self._report_not_landed()
            return self.firmware.refused
        self.stop_motors("external command")
        return ACCEPTED

    @property
    def _is_on_ground(self) -> bool:
        """Return whether the firmware disarms here without force."""
        return self.flight.landed

    def _disarm_when_due(self) -> None:
        flight = self.flight
        if not flight.armed or not flight.landed or self._stays_armed():
            return
        landed_at_s = flight.landed_at_s
        since_s = flight.armed_at_s if landed_at_s is None else landed_at_s
        if 0.0 < self._disarm_delay_s(after_flight=landed_at_s is not None) <= self.t_s - since_s:
            self.stop_motors("auto preflight disarming" if landed_at_s is None else "landing")

    # Sticks.

    def fresh_sticks(self) -> Sticks | None:
        """Return the pilot's sticks; None when there are none, or they are stale."""
        sticks = self.sticks
        if sticks is None or self.t_s - sticks.at_s > self._sticks_last_s():
            return None
        return sticks

    @on_message("MANUAL_CONTROL")
    def _on_manual_control(self, message: Any) -> None:
        if message.target in {0, self.identity.system_id}:
            self._take_sticks(
                sticks_of_manual(message.x, message.y, message.z, message.r, at_s=self.t_s)
            )

    def _take_sticks(self, sticks: Sticks | None) -> None:
        self.sticks = sticks
        flown = isinstance(self.flight.behaviour, FlyBySticks)
        if self.flight.armed and self.mode.is_manual and not flown:
            self.flight.fly(self._by_sticks())

    def _by_sticks(self) -> GuidanceBehaviour:
        return FlyBySticks(
            sticks=self.fresh_sticks,
            limits=self._stick_limits(),
            yaw_rad=self.state.now.euler_rad[2],
        )

    # Places, missions and fences.

    def place_of(self, command: ReceivedCommand) -> Vec3:
        """Return a command's position, local; values that are not finite mean the present ones."""
        state = self.state
        here = state.frame.to_geodetic(state.now.position_ned_m)
        altitude_m = command.z
        if command.frame in RELATIVE_ALTITUDE_FRAMES and self.firmware.heights_relative:
            altitude_m += state.frame.altitude_m - state.home_down_m
        return state.frame.to_ned(
            command.x if math.isfinite(command.x) else here.latitude_deg,
            command.y if math.isfinite(command.y) else here.longitude_deg,
            altitude_m if math.isfinite(altitude_m) else here.altitude_m,
        )

    @on_command(mavlink.MAV_CMD_DO_SET_HOME)
    def _set_home(self, command: ReceivedCommand) -> int:
        if self._sets_home_here(command):
            self.state.home_ned_m = self.state.now.position_ned_m
        elif command.has_place:
            self.state.home_ned_m = self.place_of(command)
        else:
            return DENIED
        self.outbox.send_later(telemetry.home_position(self.state))
        return ACCEPTED

    @abstractmethod
    def _sets_home_here(self, command: ReceivedCommand) -> bool:
        """Return whether DO_SET_HOME means the present place."""

    def _accept_items(self, kind: int, items: tuple[EmulatedMissionItem, ...]) -> int:
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
            self.missions.accept(items)
        return mission_service.ACCEPTED

    def _home_item(self) -> EmulatedMissionItem:
        frame, home = self.state.frame, self.state.home_ned_m
        here = frame.to_geodetic(home or (0.0, 0.0, 0.0))
        return EmulatedMissionItem(
            mavlink.MAV_FRAME_GLOBAL,
            mavlink.MAV_CMD_NAV_WAYPOINT,
            (0.0, 0.0, 0.0, 0.0),
            round(here.latitude_deg * 1e7),
            round(here.longitude_deg * 1e7),
            here.altitude_m,
        )
