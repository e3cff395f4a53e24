"""What a program under test may say to its vehicle, and when; pure.

It flies while the goal is flown, and reads at any time. Arming, taking off and landing, parameters
and failsafes are the orchestrator's: both vehicles do them together.
"""

from typing import Any, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from safety.guard.core.frame_filter import ESTIMATES, command_of, is_harmless
from vehicles.autopilots.autopilot import Target
from vehicles.autopilots.injection_support.rules import Setpoints
from vehicles.mavlink.codec import Codec
from vehicles.mavlink.framing import Frame

SETPOINTS = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    }
)
_STEERING_COMMANDS = frozenset(
    {
        mavlink.MAV_CMD_CONDITION_YAW,
        mavlink.MAV_CMD_DO_SET_MODE,
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_REPOSITION,
    }
)
_OUR_RATES = frozenset({mavlink.MAV_CMD_SET_MESSAGE_INTERVAL})
"""How often telemetry comes is asked for by the driver; half of it would blind the judge."""

_NO_POSITION = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)

Answer = Literal["pass", "later", "never"]


class CommandFilter:
    """Filters the MAVLink commands of an autonomy program, frame by frame.

    flying: whether the goal is being flown. steers_by: what its newest setpoint that passed was.
    trouble: what the program does wrong, in words.
    """

    def __init__(self, *, target: Target) -> None:
        self._target = target
        self._as_vehicle = Codec(system_id=target.system, component_id=target.component)
        self.flying = False
        self.refused = 0
        self.steers_by: Setpoints | None = None
        self.trouble = ""

    def judge(self, frame: Frame) -> Answer:
        """Return whether the filter passes a frame: now, not yet, or never."""
        command = command_of(frame)
        number = None if command is None else command.number
        setpoint = self._setpoint(frame) if frame.message_id in SETPOINTS else None
        steers = setpoint is not None or number in _STEERING_COMMANDS
        if frame.message_id in SETPOINTS and setpoint is None:
            answer: Answer = "never"
        elif steers or frame.message_id == mavlink.MAVLINK_MSG_ID_SET_MODE:
            answer = "pass" if self.flying else "later"
        elif frame.message_id in ESTIMATES:
            answer = "never"
        elif is_harmless(frame, parameters=False, plans=False) and number not in _OUR_RATES:
            answer = "pass"
        else:
            answer = "never"
        self.refused += answer != "pass"
        if answer == "pass" and setpoint is not None:
            self.steers_by = setpoint
        return answer

    def _setpoint(self, frame: Frame) -> Setpoints | None:
        """Return the setpoint for this vehicle in a frame; None for another's."""
        message = self._as_vehicle.decode(frame)
        if message is None:
            return None
        system = message.target_system
        if system not in {0, self._target.system}:
            said = f"its setpoints are for system {system}, and it flies {self._target.system}"
            self.trouble = said
            return None
        if frame.message_id == mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET:
            return "attitude"
        return "velocity" if message.type_mask & _NO_POSITION == _NO_POSITION else "position"

    def refusal(self, frame: Frame, answer: Answer) -> bytes:
        """Return the ack that refuses a filtered command; empty for anything else.

        A program that waits for an acknowledgement must not wait for ever.
        """
        command = command_of(frame)
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
