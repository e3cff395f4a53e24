"""Filters the MAVLink that a program under test sends to its vehicle; pure.

Setpoints pass while the goal is flown, requests for data at any time. Arming, takeoff, landing,
parameters and failsafes are reserved to the orchestrator, which does them for both vehicles.
"""

from typing import Any, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.safety.guard.core.frame_filter import ESTIMATES, is_harmless_frame
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.fields import command_in_frame
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.setpoints import Setpoints

SETPOINTS = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    }
)
_CONTROL_COMMANDS = frozenset(
    {
        mavlink.MAV_CMD_CONDITION_YAW,
        mavlink.MAV_CMD_DO_SET_MODE,
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_REPOSITION,
    }
)
_OUR_RATES = frozenset({mavlink.MAV_CMD_SET_MESSAGE_INTERVAL})
"""The driver sets the telemetry rates: with lower ones the oracles would miss data."""

_NO_POSITION = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)

Decision = Literal["pass", "later", "never"]


class CommandFilter:
    """Filters the MAVLink commands of an autonomy program, frame by frame.

    flying: whether the goal is being flown. steers_by: the kind of the newest passed setpoint.
    trouble: what the program does wrong, in words.
    """

    def __init__(self, *, target: MavlinkTarget) -> None:
        self._target = target
        self._as_vehicle = MavlinkCodec(system_id=target.system, component_id=target.component)
        self.flying = False
        self.refused = 0
        self.steers_by: Setpoints | None = None
        self.trouble = ""

    def judge(self, frame: MavlinkFrame) -> Decision:
        """Return whether a frame passes the filter: now, not yet, or never."""
        command = command_in_frame(frame)
        number = None if command is None else command.number
        setpoint = self._setpoint(frame) if frame.message_id in SETPOINTS else None
        controls = setpoint is not None or number in _CONTROL_COMMANDS
        if frame.message_id in SETPOINTS and setpoint is None:
            answer: Decision = "never"
        elif controls or frame.message_id == mavlink.MAVLINK_MSG_ID_SET_MODE:
            answer = "pass" if self.flying else "later"
        elif frame.message_id in ESTIMATES:
            answer = "never"
        elif is_harmless_frame(frame, configures=False) and number not in _OUR_RATES:
            answer = "pass"
        else:
            answer = "never"
        self.refused += answer != "pass"
        if answer == "pass" and setpoint is not None:
            self.steers_by = setpoint
        return answer

    def _setpoint(self, frame: MavlinkFrame) -> Setpoints | None:
        """Return the kind of setpoint for this vehicle in a frame; None for another vehicle."""
        message = self._as_vehicle.decode(frame)
        if message is None:
            return None
        system = message.target_system
        if system not in {0, self._target.system}:
            self.trouble = (
                f"its setpoints are for system {system}, but it flies system {self._target.system}"
            )
            return None
        if frame.message_id == mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET:
            return "attitude"
        return "velocity" if message.type_mask & _NO_POSITION == _NO_POSITION else "position"

    def refusal(self, frame: MavlinkFrame, answer: Decision) -> bytes:
        """Return the COMMAND_ACK that refuses a filtered command; empty for other messages.

        A program that waits for an acknowledgement must not wait for ever.
        """
        command = command_in_frame(frame)
        if command is None:
            return b""
        result = (
            mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            if answer == "later"
            else mavlink.MAV_RESULT_DENIED
        )
        message: Any = mavlink.MAVLink_command_ack_message(
            command.number,
            result,
            target_system=frame.system,
            target_component=frame.component,
        )
        return self._as_vehicle.pack(message)
