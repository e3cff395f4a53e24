"""How both emulated autopilots fly and report missions: start, jump, speeds, landing."""

from typing import Any, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.aircraft import FirmwareTraits
from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import AutopilotState
from wil_campaign.vehicles.embedded.autopilot.flight.flight import Flight
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import GuidanceBehaviour
from wil_campaign.vehicles.embedded.autopilot.flight.manoeuvres import Manoeuvres
from wil_campaign.vehicles.embedded.autopilot.flight.mission_flight import (
    LOOKS,
    FlyMission,
    MissionMakers,
)
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import EmulatedMissionItem
from wil_campaign.vehicles.embedded.autopilot.flight.places import is_on_globe
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    FAILED,
    ReceivedCommand,
    on_command,
    on_message,
    on_request,
)
from wil_campaign.vehicles.embedded.autopilot.services.mission_service import (
    MISSION,
    MissionService,
)
from wil_campaign.vehicles.embedded.autopilot.services.outbox import CRITICAL, Outbox


class MissionAutopilot(Protocol):
    """The autopilot that flies missions (protocol)."""

    state: AutopilotState
    flight: Flight
    outbox: Outbox
    manoeuvres: Manoeuvres

    @property
    def firmware(self) -> FirmwareTraits:
        """Return what the firmware has."""

    @property
    def flies_missions(self) -> bool:
        """Return whether the mode is that of missions."""

    @property
    def takes_speeds(self) -> bool:
        """Return whether the mode takes a change of speed by command."""

    @property
    def flies_by_speeds(self) -> bool:
        """Return whether a changed speed holds for what is flown now."""

    def mission_fault(self, items: tuple[EmulatedMissionItem, ...]) -> str | None:
        """Return the text for why the firmware does not fly a mission; None when it does."""

    def return_home(self) -> GuidanceBehaviour:
        """Return the behaviour that flies home."""

    def lift(self, down_m: float) -> GuidanceBehaviour | None:
        """Return the behaviour before a mission's waypoint from the ground; or None."""

    def look_at(self, latitude_deg: float, longitude_deg: float) -> None:
        """Look at a region of interest from now on; at 0, 0 there is none."""


