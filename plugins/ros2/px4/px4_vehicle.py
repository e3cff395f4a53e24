"""In the place of PX4 for a node of px4_msgs: the vehicle's state out, modes and commands in.

The run arms, takes off and lands; a node that asks for that is answered as PX4 answers it.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from wil_campaign.plugins.ros2.messages.ros_types import RosTypes
from wil_campaign.plugins.ros2.px4.px4_types import (
    ACKNOWLEDGEMENT,
    ACKNOWLEDGEMENT_TOPIC,
    COMMAND,
    LOCAL_POSITION,
    ODOMETRY,
    ODOMETRY_TOPIC,
    OFFBOARD_MODE,
    POSITION_TOPIC,
    STATUS,
    STATUS_TOPIC,
)
from wil_campaign.vehicles.autonomy import Telemetry

Made = tuple[str, Callable[[], bytes]]
"""A topic, and what makes the message."""
_MODE_S = 1.0
"""For how long an OffboardControlMode counts (COM_OF_LOSS_T)."""
_STATUS_S = 0.5
_LOITER, _OFFBOARD, _TAKEOFF, _LAND = 4, 14, 17, 18
"""NAVIGATION_STATE_... of VehicleStatus."""
_DISARMED, _ARMED, _ROTARY_WING, _NED = 1, 2, 1, 1
_ACCEPTED, _REJECTED, _UNSUPPORTED = 0, 1, 3
"""VEHICLE_CMD_RESULT_... of VehicleCommandAck."""
_NAV_LAND, _NAV_TAKEOFF, _SET_MODE, _ARM_DISARM = 21, 22, 176, 400
"""MAV_CMD_... of MAVLink, which VehicleCommand has."""
_MAIN_AUTO, _MAIN_OFFBOARD, _SUB_TAKEOFF, _SUB_LAND = 4, 6, 2, 6
"""Modes in DO_SET_MODE's second and third parameter (px4_custom_mode.h)."""
_BEYOND = ("acceleration", "attitude", "body_rate", "thrust_and_torque", "direct_actuator")


