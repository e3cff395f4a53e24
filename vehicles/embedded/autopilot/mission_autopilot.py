"""How both emulated autopilots fly and report missions: start, jump, speeds, landing."""

import math
from abc import abstractmethod
from typing import Any, Generic

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.guidance import Behaviour
from wil_campaign.vehicles.embedded.autopilot.flight.mission_flight import (
    LOOKS,
    FlyMission,
    MissionMakers,
)
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import Item
from wil_campaign.vehicles.embedded.autopilot.flight.places import is_on_globe
from wil_campaign.vehicles.embedded.autopilot.flying_autopilot import FlyingAutopilot, Mode
from wil_campaign.vehicles.embedded.autopilot.services import mission_service
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    FAILED,
    Command,
    on_command,
    on_message,
    on_request,
)


class MissionAutopilot(FlyingAutopilot[Mode], Generic[Mode]):
    """An emulated autopilot that flies uploaded missions."""

    mission_begun = False
    mission_complete = False

    @abstractmethod
    def _lift(self, down_m: float) -> Behaviour | None:
        """Return the behaviour before a mission's waypoint from the ground; or None."""

    @property
    def has_mission(self) -> bool:
        """Return whether the autopilot has a user's mission."""
        return self.state.mission_total > self.firmware.first_mission_item

    # Flying.

    def _mission(self) -> Behaviour:
        """Return the behaviour of the uploaded mission, from the current item on."""
        state = self.state
        if self.mission_complete:
            state.mission_seq = 0
        self.mission_begun, self.mission_complete = True, False
        makers = MissionMakers(self.manoeuvres, self._return_home, self._lift)
        return FlyMission(
            items=self.missions.items(mission_service.MISSION),
            first=max(self.firmware.first_mission_item, state.mission_seq),
            state=state,
            makers=makers,
            events=self,
        )

    @property
    def _flown_mission(self) -> FlyMission | None:
        behaviour = self.flight.behaviour
        return behaviour if isinstance(behaviour, FlyMission) and self.flight.armed else None

    def _watch_mission(self) -> None:
        """Mark the current item as reached when the mission has landed."""
        flight = self.flight
        if flight.landed and flight.landed_at_s is not None:
            mission = self._flown_mission
            if mission is not None:
                mission.receive_landing()

    def begin_item(self, seq: int) -> None:
        """Note that the autopilot now flies this mission item."""
        self.state.mission_seq = seq

    def reach_item(self, seq: int) -> None:
        """Report that a mission item is reached."""
        self.outbox.send(mavlink.MAVLink_mission_item_reached_message(seq))

    def finish_mission(self) -> None:
        """Note that the mission's last item is reached."""
        self.mission_complete = True

    def look_at(self, latitude_deg: float, longitude_deg: float) -> None:
        """Set a region of interest: without a gimbal only ArduCopter's heading follows it."""

    @on_command(*LOOKS)
    def _look(self, command: Command) -> int:
        if command.number == mavlink.MAV_CMD_DO_SET_ROI_NONE:
            self.look_at(0.0, 0.0)
        elif is_on_globe(command.x, command.y):
            self.look_at(command.x, command.y)
        else:
            return FAILED
        return ACCEPTED

    def _accept_items(self, kind: int, items: tuple[Item, ...]) -> int:
        result = super()._accept_items(kind, items)
        if kind == mission_service.MISSION and result == mission_service.ACCEPTED:
            self.mission_begun = self.mission_complete = False
        return result

    # Messages and commands.

    @on_request(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)
    def _mission_current(self) -> Any:
        in_mode = self.mode == self.standard.mission
        return mavlink.MAVLink_mission_current_message(
            self.state.mission_seq,
            self._mission_total(),
            self._mission_state(in_mode=in_mode),
            1 if in_mode else self.firmware.other_mode,
        )

    def _mission_total(self) -> int:
        """Return the number of the user's mission items, for MISSION_CURRENT."""
        return max(0, self.state.mission_total - self.firmware.first_mission_item)

    def _mission_state(self, *, in_mode: bool) -> int:
        if not self.has_mission:
            return int(mavlink.MISSION_STATE_NO_MISSION)
        if self.mission_complete:
            return int(mavlink.MISSION_STATE_COMPLETE)
        if not self.mission_begun:
            return int(mavlink.MISSION_STATE_NOT_STARTED)
        active = in_mode and self._flown_mission is not None
        return int(mavlink.MISSION_STATE_ACTIVE if active else mavlink.MISSION_STATE_PAUSED)

    @on_message("MISSION_SET_CURRENT")
    def _on_mission_set_current(self, message: Any) -> None:
        self._set_current(message.seq)
        self.outbox.send(self._mission_current())

    @on_command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT)
    def _do_set_current(self, command: Command) -> int:
        if command.params[1] == 1.0:
            self.mission_begun = self.mission_complete = False
        seq = command.whole(0)
        return ACCEPTED if seq == -1 or self._set_current(seq) else FAILED

    def _set_current(self, seq: int) -> bool:
        if not 0 <= seq < len(self.missions.items(mission_service.MISSION)):
            return False
        self.state.mission_seq = seq
        self.mission_complete = False
        mission = self._flown_mission
        if mission is not None:
            mission.jump_to(max(seq, self.firmware.first_mission_item))
        return True

    @on_command(mavlink.MAV_CMD_DO_CHANGE_SPEED)
    def _change_speed(self, command: Command) -> int:
        kind, speed_m_s = command.params[0], command.params[1]
        if math.isnan(speed_m_s) or not self.manoeuvres.change_speed(kind, speed_m_s):
            return DENIED
        behaviour = self.flight.behaviour
        if behaviour is not None and self._flies_by_speeds():
            behaviour.change_speeds(self.manoeuvres.speeds())
        return ACCEPTED

    def _flies_by_speeds(self) -> bool:
        return True
