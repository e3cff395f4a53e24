import asyncio
import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.bare_autopilot import BareAutopilot
from tests.vehicles.embedded.charge import set_remaining

HOLD, TAKEOFF_MODE, RTL_MODE, LAND_MODE = 0x03040000, 0x02040000, 0x05040000, 0x06040000
MISSION_MODE, OFFBOARD = 0x04040000, 0x00060000
VELOCITY_MASK = 0b0000_1101_1100_0111
POSITION_MASK = 0b0000_1101_1111_1000
Scenario = Callable[[Any], Any]


def px4(rig: Any, **config: Any) -> Any:
    return rig(autopilot="px4", **config)


def test_arming_is_refused_before_it_is_ready(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await asyncio.sleep(2.0)
            assert await r.command(400, 1) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            await asyncio.sleep(0.1)
            assert "Arming denied: Resolve system health failures first" in r.texts()
            assert r.status == mavlink.MAV_STATE_UNINIT
            await asyncio.sleep(4.0)
            assert r.status == mavlink.MAV_STATE_STANDBY
            assert await r.command(400, 1) == mavlink.MAV_RESULT_ACCEPTED
            assert r.armed

    virtually(scenario())


def test_says_texts_only_to_a_ground_station(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig, heartbeats=False) as r:
            await asyncio.sleep(7.0)
            assert await r.command(400, 1) == 0
            await asyncio.sleep(1.0)
            assert r.armed
            assert r.texts() == []

    virtually(scenario())


def test_arms_in_hold_then_takes_off_to_an_altitude(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await r.hover(2.0)
            assert r.height_m == pytest.approx(2.0, abs=0.15)
            assert r.custom_mode == HOLD
            assert r.last["HOME_POSITION"].z == pytest.approx(0.0, abs=0.05)

    virtually(scenario())


def test_disarms_itself_when_it_does_not_take_off(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await asyncio.sleep(6.6)
            assert await r.command(400, 1) == 0
            assert await r.until(lambda: not r.armed) == pytest.approx(10.0, abs=0.1)
            await asyncio.sleep(0.1)
            assert "Disarmed by auto preflight disarming" in r.texts()

    virtually(scenario())


def test_offboard_wants_a_stream_while_armed(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await r.hover()
            assert await r.command(176, 1, 6) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            await asyncio.sleep(1.0)
            assert "Switching to mode 'Offboard' is currently not possible" in r.texts()
            assert r.custom_mode == HOLD
            await r.stream(0.5, mask=VELOCITY_MASK)
            assert await r.command(176, 1, 6) == mavlink.MAV_RESULT_ACCEPTED
            await r.stream(1.2, mask=VELOCITY_MASK)
            assert r.custom_mode == OFFBOARD
            assert r.last["HEARTBEAT"].base_mode == 145

    virtually(scenario())


@pytest.mark.parametrize(
    ("action", "mode"), [(0, RTL_MODE), (3, RTL_MODE), (4, LAND_MODE), (5, HOLD)]
)
def test_lost_setpoints_act_as_the_parameter_says(
    rig: Any, virtually: Scenario, action: int, mode: int
) -> None:
    async def scenario() -> None:
        async with px4(rig, parameters={"COM_OBL_RC_ACT": action}) as r:
            await r.hover()
            await r.stream(0.5, mask=VELOCITY_MASK)
            assert await r.command(176, 1, 6) == 0
            await r.stream(1.0, mask=VELOCITY_MASK)
            waited_s = await r.until(lambda: r.vehicle.autopilot.failsafe)
            assert waited_s == pytest.approx(1.0, abs=0.12)
            await asyncio.sleep(1.1)
            assert r.custom_mode == mode
            assert r.status == mavlink.MAV_STATE_CRITICAL
            # The user takes over, and the failsafe is over.
            assert await r.command(176, 1, 4, 6) == 0
            await asyncio.sleep(1.1)
            assert r.custom_mode == LAND_MODE
            assert r.status == mavlink.MAV_STATE_ACTIVE

    virtually(scenario())


def test_lost_setpoints_may_disarm_or_terminate(rig: Any, virtually: Scenario) -> None:
    async def scenario(action: int) -> Any:
        async with px4(rig, parameters={"COM_OBL_RC_ACT": action}) as r:
            await r.hover()
            await r.stream(0.5, mask=VELOCITY_MASK)
            await r.command(176, 1, 6)
            await asyncio.sleep(3.5)
            assert r.vehicle.truth().on_ground
            return r

    assert virtually(scenario(6)).status == mavlink.MAV_STATE_FLIGHT_TERMINATION
    assert not virtually(scenario(7)).armed


def test_a_lost_ground_station_is_held_for_then_acted_on(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig, parameters={"NAV_DLL_ACT": 2, "COM_DL_LOSS_T": 5}) as r:
            await r.hover()
            r.silence()
            # COM_DL_LOSS_T, once the heartbeat counts as gone after 2.5 s.
            assert await r.until(lambda: r.vehicle.autopilot.failsafe) == pytest.approx(
                7.5, abs=0.6
            )
            await asyncio.sleep(1.0)
            assert r.custom_mode == HOLD
            await asyncio.sleep(5.5)
            assert r.custom_mode == RTL_MODE

    virtually(scenario())


def test_by_default_a_lost_ground_station_is_ignored(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await r.hover()
            r.silence()
            await asyncio.sleep(20.0)
            assert r.custom_mode == HOLD
            assert r.status == mavlink.MAV_STATE_ACTIVE

    virtually(scenario())


def test_a_low_battery_warns_then_lands(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig, parameters={"COM_LOW_BAT_ACT": 3, "COM_FAIL_ACT_T": 0.0}) as r:
            await r.hover()
            set_remaining(r.vehicle.body.battery, 0.12)
            await asyncio.sleep(0.3)
            assert "Low battery level, return advised" in r.texts()
            set_remaining(r.vehicle.body.battery, 0.06)
            await asyncio.sleep(1.2)
            assert r.custom_mode == RTL_MODE
            set_remaining(r.vehicle.body.battery, 0.04)
            await asyncio.sleep(1.2)
            assert r.custom_mode == LAND_MODE
            await r.until(lambda: not r.armed)

    virtually(scenario())


def test_lands_and_returns_on_command(rig: Any, virtually: Scenario) -> None:
    async def scenario(command: int, mode: int) -> None:
        async with px4(rig, parameters={"COM_OF_LOSS_T": 5.0}) as r:
            await r.hover()
            await r.stream(0.2, mask=POSITION_MASK, position=(3.0, 0.0, -3.0))
            await r.command(176, 1, 6)
            await r.stream(6.0, mask=POSITION_MASK, position=(3.0, 0.0, -3.0))
            assert r.vehicle.truth().pose.position_ned_m[0] == pytest.approx(3.0, abs=0.2)
            assert await r.command(command) == 0
            await asyncio.sleep(1.1)
            assert r.custom_mode == mode
            await r.until(lambda: not r.armed)
            north_m = 0.0 if mode == RTL_MODE else 3.0
            assert r.vehicle.truth().pose.position_ned_m[0] == pytest.approx(north_m, abs=0.3)
            assert r.vehicle.truth().on_ground

    virtually(scenario(21, LAND_MODE))
    virtually(scenario(20, RTL_MODE))


def test_a_return_with_a_negative_land_delay_stays_above_home(
    rig: Any, virtually: Scenario
) -> None:
    async def scenario() -> None:
        async with px4(rig, parameters={"RTL_LAND_DELAY": -1.0, "RTL_RETURN_ALT": 5.0}) as r:
            await r.hover()
            assert await r.command(20) == 0
            await asyncio.sleep(40.0)
            assert r.armed
            assert r.custom_mode == RTL_MODE
            assert r.height_m > 2.5

    virtually(scenario())


def test_disarming_in_the_air_needs_force(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await r.hover()
            assert await r.command(400, 0) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            assert r.armed
            assert await r.command(400, 0, 21196) == 0
            assert not r.armed
            await asyncio.sleep(2.0)
            assert r.vehicle.truth().on_ground

    virtually(scenario())


def test_termination_cuts_the_motors_for_good(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            assert await r.command(185, 1) == mavlink.MAV_RESULT_DENIED
            await r.hover()
            assert await r.command(185, 1) == 0
            await asyncio.sleep(2.0)
            assert r.vehicle.truth().motors_stopped
            assert r.status == mavlink.MAV_STATE_FLIGHT_TERMINATION
            assert await r.command(176, 1, 4, 3) != 0

    virtually(scenario())


def test_goes_where_it_is_sent(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await r.hover()
            goal = r.vehicle.autopilot.state.frame.to_geodetic((2.0, -1.0, -2.0))
            x, y = round(goal.latitude_deg * 1e7), round(goal.longitude_deg * 1e7)
            frame = mavlink.MAV_FRAME_GLOBAL
            params = (-1.0, 1.0, 0.0, math.nan)
            place = (x, y, goal.altitude_m)
            assert await r.command_int(192, frame=frame, params=params, place=place) == 0
            await asyncio.sleep(8.0)
            assert r.vehicle.truth().pose.position_ned_m == pytest.approx((2, -1, -2), abs=0.2)
            assert r.custom_mode == HOLD

    virtually(scenario())


def test_flies_the_setpoints_of_offboard(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await r.hover()
            await r.stream(0.3, mask=VELOCITY_MASK)
            await r.command(176, 1, 6)
            await r.stream(3.0, mask=VELOCITY_MASK, velocity=(0.0, 1.0, 0.0))
            assert r.vehicle.truth().velocity_ned_m_s == pytest.approx((0, 1, 0), abs=0.15)
            turn = 0b0000_0101_1100_0111
            await r.stream(4.0, mask=turn, yaw_rate=0.3)
            assert r.vehicle.truth().pose.yaw_rad == pytest.approx(1.2, abs=0.2)
            # Body frame: forward is where the nose points.
            await r.stream(3.0, mask=VELOCITY_MASK, frame=8, velocity=(1.0, 0.0, 0.0))
            yaw = r.vehicle.truth().pose.yaw_rad
            expected = (math.cos(yaw), math.sin(yaw), 0.0)
            assert r.vehicle.truth().velocity_ned_m_s == pytest.approx(expected, abs=0.2)
            facing = 0b0000_1001_1111_1000
            place = r.vehicle.truth().pose.position_ned_m
            await r.stream(5.0, mask=facing, position=place, yaw=-0.5)
            assert r.vehicle.truth().pose.yaw_rad == pytest.approx(-0.5, abs=0.05)
            assert r.vehicle.truth().pose.position_ned_m == pytest.approx(place, abs=0.15)
            r.setpoint(mask=VELOCITY_MASK, frame=7)
            await asyncio.sleep(0.1)
            assert "SET_POSITION_TARGET_LOCAL_NED coordinate frame 7 unsupported" in r.texts()

    virtually(scenario())


def test_a_height_above_home_counts_where_the_place_is_ignored(
    rig: Any, virtually: Scenario
) -> None:
    """Whose latitude and longitude are 0: a height over there lies beneath the horizon."""

    async def scenario() -> None:
        async with px4(rig) as r:
            await r.hover()
            ignores_place_and_climb = 0b0000_1001_1110_0011
            for turn in range(60):
                if turn == 3:
                    assert await r.command(176, 1, 6) == 0
                r.send(
                    mavlink.MAVLink_set_position_target_global_int_message(
                        0, 1, 1, 6, ignores_place_and_climb, 0, 0, 4.0, 0.5, *(0.0,) * 7
                    )
                )
                await asyncio.sleep(0.1)
            assert r.height_m == pytest.approx(4.0, abs=0.3)
            assert r.vehicle.truth().velocity_ned_m_s[0] == pytest.approx(0.5, abs=0.15)

    virtually(scenario())


def test_never_ready_and_refusal_are_faults_of_the_configuration(
    rig: Any, virtually: Scenario
) -> None:
    async def scenario() -> None:
        async with px4(rig, never_ready=True) as r:
            await asyncio.sleep(30.0)
            bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
            assert not any(m.onboard_control_sensors_health & bit for m in r.of("SYS_STATUS"))
            assert await r.command(400, 1) != 0
        async with px4(rig, refuse_arm="Compass not calibrated") as r:
            await asyncio.sleep(7.0)
            assert await r.command(400, 1) != 0
            assert await r.command(400, 1, 21196) != 0
            await asyncio.sleep(0.1)
            assert "Arming denied: Compass not calibrated" in r.texts()

    virtually(scenario())


def test_manual_modes_cannot_be_flown_without_sticks(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await asyncio.sleep(6.6)
            assert await r.command(176, 1, 3) == 0
            assert await r.command(400, 1) != 0
            assert await r.command(176, 1, 4, 3) == 0
            await r.hover()
            assert await r.command(176, 1, 3) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            # Unknown numbers change nothing, and are accepted (Commander.cpp); AUTO's are not.
            assert await r.command(176, 1, 99) == 0
            assert await r.command(176, 0, 4, 3) == 0
            assert await r.command(176, 1, 4, 99) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            # The emulation has no precision landing.
            assert await r.command(176, 1, 4, 9) == mavlink.MAV_RESULT_DENIED
            await asyncio.sleep(1.1)
            assert r.custom_mode == 4 << 16 | 3 << 24

    virtually(scenario())


def test_old_set_mode_message_is_taken(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with px4(rig) as r:
            await r.hover()
            r.send(mavlink.MAVLink_set_mode_message(1, 1, LAND_MODE))
            await asyncio.sleep(1.1)
            assert r.custom_mode == LAND_MODE

    virtually(scenario())


def test_return_height_is_a_cone_near_home(rig: Any, virtually: Scenario) -> None:
    async def scenario(north_m: float) -> float:
        async with px4(rig) as r:
            await r.hover()
            await r.stream(0.2, mask=POSITION_MASK, position=(north_m, 0.0, -3.0))
            await r.command(176, 1, 6)
            await r.stream(4.0 + north_m, mask=POSITION_MASK, position=(north_m, 0.0, -3.0))
            await r.command(20)
            await asyncio.sleep(0.2)
            text = "".join(m.text for m in r.of("STATUSTEXT")[-2:])
            return float(text.split("(")[1].split(" m above")[0])

    # Within NAV_ACC_RAD twice the distance, never below where it is; beyond it RTL_RETURN_ALT.
    assert virtually(scenario(1.0)) == 3.0
    assert virtually(scenario(5.0)) == pytest.approx(10.0, abs=1.0)
    assert virtually(scenario(14.0)) == 30.0


def test_disarming_is_refused_from_the_takeoff_on_and_numbers_are_rounded() -> None:
    """The land detector sees a takeoff before the vehicle leaves the ground; lroundf(param1)."""
    bare = BareAutopilot("px4")
    bare.run(7.0)
    assert bare.command(176, 1, 4, 2) == 0
    assert bare.command(400, 0.6) == 0
    bare.run(1.0)
    assert bare.command(400, 0.4) == 0
    assert bare.command(400, 1) == 0
    bare.run(2.2)
    assert bare.autopilot.flight.landed
    assert bare.command(400, 0) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_a_return_and_a_landing_by_command_have_texts() -> None:
    bare = BareAutopilot("px4")
    bare.hover()
    bare.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    assert bare.command(20) == 0
    said = [each.text for each in bare.run(0.1) if each.get_type() == "STATUSTEXT"]
    assert said[0] == "Returning to launch\t"
    assert said[1].startswith("RTL: start return")
    assert bare.command(21) == 0
    said = [each.text for each in bare.run(0.1) if each.get_type() == "STATUSTEXT"]
    assert said == ["Landing at current position\t"]


def test_a_reboot_of_nothing_is_accepted_and_of_others_denied() -> None:
    bare = BareAutopilot("px4")
    bare.run(7.0)
    assert bare.command(246, 0) == 0
    assert bare.command(246, 5) == mavlink.MAV_RESULT_DENIED
    assert not bare.autopilot.reboot_requested
