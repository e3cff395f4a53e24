import asyncio
import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.bare_autopilot import BareAutopilot
from tests.vehicles.embedded.charge import set_remaining
from wil_campaign.vehicles.embedded.profile import load_profile

STABILIZE, AUTO, GUIDED, LOITER, RTL_MODE, LAND_MODE, BRAKE = 0, 3, 4, 5, 6, 9, 17
HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
VELOCITY_MASK = 0b0000_1101_1100_0111
POSITION_MASK = 0b0000_1101_1111_1000
FAILED = mavlink.MAV_RESULT_FAILED
Scenario = Callable[[Any], Any]


def copter(rig: Any, **config: Any) -> Any:
    return rig(autopilot="ardupilot", **config)


def test_disarmed_it_takes_guided_before_there_is_a_position_and_does_not_arm(
    rig: Any, virtually: Scenario
) -> None:
    """Copter::set_mode ignores its checks while disarmed; arming makes up for it."""

    async def scenario() -> None:
        async with copter(rig) as r:
            await asyncio.sleep(10.0)
            assert await r.command(400, 1) == FAILED
            await asyncio.sleep(0.1)
            assert "Arm: Need Position Estimate" in r.texts()
            await asyncio.sleep(20.0)
            # The pre-arm bit is true by now, and still it does not arm in GUIDED.
            assert await r.command(512, mavlink.MAVLINK_MSG_ID_SYS_STATUS) == 0
            bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
            assert r.last["SYS_STATUS"].onboard_control_sensors_health & bit
            assert await r.command(176, 1, GUIDED) == 0
            assert await r.command(400, 1) == FAILED
            await r.command(176, 1, STABILIZE)
            assert await r.command(400, 1) == 0
            assert await r.command(176, 1, GUIDED) == FAILED
            await asyncio.sleep(0.1)
            assert "Mode change to GUIDED failed: requires position" in r.texts()
            assert await r.command(400, 0) == 0
            await asyncio.sleep(12.0)
            assert await r.command(176, 1, GUIDED) == 0
            assert await r.command(400, 1) == 0

    virtually(scenario())


def test_a_copter_that_was_on_before_is_ready_at_once(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig, running_s=60.0) as r:
            await asyncio.sleep(0.5)
            assert "EKF3 IMU1 is using GPS" in r.texts()
            assert await r.command(176, 1, GUIDED) == 0
            assert await r.command(400, 1) == 0

    virtually(scenario())


def test_sends_nothing_but_heartbeats_until_asked(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await asyncio.sleep(19.0)
            assert set(r.last) == {"HEARTBEAT", "TIMESYNC", "STATUSTEXT"}
            r.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
            await asyncio.sleep(5.0)
            assert len(r.of("ATTITUDE")) == pytest.approx(20, abs=2)
            assert len(r.of("SYS_STATUS")) == pytest.approx(20, abs=2)
            before = len(r.of("ATTITUDE"))
            r.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 0))
            await asyncio.sleep(5.0)
            assert len(r.of("ATTITUDE")) <= before + 1

    virtually(scenario())