class Missions:
    """The uploaded mission of an emulated autopilot: as it is flown and reported.

    no_items: MISSION_CURRENT.total without a mission.
    """

    def __init__(
        self, autopilot: MissionAutopilot, service: MissionService, *, no_items: int
    ) -> None:
        self._autopilot = autopilot
        self._service = service
        self._no_items = no_items
        self._first_item = autopilot.firmware.first_mission_item
        self._has_begun = self._is_complete = self._is_refused = False

    @property
    def items(self) -> tuple[EmulatedMissionItem, ...]:
        """Return the items; of ArduPilot, item 0 is home."""
        return self._service.items(MISSION)

    @property
    def is_uploaded(self) -> bool:
        """Return whether the autopilot has a user's mission that it flies."""
        return not self._is_refused and self._autopilot.state.mission_total > self._first_item

    def accept(self, items: tuple[EmulatedMissionItem, ...]) -> None:
        """Note an uploaded mission."""
        state, fault = self._autopilot.state, self._autopilot.mission_fault(items)
        self._is_refused = fault is not None
        if fault is not None:
            self._autopilot.outbox.send_text(CRITICAL, f"{fault}\t")
        state.mission_seq, state.mission_total = 0, len(items)
        self._has_begun = self._is_complete = False

    # Flying.

    def begin(self) -> GuidanceBehaviour:
        """Return the behaviour of the uploaded mission, from the current item on."""
        autopilot, state = self._autopilot, self._autopilot.state
        if self._is_complete:
            state.mission_seq = 0
        self._has_begun, self._is_complete = True, False
        return FlyMission(
            items=self.items,
            first=max(self._first_item, state.mission_seq),
            state=state,
            makers=MissionMakers(autopilot.manoeuvres, autopilot.return_home, autopilot.lift),
            events=self,
        )

    @property
    def _flown(self) -> FlyMission | None:
        flight = self._autopilot.flight
        behaviour = flight.behaviour
        return behaviour if isinstance(behaviour, FlyMission) and flight.armed else None

    def watch(self) -> None:
        """Mark the current item as reached when the mission has landed."""
        flight = self._autopilot.flight
        if flight.landed and flight.landed_at_s is not None:
            mission = self._flown
            if mission is not None:
                mission.receive_landing()

    def begin_item(self, seq: int) -> None:
        """Note that the autopilot now flies this mission item."""
        self._autopilot.state.mission_seq = seq

    def reach_item(self, seq: int) -> None:
        """Report that a mission item is reached."""
        self._autopilot.outbox.send(mavlink.MAVLink_mission_item_reached_message(seq))

    def finish_mission(self) -> None:
        """Note that the mission's last item is reached."""
        self._is_complete = True

    def look_at(self, latitude_deg: float, longitude_deg: float) -> None:
        """Look at a region of interest from now on; at 0, 0 there is none."""
        self._autopilot.look_at(latitude_deg, longitude_deg)

    # Messages and commands.

    @on_command(*LOOKS)
    def _look(self, command: ReceivedCommand) -> int:
        if command.number == mavlink.MAV_CMD_DO_SET_ROI_NONE:
            self.look_at(0.0, 0.0)
        elif is_on_globe(command.x, command.y):
            self.look_at(command.x, command.y)
        else:
            return FAILED
        return ACCEPTED

    @on_request(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)
    def _mission_current(self) -> Any:
        autopilot, is_on = self._autopilot, self._autopilot.flies_missions
        total = max(0, autopilot.state.mission_total - self._first_item)
        return mavlink.MAVLink_mission_current_message(
            autopilot.state.mission_seq,
            total or self._no_items,
            self._mission_state(is_on=is_on),
            1 if is_on else autopilot.firmware.other_mode,
        )

    def _mission_state(self, *, is_on: bool) -> int:
        if not self.is_uploaded:
            return int(mavlink.MISSION_STATE_NO_MISSION)
        if self._is_complete:
            return int(mavlink.MISSION_STATE_COMPLETE)
        if not self._has_begun:
            return int(mavlink.MISSION_STATE_NOT_STARTED)
        active = is_on and self._flown is not None
        return int(mavlink.MISSION_STATE_ACTIVE if active else mavlink.MISSION_STATE_PAUSED)

    @on_message("MISSION_SET_CURRENT")
    def _on_mission_set_current(self, message: Any) -> None:
        self.set_current(message.seq)
        self._autopilot.outbox.send(self._mission_current())

    @on_command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT)
    def _do_set_current(self, command: ReceivedCommand) -> int:
        if command.params[1] == 1.0:
            self._has_begun = self._is_complete = False
        seq = command.whole(0)
        if self._first_item:
            return ACCEPTED if self.set_current(seq) else DENIED
        return ACCEPTED if seq == -1 or self.set_current(seq) else FAILED

    def set_current(self, seq: int) -> bool:
        """Go on with this item; return False where there is none."""
        if not 0 <= seq < self._autopilot.state.mission_total:
            return False
        self._autopilot.state.mission_seq = seq
        self._is_complete = False
        mission = self._flown
        if mission is not None:
            mission.jump_to(max(seq, self._first_item))
        return True

    @on_command(mavlink.MAV_CMD_DO_CHANGE_SPEED)
    def _change_speed(self, command: ReceivedCommand) -> int:
        autopilot = self._autopilot
        kind, speed_m_s = command.params[0], command.params[1]
        if not autopilot.takes_speeds or not autopilot.manoeuvres.change_speed(kind, speed_m_s):
            return FAILED
        behaviour = autopilot.flight.behaviour
        if behaviour is not None and autopilot.flies_by_speeds:
            behaviour.change_speeds(autopilot.manoeuvres.speeds())
        return ACCEPTED
