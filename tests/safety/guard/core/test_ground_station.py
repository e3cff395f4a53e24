"""What a ground station at the guard's port may send: it reads, and it takes over."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.safety.guard.guard_rigs import GCS, command, make_pair, mode_command
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import (
    GuardEvent,
    ToVehicle,
    brings_down,
    decisive_guard_event,
)
from wil_campaign.vehicles.autopilots.autopilot import (
    FlightMode,
    MavlinkTarget,
    command_long,
    own_heartbeat,
)
from wil_campaign.vehicles.autopilots.px4 import Px4


def velocity(target: MavlinkTarget) -> Any:
    return Px4().velocity_setpoint(target, t_boot_ms=0, velocity_ned_m_s=(1.0, 0.0, 0.0))


def parameter_set(name: str) -> Any:
    return mavlink.MAVLink_param_set_message(1, 1, name.encode(), 0.0, 6)


def file_operation(opcode: int) -> bytes:
    payload = [0, 0, 0, opcode, *[0] * 247]
    return GCS.pack(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))


@pytest.mark.parametrize(
    ("frame", "takes"),
    [
        (command(mavlink.MAV_CMD_DO_SET_STANDARD_MODE, 1.0, codec=GCS), True),
        (command(mavlink.MAV_CMD_DO_PARACHUTE, 2.0, codec=GCS), True),
        (mode_command(FlightMode.HOLD, GCS), True),
        (command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, codec=GCS), True),
        (command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, codec=GCS), True),
        (GCS.pack(mavlink.MAVLink_set_mode_message(1, 1, 4)), True),
        (command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148, codec=GCS), False),
        (GCS.pack(mavlink.MAVLink_param_request_list_message(1, 1)), False),
        (GCS.pack(mavlink.MAVLink_gps_rtcm_data_message(0, 4, bytes(180))), False),
        (file_operation(4), False),
        (GCS.pack(command_long(MavlinkTarget(0), mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 6)), True),
        (GCS.pack(velocity(MavlinkTarget(1))), True),
    ],
)
def test_a_ground_station_takes_over_by_a_mode_command(
    pair: Any, frame: bytes, takes: bool
) -> None:
    outputs = pair.core.from_gcs("real", frame, pair.t_s)
    assert outputs[0] == ToVehicle("real", (frame,))
    pair.apply(outputs)
    assert (pair.core.latched == "takeover") == takes
    assert (pair.core.phases["real"] is ContingencyPhase.PILOT) == takes
    pair.fly(20.0)
    assert pair.vehicles["twin"].armed == (not takes)


@pytest.mark.parametrize(
    ("message", "name"),
    [
        (parameter_set("GF_ACTION"), "PARAM_SET of GF_ACTION"),
        (mavlink.MAVLink_param_ext_set_message(1, 1, b"A", b"1", 1), "PARAM_EXT_SET"),
        (mavlink.MAVLink_mission_clear_all_message(1, 1), "MISSION_CLEAR_ALL"),
        (mavlink.MAVLink_mission_count_message(1, 1, 4, 1), "MISSION_COUNT"),
        (mavlink.MAVLink_mission_set_current_message(1, 1, 3), "MISSION_SET_CURRENT"),
        (mavlink.MAVLink_fence_point_message(1, 1, 0, 1, 1.0, 2.0), "FENCE_POINT"),
        (
            mavlink.MAVLink_set_gps_global_origin_message(1, 1, 2, 3),
            "SET_GPS_GLOBAL_ORIGIN",
        ),
        (
            mavlink.MAVLink_set_home_position_message(
                1, 1, 2, 3, *[0.0] * 3, [0.0] * 4, *[0.0] * 3
            ),
            "SET_HOME_POSITION",
        ),
        (
            mavlink.MAVLink_vision_position_estimate_message(0, *[0.0] * 6),
            "VISION_POSITION_ESTIMATE",
        ),
        (mavlink.MAVLink_att_pos_mocap_message(0, [0.0] * 4, 0, 0, 0), "ATT_POS_MOCAP"),
        (mavlink.MAVLink_distance_sensor_message(0, 1, 9, 5, 0, 0, 0, 0), "DISTANCE_SENSOR"),
        (mavlink.MAVLink_serial_control_message(10, 0, 0, 0, 2, [0] * 70), "SERIAL_CONTROL"),
        (
            command_long(MavlinkTarget(1), mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 9),
            "MAV_CMD_DO_CHANGE_SPEED",
        ),
        (command_long(MavlinkTarget(1), mavlink.MAV_CMD_DO_SET_HOME, 1), "MAV_CMD_DO_SET_HOME"),
        (
            command_long(MavlinkTarget(1), mavlink.MAV_CMD_DO_FENCE_ENABLE, 0),
            "MAV_CMD_DO_FENCE_ENABLE",
        ),
        (
            command_long(MavlinkTarget(1), mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1),
            "MAV_CMD_COMPONENT_ARM_DISARM",
        ),
        # Another vehicle's ground station sends everything on all of its links.
        (
            command_long(MavlinkTarget(2), mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 6),
            "MAV_CMD_DO_SET_MODE",
        ),
        (mavlink.MAVLink_set_mode_message(2, 1, 4), "SET_MODE"),
        (velocity(MavlinkTarget(2)), "SET_POSITION_TARGET_LOCAL_NED"),
    ],
)
def test_changes_by_a_ground_station_do_not_reach_the_vehicle(
    fake_vehicle: Any, rig: Any, message: Any, name: str
) -> None:
    for armed in (True, False):
        pair = make_pair(fake_vehicle, rig, real={"armed": armed})
        frame = GCS.pack(message)
        text = f"{name} from the ground station 255/190 was not forwarded"
        event = GuardEvent(pair.t_s, "dropped", "real", text)
        assert pair.core.from_gcs("real", frame, pair.t_s) == (event,)
        # The first of a kind is reported; a heartbeat beside it arrives.
        beat = GCS.pack(own_heartbeat())
        assert pair.core.from_gcs("real", frame + beat, pair.t_s) == (ToVehicle("real", (beat,)),)
        assert pair.core.latched is None


def test_a_ground_station_s_files_are_read_and_not_written(pair: Any) -> None:
    for opcode in range(16):
        frame = file_operation(opcode)
        sent = ToVehicle("real", (frame,)) in pair.core.from_gcs("real", frame, pair.t_s)
        assert sent is (opcode not in range(6, 14))


def test_an_unknown_message_of_a_ground_station_is_not_forwarded(pair: Any) -> None:
    number = 60000
    assert number not in mavlink.mavlink_map
    head = bytes([0xFD, 1, 0, 0, 7, 255, 190]) + number.to_bytes(3, "little")
    frame = head + b"\1" + b"\0\0"
    beat = GCS.pack(own_heartbeat())
    outputs = pair.core.from_gcs("real", frame + beat + beat, pair.t_s)
    forwarded = [one for out in outputs if isinstance(out, ToVehicle) for one in out.frames]
    assert frame not in forwarded
    assert beat in forwarded


def test_sticks_of_a_ground_station_arrive_and_the_flight_is_invalid(
    fake_vehicle: Any, rig: Any
) -> None:
    sticks = mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0)
    override = mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8)
    for message in (sticks, override):
        frame = GCS.pack(message)
        resting = make_pair(fake_vehicle, rig, real={"armed": False})
        assert resting.core.from_gcs("real", frame, resting.t_s) == (ToVehicle("real", (frame,)),)
        pair = make_pair(fake_vehicle, rig)
        sent, event = pair.core.from_gcs("real", frame, pair.t_s)
        assert sent == ToVehicle("real", (frame,))
        assert event.text.startswith("the ground station 255/190 sends positions of sticks to real")
        outcome = decisive_guard_event(event)
        assert outcome is not None
        assert (outcome.kind, brings_down(event)) == ("INVALID", False)
        # Once; and the guard lands nobody.
        assert len(pair.core.from_gcs("real", frame, pair.t_s)) == 1
        assert pair.core.latched is None


def test_a_mode_from_a_ground_station_takes_over_nothing_on_the_ground(
    fake_vehicle: Any, rig: Any
) -> None:
    resting = make_pair(fake_vehicle, rig, real={"armed": False})
    frame = mode_command(FlightMode.HOLD, GCS)
    assert resting.core.from_gcs("real", frame, resting.t_s) == (ToVehicle("real", (frame,)),)
    assert resting.core.latched is None
    assert resting.core.phases["real"] is ContingencyPhase.IDLE


def test_a_pilot_who_has_taken_over_configures(pair: Any) -> None:
    pair.apply(pair.core.from_gcs("real", mode_command(FlightMode.HOLD, GCS), pair.t_s))
    for message in (
        parameter_set("RTL_RETURN_ALT"),
        mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0),
        command_long(MavlinkTarget(1), mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 9),
    ):
        frame = GCS.pack(message)
        assert pair.core.from_gcs("real", frame, pair.t_s) == (ToVehicle("real", (frame,)),)


def test_a_ground_station_that_makes_names_up_fills_no_record(pair: Any) -> None:
    events: list[Any] = []
    for number in range(1000):
        frame = GCS.pack(parameter_set(f"P{number}\n\x1b"))
        events += pair.core.from_gcs("real", frame, pair.t_s)
    assert len(events) == 200
    assert events[7].text == "PARAM_SET of P7?? from the ground station 255/190 was not forwarded"