def test_takes_off_only_armed_and_guided(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await asyncio.sleep(42.0)
            assert await r.command(22, 0, 0, 0, 0, 0, 0, 3) == FAILED
            await r.command(176, 1, GUIDED)
            assert await r.command(22, 0, 0, 0, 0, 0, 0, 3) == FAILED
            await r.command(400, 1)
            assert await r.command(22, 0, 0, 0, 0, 0, 0, 0) == FAILED
            assert await r.command(22, 0, 0, 0, 0, 0, 0, 3) == 0
            await asyncio.sleep(10.0)
            assert r.height_m == pytest.approx(3.0, abs=0.15)
            assert await r.command(22, 0, 0, 0, 0, 0, 0, 3) == FAILED

    virtually(scenario())


@pytest.mark.parametrize("climbed_m", [0.5, 2.0])
def test_guided_chosen_again_does_not_end_a_takeoff(
    rig: Any, virtually: Scenario, climbed_m: float
) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await asyncio.sleep(42.0)
            await r.command(176, 1, GUIDED)
            await r.command(400, 1)
            assert await r.command(22, 0, 0, 0, 0, 0, 0, 3) == 0
            await r.until(lambda: r.height_m > climbed_m)
            assert await r.command(176, 1, GUIDED) == 0
            await asyncio.sleep(8.0)
            assert r.height_m == pytest.approx(3.0, abs=0.15)

    virtually(scenario())


def test_disarms_itself_when_it_does_not_take_off(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await asyncio.sleep(42.0)
            await r.command(176, 1, GUIDED)
            assert await r.command(400, 1) == 0
            assert await r.until(lambda: not r.armed) == pytest.approx(10.0, abs=0.1)

    virtually(scenario())


def test_lost_velocity_setpoints_stop_it_after_three_seconds(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await r.hover()
            await r.stream(4.0, mask=VELOCITY_MASK, velocity=(1.0, 0.0, 0.0))
            await asyncio.sleep(2.5)
            assert r.speed_m_s == pytest.approx(1.0, abs=0.15)
            await asyncio.sleep(3.0)
            assert r.speed_m_s < 0.15
            assert r.custom_mode == GUIDED
            assert r.status == mavlink.MAV_STATE_ACTIVE

    virtually(scenario())


def test_position_setpoints_need_no_stream(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await r.hover()
            r.setpoint(mask=POSITION_MASK, position=(2.0, 1.0, -2.0))
            await asyncio.sleep(8.0)
            assert r.vehicle.truth().pose.position_ned_m == pytest.approx((2, 1, -2), abs=0.2)
            # Offsets count from the present place, in the frame of the heading for frame 9.
            r.setpoint(mask=POSITION_MASK, frame=9, position=(1.0, 0.0, 0.0))
            await asyncio.sleep(6.0)
            yaw = r.vehicle.truth().pose.yaw_rad
            expected = (2.0 + math.cos(yaw), 1.0 + math.sin(yaw), -2.0)
            assert r.vehicle.truth().pose.position_ned_m == pytest.approx(expected, abs=0.25)

    virtually(scenario())


def test_setpoints_count_in_guided_only(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await r.hover()
            assert await r.command(176, 1, LOITER) == 0
            await r.stream(3.0, mask=VELOCITY_MASK, velocity=(2.0, 0.0, 0.0))
            assert r.speed_m_s < 0.15

    virtually(scenario())


def test_arducopter_brakes_and_lands_on_command(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await r.hover()
            await r.stream(3.0, mask=VELOCITY_MASK, velocity=(2.0, 0.0, 0.0))
            assert await r.command(176, 1, BRAKE) == 0
            await asyncio.sleep(3.0)
            assert r.custom_mode == BRAKE
            assert r.speed_m_s < 0.1
            assert await r.command(21) == 0
            await r.until(lambda: not r.armed)
            assert r.custom_mode == LAND_MODE
            assert await r.command(400, 1) == FAILED

    virtually(scenario())


def test_returns_at_the_height_of_its_cone(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig, parameters={"RTL_LOIT_TIME": 1000}) as r:
            await r.hover(2.0)
            r.setpoint(mask=POSITION_MASK, position=(3.0, 0.0, -2.0))
            await asyncio.sleep(6.0)
            highest = [0.0]
            r.vehicle.on_truth(
                lambda s: highest.append(max(highest[-1], -s.pose.position_ned_m[2])), 10
            )
            assert await r.command(20) == 0
            await r.until(lambda: not r.armed)
            # Three metres away, a slope of 3: nine metres up.
            assert highest[-1] == pytest.approx(9.0, abs=0.4)
            assert r.vehicle.truth().pose.position_ned_m[0] == pytest.approx(0.0, abs=0.3)

    virtually(scenario())


@pytest.mark.parametrize(("final_cm", "end_m"), [(0, None), (150, 1.5)])
def test_a_return_lands_or_stays_at_its_final_height(final_cm: int, end_m: float | None) -> None:
    """ModeRTL::build_path: it lands only where RTL_ALT_FINAL is 0 or below."""
    parameters = {"RTL_ALT_FINAL": final_cm, "RTL_LOIT_TIME": 1000}
    bare = BareAutopilot("ardupilot", parameters=parameters)
    bare.hover()
    assert bare.command(20) == 0
    bare.run(1.0)
    flight = bare.autopilot.flight
    assert flight.target is not None
    up_m = -(flight.target.position_ned_m[2] or 0.0)
    assert up_m > 5.0
    bare.height_m = up_m
    bare.run(2.0)
    assert flight.behaviour is not None
    assert flight.behaviour.descends is (end_m is None)
    assert flight.target.position_ned_m == (0.0, 0.0, None if end_m is None else -end_m)
    assert flight.armed


@pytest.mark.parametrize(
    ("action", "mode"), [(0, GUIDED), (1, RTL_MODE), (5, LAND_MODE), (6, RTL_MODE)]
)
def test_a_lost_ground_station_acts_as_the_parameter_says(
    rig: Any, virtually: Scenario, action: int, mode: int
) -> None:
    async def scenario() -> None:
        async with copter(rig, parameters={"FS_GCS_ENABLE": action}) as r:
            await r.hover()
            r.silence()
            await asyncio.sleep(4.0)
            assert r.custom_mode == GUIDED
            await asyncio.sleep(2.5)
            assert r.custom_mode == mode
            assert ("GCS Failsafe" in r.texts()) == (action != 0)
            critical = r.status == mavlink.MAV_STATE_CRITICAL
            assert critical == (action != 0)

    virtually(scenario())


def lost_ground_station(
    *, sent_by: int = 255, heeded: int = 255, options: int = 0, mode: int | None = None
) -> Any:
    """Return a bare ArduCopter 6 s after the heartbeats of a ground station ended."""
    parameters = {"FS_GCS_ENABLE": 5, "FS_OPTIONS": options, "MAV_GCS_SYSID": heeded}
    bare = BareAutopilot("ardupilot", parameters=parameters)
    bare.hover()
    bare.send(HEARTBEAT, system=sent_by)
    if mode is not None:
        assert bare.command(176, 1, mode) == 0
    bare.run(6.0)
    return bare


@pytest.mark.parametrize(
    ("sent_by", "heeded", "mode"),
    [(255, 255, "LAND"), (245, 245, "LAND"), (245, 255, "GUIDED"), (255, 245, "GUIDED")],
)
def test_only_the_loss_of_its_own_ground_station_is_a_failsafe(
    sent_by: int, heeded: int, mode: str
) -> None:
    """One that was never received is not lost."""
    bare = lost_ground_station(sent_by=sent_by, heeded=heeded)
    assert bare.autopilot.mode.name == mode


@pytest.mark.parametrize(
    ("options", "mode", "ends_in"),
    [
        (16, BRAKE, "BRAKE"),
        (16, LOITER, "LOITER"),
        (16, GUIDED, "LAND"),
        (16, RTL_MODE, "LAND"),
        (15, BRAKE, "LAND"),
        (15, LOITER, "LAND"),
    ],
)
def test_a_lost_ground_station_in_modes_of_a_pilot_is_the_options_s_to_say(
    options: int, mode: int, ends_in: str
) -> None:
    """By default BRAKE, in which the guard holds, counts as one of them (ArduCopter/mode.h)."""
    assert lost_ground_station(options=options, mode=mode).autopilot.mode.name == ends_in


def test_a_low_battery_lands_or_returns_as_the_parameters_say(
    rig: Any, virtually: Scenario
) -> None:
    async def scenario() -> None:
        parameters = {"BATT_FS_LOW_ACT": 2, "BATT_LOW_VOLT": 11.0, "BATT_FS_CRT_ACT": 1}
        async with copter(rig, parameters={**parameters, "BATT_CRT_VOLT": 10.7}) as r:
            await r.hover()
            set_remaining(r.vehicle.body.battery, 0.2)
            # BATT_LOW_TIMER: 10 s below the voltage.
            await asyncio.sleep(9.0)
            assert r.custom_mode == GUIDED
            await asyncio.sleep(2.1)
            assert r.custom_mode == RTL_MODE
            assert "Battery Failsafe" in r.texts()
            assert any(text.startswith("Battery 1 is low 10.9") for text in r.texts())
            set_remaining(r.vehicle.body.battery, 0.05)
            await asyncio.sleep(11.1)
            assert r.custom_mode == LAND_MODE
            await r.command(176, 1, GUIDED)
            set_remaining(r.vehicle.body.battery, 1.0)
            await asyncio.sleep(1.1)
            assert (r.custom_mode, r.status) == (GUIDED, mavlink.MAV_STATE_CRITICAL)
            assert await r.command(185, 1) == 0
            await asyncio.sleep(3.0)
            assert await r.command(400, 1) == FAILED
            await asyncio.sleep(0.1)
            assert "Arm: Battery failsafe" in r.texts()

    virtually(scenario())


def test_force_arms_before_ready_and_disarms_in_the_air(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await asyncio.sleep(5.0)
            for forced in (2989, 21196):
                assert await r.command(400, 1, forced) == 0
                assert await r.command(400, 0) == 0
            await r.hover()
            assert await r.command(400, 0) == FAILED
            assert await r.command(400, 0, 2989) == FAILED
            assert await r.command(400, 0, 21196) == 0
            await asyncio.sleep(2.0)
            assert r.vehicle.truth().on_ground

    virtually(scenario())


def test_termination_disarms_at_once(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await r.hover()
            assert await r.command(185, 1) == 0
            assert not r.armed

    virtually(scenario())


def test_goes_where_it_is_sent_and_faces_it(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await r.hover()
            goal = r.vehicle.autopilot.state.frame.to_geodetic((0.0, 4.0, -3.0))
            x, y = round(goal.latitude_deg * 1e7), round(goal.longitude_deg * 1e7)
            frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
            changing, staying = (-1.0, 1.0, 0.0, math.nan), (-1.0, 0.0, 0.0, math.nan)
            goal_int = (x, y, 3.0)
            assert await r.command_int(192, frame=frame, params=changing, place=goal_int) == 0
            await asyncio.sleep(8.0)
            assert r.vehicle.truth().pose.position_ned_m == pytest.approx((0, 4, -3), abs=0.2)
            assert r.vehicle.truth().pose.yaw_rad == pytest.approx(math.pi / 2, abs=0.1)
            await r.command(176, 1, LOITER)
            denied = mavlink.MAV_RESULT_DENIED
            assert await r.command_int(192, frame=frame, params=staying, place=goal_int) == denied

    virtually(scenario())


def test_never_ready_stays_without_position(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig, never_ready=True) as r:
            await asyncio.sleep(60.0)
            assert await r.command(176, 1, GUIDED) == 0
            assert await r.command(400, 1) == FAILED
            assert not any("is using GPS" in text for text in r.texts())

    virtually(scenario())


def test_unknown_modes_fail(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with copter(rig) as r:
            await asyncio.sleep(3.0)
            assert await r.command(176, 1, 13) == FAILED
            assert await r.command(176, 0, GUIDED) == mavlink.MAV_RESULT_DENIED

    virtually(scenario())


def test_a_velocity_is_flown_whatever_the_waypoint_speed_is(rig: Any, virtually: Scenario) -> None:
    """As ArduCopter 4.7 in SITL: WPNAV_SPEED 120 cm/s, 2.5 m/s asked for, 2.52 m/s flown."""

    async def scenario() -> None:
        slow = {"WPNAV_SPEED": 120.0, "WPNAV_SPEED_UP": 50.0}
        async with copter(rig, parameters=slow) as r:
            await r.hover()
            await r.stream(6.0, mask=VELOCITY_MASK, velocity=(2.5, 0.0, 0.0))
            assert r.speed_m_s == pytest.approx(2.5, abs=0.15)
            await r.stream(4.0, mask=VELOCITY_MASK)
            before_m = r.height_m
            await r.stream(4.0, mask=VELOCITY_MASK, velocity=(0.0, 0.0, -1.0))
            assert r.height_m - before_m == pytest.approx(3.3, abs=0.4)
            await r.stream(4.0, mask=VELOCITY_MASK)
            await r.stream(3.0, mask=POSITION_MASK, position=(-30.0, 0.0, -3.0))
            assert r.speed_m_s == pytest.approx(1.2, abs=0.1)

    virtually(scenario())


def local_setpoint(mask: int, *, position: Any = (0, 0, 0), velocity: Any = (0, 0, 0)) -> Any:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, mask, *position, *velocity, 0, 0, 0, 0, 0
    )


@pytest.mark.parametrize(
    ("behaviour", "speed_m_s", "heading_deg"),
    [(2, 1.0, 90.0), (2, 0.4, 0.0), (3, 1.1, 90.0), (3, 0.9, 0.0), (0, 1.0, 0.0)],
)
def test_a_setpoint_without_a_heading_turns_the_nose_to_the_motion(
    behaviour: int, speed_m_s: float, heading_deg: float
) -> None:
    """AutoYaw::default_mode, AC_PosControl::calculate_yaw_and_rate_yaw (4.6); flown beside it."""
    bare = BareAutopilot("ardupilot", parameters={"WP_YAW_BEHAVIOR": behaviour})
    bare.hover()
    for no_heading, wanted_deg in ((1 << 10, 0.0), (1 << 10 | 1 << 11, heading_deg)):
        bare.send(local_setpoint(0b000111000111 | no_heading, velocity=(0.0, speed_m_s, 0.0)))
        bare.estimate[4] = speed_m_s
        bare.run(0.5)
        target = bare.autopilot.flight.target
        assert target is not None
        assert math.degrees(target.yaw_rad or 0.0) == pytest.approx(wanted_deg, abs=0.1)
        bare.estimate[4] = 0.0
        bare.send(local_setpoint(0b000111000111, velocity=(0.0, 0.0, 0.0)))
        bare.run(0.1)


@pytest.mark.parametrize("height_m", [0.0, 1.5])
def test_a_setpoint_ends_a_takeoff(height_m: float) -> None:
    """The submode of mode_guided.cpp changes; on the ground it then stays there, and disarms."""
    bare = BareAutopilot("ardupilot")
    bare.run(42.0)
    assert (bare.command(176, 1, GUIDED), bare.command(400, 1)) == (0, 0)
    assert bare.command(22, 0, 0, 0, 0, 0, 0, 3) == 0
    bare.run(5.0 if height_m else 0.5)
    bare.height_m = height_m
    bare.send(local_setpoint(VELOCITY_MASK))
    bare.run(1.0)
    assert bare.autopilot.flight.landed is (height_m == 0.0)
    bare.run(11.0)
    assert bare.autopilot.flight.armed is (height_m > 0.0)


def test_a_takeoff_is_relative_and_upwards() -> None:
    bare = BareAutopilot("ardupilot")
    bare.run(42.0)
    assert (bare.command(176, 1, GUIDED), bare.command(400, 1)) == (0, 0)
    for frame, z, result in ((0, 500.0, 2), (6, 3.0, 2), (3, 0.0, FAILED), (3, 3.0, 0)):
        answers = bare.send(
            mavlink.MAVLink_command_int_message(1, 1, frame, 22, 0, 0, 0, 0, 0, 0, 0, 0, z)
        )
        assert [a.result for a in answers if a.get_type() == "COMMAND_ACK"] == [result], frame


def test_home_is_set_as_ardupilot_reads_it() -> None:
    """GCS_MAVLINK::handle_command_do_set_home: zeros are here, heights are by their frame."""
    bare = BareAutopilot("ardupilot")
    bare.run(42.0)
    place = (474000000, 85500000)
    for frame, z, result in ((6, 5.0, 0), (1, 5.0, 2), (0, 490.0, 0), (6, 5.0, 0)):
        answers = bare.send(
            mavlink.MAVLink_command_int_message(1, 1, frame, 179, 0, 0, 0, 0, 0, 0, *place, z)
        )
        assert [a.result for a in answers if a.get_type() == "COMMAND_ACK"] == [result], frame
    assert bare.autopilot.state.home_down_m == pytest.approx(488.0 - 495.0, abs=0.1)
    assert bare.command(179, 2, 0, 0, 0, 47.4, 8.55, 490.0) == FAILED
    assert bare.command(179) == 0
    assert bare.autopilot.state.home_ned_m == pytest.approx((0, 0, 0), abs=0.1)


def test_disarmed_it_takes_auto_without_a_mission_and_unknown_modes_are_named() -> None:
    bare = BareAutopilot("ardupilot")
    bare.run(42.0)
    assert bare.command(176, 1, AUTO) == 0
    assert bare.command(400, 1) == FAILED
    assert bare.command(176, 1, 99) == FAILED
    answers = bare.send(mavlink.MAVLink_set_mode_message(1, 1, GUIDED))
    # GCS_MAVLINK::handle_set_mode acknowledges nothing.
    assert [each.get_type() for each in answers if each.get_type() == "COMMAND_ACK"] == []
    texts = [each.text for each in bare.run(0.1) if each.get_type() == "STATUSTEXT"]
    assert "No such mode 99" in texts
    assert bare.command(400, 1) == 0
    assert bare.command(176, 1, AUTO) == FAILED


def test_a_destination_outside_of_the_fence_is_refused_or_ignored() -> None:
    """AC_Fence::check_destination_within_fence in ModeGuided::set_destination."""
    fence = {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 3.0, "FENCE_RADIUS": 30.0, "FENCE_ALT_MAX": 20.0}
    bare = BareAutopilot("ardupilot", parameters=fence)
    bare.hover()
    for north_m, up_m, flown in ((10.0, 5.0, True), (40.0, 5.0, False), (5.0, 25.0, False)):
        bare.send(local_setpoint(POSITION_MASK, position=(north_m, 0.0, -up_m)))
        bare.run(0.1)
        target = bare.autopilot.flight.target
        assert target is not None
        assert (target.position_ned_m == (north_m, 0.0, -up_m)) is flown
        where = bare.autopilot.state.frame.to_geodetic((north_m, 0.0, -up_m))
        place = (round(where.latitude_deg * 1e7), round(where.longitude_deg * 1e7), up_m)
        (ack,) = bare.send(
            mavlink.MAVLink_command_int_message(1, 1, 6, 192, 0, 0, -1, 1, 0, 0, *place)
        )
        assert ack.result == (0 if flown else FAILED)
    for frame, x in ((1, place[0]), (6, 0)):
        (ack,) = bare.send(
            mavlink.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, -1, 1, 0, 0, x, 0, 5.0)
        )
        assert ack.result == mavlink.MAV_RESULT_DENIED


def test_a_breach_is_no_failsafe_of_the_heartbeat_and_a_lost_station_is_until_it_is_back() -> None:
    """Copter::any_failsafe_triggered."""
    fence = {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 1.0, "FENCE_ALT_MAX": 10.0, "FS_GCS_ENABLE": 1.0}
    bare = BareAutopilot("ardupilot", parameters=fence)
    bare.hover()
    bare.send(HEARTBEAT)
    bare.height_m = 12.0
    bare.run(0.1)
    assert bare.autopilot.mode.value == RTL_MODE
    assert bare.autopilot._system_status() == mavlink.MAV_STATE_ACTIVE
    bare.run(6.0)
    assert bare.autopilot._system_status() == mavlink.MAV_STATE_CRITICAL
    bare.send(HEARTBEAT)
    bare.run(0.1)
    assert bare.autopilot._system_status() == mavlink.MAV_STATE_ACTIVE


@pytest.mark.parametrize(("profile", "volts"), [("cage", 6.6), ("nominal", 10.5)])
def test_the_low_voltage_suits_the_pack_unless_it_is_given(profile: str, volts: float) -> None:
    read = mavlink.MAVLink_param_request_read_message(1, 1, b"BATT_LOW_VOLT", -1)
    for given, wanted in (({}, volts), ({"BATT_LOW_VOLT": 9.0}, 9.0)):
        bare = BareAutopilot("ardupilot", profile=load_profile(profile), parameters=given)
        (value,) = bare.send(read)
        assert value.param_value == pytest.approx(wanted)