class Px4Vehicle:
    """What a node sees of PX4. Its methods are called by one thread at a time."""

    def __init__(self, types: RosTypes) -> None:
        self._types = types
        self._mode_s = float("-inf")
        self._wanted: tuple[str, ...] = ()
        self._status = (_DISARMED, _LOITER)
        self._status_s = float("-inf")
        self._nav_state, self._arming_state = _LOITER, _DISARMED

    def enter(self, stage: str) -> None:
        """Take a stage of the run, of which arming and mode follow."""
        modes = {"takeoff": _TAKEOFF, "at_height": _LOITER, "done": _LOITER, "land": _LAND}
        if stage in modes or stage == "goal":
            self._arming_state = _ARMED
            self._nav_state = modes.get(stage, _OFFBOARD)
        elif stage in {"landed", "end"}:
            self._arming_state, self._nav_state = _DISARMED, _LOITER

    def take_mode(self, cdr: bytes, t_s: float) -> None:
        """Take an OffboardControlMode. t_s: of the run's clock. Raises BadMessageError."""
        message = self._types.deserialize(cdr, OFFBOARD_MODE)
        self._mode_s = t_s
        is_flown = message.position or message.velocity
        asked = [name for name in _BEYOND if getattr(message, name, False)]
        self._wanted = () if is_flown else tuple(asked) or ("nothing",)

    def mode_trouble(self, t_s: float) -> str:
        """Return in words why setpoints do not fly now; "" where they do."""
        if self._wanted:
            return (
                f"OffboardControlMode asks for {', '.join(self._wanted)}: set its position or "
                "velocity"
            )
        if t_s - self._mode_s > _MODE_S:
            return f"it published no OffboardControlMode for {_MODE_S:g} s, without which PX4 stops"
        return ""

    def take_command(self, cdr: bytes) -> tuple[Made, bool]:
        """Return the answer to a VehicleCommand, and whether it ends the node's flight.

        Raises BadMessageError.
        """
        command = self._types.deserialize(cdr, COMMAND)
        result, is_end = self._result(command)
        acknowledgement = self._make(
            ACKNOWLEDGEMENT,
            timestamp=int(command.timestamp),
            command=int(command.command),
            result=result,
            target_system=int(command.source_system),
            target_component=int(command.source_component),
        )
        return (ACKNOWLEDGEMENT_TOPIC, lambda: acknowledgement), is_end

    def messages(self, telemetry: Telemetry, stamp_ns: int) -> Iterator[Made]:
        """Yield the messages of a time: the status each half second and when it changes."""
        t_s = telemetry.t_s
        is_lost = self._nav_state == _OFFBOARD and self.mode_trouble(t_s)
        status = (self._arming_state, _LOITER if is_lost else self._nav_state)
        if status != self._status or t_s - self._status_s >= _STATUS_S:
            self._status, self._status_s = status, t_s
            yield STATUS_TOPIC, partial(self._status_message, status, stamp_ns // 1000)
        yield POSITION_TOPIC, partial(self._position_message, telemetry, stamp_ns // 1000)
        yield ODOMETRY_TOPIC, partial(self._odometry_message, telemetry, stamp_ns // 1000)

    def _result(self, command: Any) -> tuple[int, bool]:
        """Return the result of a command, and whether it asks for the landing."""
        number, is_armed = int(command.command), self._arming_state == _ARMED
        if number == _ARM_DISARM:
            # The run arms, and disarms after its landing: in the air PX4 refuses, too.
            is_refused = command.param1 == 0 and is_armed
            return (_REJECTED if is_refused else _ACCEPTED), False
        if number == _NAV_TAKEOFF:
            return _ACCEPTED, False
        if number == _NAV_LAND:
            return _ACCEPTED, True
        if number != _SET_MODE:
            return _UNSUPPORTED, False
        main, sub = command.param2, command.param3
        is_land = main == _MAIN_AUTO and sub == _SUB_LAND
        is_takeoff = main == _MAIN_AUTO and sub == _SUB_TAKEOFF
        is_known = main == _MAIN_OFFBOARD or is_land or is_takeoff
        return (_ACCEPTED if is_known else _REJECTED), is_land

    def _status_message(self, status: tuple[int, int], stamp_us: int) -> bytes:
        arming, nav = status
        return self._make(
            STATUS,
            timestamp=stamp_us,
            arming_state=arming,
            nav_state=nav,
            nav_state_user_intention=nav,
            nav_state_display=nav,
            vehicle_type=_ROTARY_WING,
            system_id=1,
            component_id=1,
            pre_flight_checks_pass=True,
            accepts_offboard_setpoints=nav == _OFFBOARD,
        )

    def _position_message(self, telemetry: Telemetry, stamp_us: int) -> bytes:
        north, east, down = telemetry.pose.position_ned_m
        v_north, v_east, v_down = telemetry.velocity_ned_m_s
        is_known = dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), True)
        limits = ("vxy_max", "vz_max", "hagl_min", "hagl_max", "hagl_max_z", "hagl_max_xy")
        return self._make(
            LOCAL_POSITION,
            timestamp=stamp_us,
            timestamp_sample=stamp_us,
            x=north,
            y=east,
            z=down,
            vx=v_north,
            vy=v_east,
            vz=v_down,
            z_deriv=v_down,
            heading=telemetry.pose.yaw_rad,
            unaided_heading=telemetry.pose.yaw_rad,
            heading_good_for_control=True,
            **is_known,
            **dict.fromkeys(limits, float("inf")),
        )

    def _odometry_message(self, telemetry: Telemetry, stamp_us: int) -> bytes:
        unknown = np.full(3, np.nan, np.float32)
        return self._make(
            ODOMETRY,
            timestamp=stamp_us,
            timestamp_sample=stamp_us,
            pose_frame=_NED,
            position=np.asarray(telemetry.pose.position_ned_m, np.float32),
            q=np.asarray(telemetry.pose.q_wxyz, np.float32),
            velocity_frame=_NED,
            velocity=np.asarray(telemetry.velocity_ned_m_s, np.float32),
            angular_velocity=unknown,
        )

    def _make(self, name: str, **fields: object) -> bytes:
        """Return the CDR of a message; fields that this release of PX4 lacks are left out."""
        message = self._types.zero(name)
        for field, value in fields.items():
            if self._types.has_field(name, field):
                setattr(message, field, value)
        return self._types.serialize(message, name)
