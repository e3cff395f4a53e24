"""A program under test flies when it is its turn, and arms, lands and sets nothing."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.programs.command_filter import CommandFilter
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame

PROGRAM = MavlinkCodec(system_id=200, component_id=1)


def frame(message: Any) -> MavlinkFrame:
    (one,) = MavlinkCodec(system_id=1, component_id=1).split(PROGRAM.pack(message))
    return one


def command(number: int, *params: float) -> MavlinkFrame:
    filled = (*params, *[0.0] * (7 - len(params)))
    return frame(mavlink.MAVLink_command_long_message(1, 1, number, 0, *filled))


def setpoint() -> MavlinkFrame:
    return frame(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0b110111000111, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0
        )
    )


HEARTBEAT = frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))


def test_its_setpoints_pass_from_the_goal_on() -> None:
    gate = CommandFilter(target=MavlinkTarget(1))
    assert gate.judge(setpoint()) == "later"
    gate.flying = True
    assert gate.judge(setpoint()) == "pass"
    assert gate.judge(command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 4.0)) == "pass"
    gate.flying = False
    assert gate.judge(setpoint()) == "later"
    assert gate.refused == 2


def test_setpoints_for_another_vehicle_are_not_passed_and_reported() -> None:
    gate = CommandFilter(target=MavlinkTarget(2))
    gate.flying = True
    assert gate.judge(setpoint()) == "never"
    assert gate.trouble == "its setpoints are for system 1, but it flies system 2"


def test_a_message_that_only_reads_always_passes() -> None:
    gate = CommandFilter(target=MavlinkTarget(1))
    assert gate.judge(HEARTBEAT) == "pass"
    assert gate.judge(command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148.0)) == "pass"
    assert gate.judge(frame(mavlink.MAVLink_timesync_message(0, 5))) == "pass"
    assert gate.judge(frame(mavlink.MAVLink_param_request_list_message(1, 1))) == "pass"
    assert gate.refused == 0


@pytest.mark.parametrize(
    "number",
    [
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        mavlink.MAV_CMD_DO_FLIGHTTERMINATION,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
        mavlink.MAV_CMD_DO_FENCE_ENABLE,
    ],
)
def test_a_command_of_the_orchestrator_never_passes_and_is_answered(number: int) -> None:
    gate = CommandFilter(target=MavlinkTarget(7, 1))
    gate.flying = True
    asked = command(number, 1.0)
    assert gate.judge(asked) == "never"
    (ack,) = MavlinkCodec(system_id=1, component_id=1).parse(gate.refusal(asked, "never"))
    assert (ack.get_type(), ack.command, ack.get_srcSystem()) == ("COMMAND_ACK", number, 7)
    assert ack.result == mavlink.MAV_RESULT_DENIED
    assert (ack.target_system, ack.target_component) == (200, 1)


def test_parameters_fences_and_missions_are_not_its_own() -> None:
    gate = CommandFilter(target=MavlinkTarget(1))
    gate.flying = True
    for message in (
        mavlink.MAVLink_param_set_message(1, 1, b"GF_ACTION", 0.0, 6),
        mavlink.MAVLink_mission_count_message(1, 1, 3, 1),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 1),
        mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8),
        mavlink.MAVLink_vision_position_estimate_message(0, 0, 0, 0, 0, 0, 0),
    ):
        assert gate.judge(frame(message)) == "never"
        assert gate.refusal(frame(message), "never") == b""


def test_a_command_that_comes_too_early_may_be_sent_again() -> None:
    gate = CommandFilter(target=MavlinkTarget(1))
    asked = command(mavlink.MAV_CMD_DO_REPOSITION)
    (ack,) = MavlinkCodec(system_id=1, component_id=1).parse(gate.refusal(asked, gate.judge(asked)))
    assert ack.result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def setpoint_message(type_mask: int) -> Any:
    return frame(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, type_mask, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0
        )
    )


def test_the_kind_of_setpoint_follows_from_the_messages_that_passed() -> None:
    gate = CommandFilter(target=MavlinkTarget(1))
    gate.judge(setpoint_message(0b110111111000))
    assert gate.steers_by is None  # it was not its turn
    gate.flying = True
    for message, expected in (
        (setpoint_message(0b110111000111), "velocity"),
        (setpoint_message(0b110111111000), "position"),
        (setpoint_message(0b110111000000), "position"),
        (
            frame(
                mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 1)
            ),
            "attitude",
        ),
    ):
        assert gate.judge(message) == "pass"
        assert gate.steers_by == expected
