"""Guided flight beyond setpoints: items, places, headings, speeds, and a person's sticks."""

import asyncio
import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.services.test_missions import BOTH

Scenario = Callable[[Any], Any]
MODE, REPOSITION, YAW, SPEED = 176, 192, 115, 178


def degrees(r: Any, north_m: float, east_m: float) -> tuple[float, float]:
    place = r.vehicle.autopilot.state.frame.to_geodetic((north_m, east_m, 0.0))
    return place.latitude_deg, place.longitude_deg


def north_m(r: Any) -> float:
    return float(r.vehicle.truth().pose.position_ned_m[0])


def test_a_guided_item_moves_arducopter(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="ardupilot") as r:
            await r.hover()
            latitude, longitude = degrees(r, 5.0, 0.0)

            def go() -> None:
                r.send(mavlink.MAVLink_mission_item_message(
                    1, 1, 0, 3, 16, 2, 1, 0, 0, 0, 0, latitude, longitude, 4.0
                ))  # fmt: skip

            go()
            await asyncio.sleep(0.1)
            assert r.last["MISSION_ACK"].type == mavlink.MAV_MISSION_ACCEPTED
            await r.until(lambda: abs(north_m(r) - 5.0) < 0.7 and r.height_m > 3.6, limit_s=20.0)
            assert await r.command(MODE, 1, 17) == 0
            go()
            await asyncio.sleep(0.1)
            assert r.last["MISSION_ACK"].type == mavlink.MAV_MISSION_ERROR

    virtually(scenario())


def test_reposition_by_each_firmwares_forms(rig: Any, virtually: Scenario) -> None:
    async def scenario(autopilot: str) -> None:
        async with rig(autopilot=autopilot) as r:
            await r.hover()
            latitude, longitude = degrees(r, 3.0, 0.0)
            as_long = await r.command(
                REPOSITION, -1, 1, 0, math.nan, latitude, longitude, r.config.altitude_m + 3.0
            )
            place = (round(latitude * 1e7), round(longitude * 1e7))
            if autopilot == "ardupilot":
                # ArduCopter knows the COMMAND_INT alone, whose frame says what the height is.
                assert as_long == mavlink.MAV_RESULT_UNSUPPORTED
                z = 3.0
            else:
                # PX4 takes the height above mean sea level, whatever the frame says.
                assert as_long == 0
                z = r.config.altitude_m + 3.0
            assert (
                await r.command_int(
                    REPOSITION, frame=6, params=(-1, 1, 0, math.nan), place=(*place, z)
                )
                == 0
            )
            await r.until(lambda: abs(north_m(r) - 3.0) < 0.6, limit_s=20.0)
            assert r.height_m == pytest.approx(3.0, abs=0.4)
            away = (2_000_000_000, place[1], z)
            denied = mavlink.MAV_RESULT_DENIED
            changing, staying = (-1, 1, 0, math.nan), (-1, 0, 0, math.nan)
            assert await r.command_int(REPOSITION, frame=6, params=changing, place=away) == denied
            # Without the flag of a change of mode PX4 does not know it; ArduCopter is in GUIDED.
            assert await r.command_int(REPOSITION, frame=6, params=staying, place=(*place, z)) == (
                0 if autopilot == "ardupilot" else mavlink.MAV_RESULT_UNSUPPORTED
            )

    virtually(scenario("px4"))
    virtually(scenario("ardupilot"))


def test_condition_yaw_turns_arducopter(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="ardupilot") as r:
            await r.hover()
            assert await r.command(YAW, 90, 30, 1, 0) == 0
            await asyncio.sleep(5.0)
            assert math.degrees(r.last["ATTITUDE"].yaw) == pytest.approx(90.0, abs=4.0)
            assert await r.command(YAW, 45, 30, -1, 1) == 0
            await asyncio.sleep(5.0)
            assert math.degrees(r.last["ATTITUDE"].yaw) == pytest.approx(45.0, abs=4.0)
            assert await r.command(YAW, math.nan) == mavlink.MAV_RESULT_FAILED

    async def asked() -> None:
        async with rig(autopilot="px4") as r:
            await asyncio.sleep(7.0)
            assert await r.command(YAW, 90) == mavlink.MAV_RESULT_UNSUPPORTED

    virtually(with_attitude(scenario, rig))
    virtually(asked())


async def with_attitude(scenario: Callable[[], Any], rig: Any) -> None:
    """Run a scenario in which ATTITUDE streams, which ArduPilot sends only when asked."""
    sound = rig.hover

    async def hover(self: Any, height_m: float = 3.0) -> None:
        await sound(self, height_m)
        assert await self.command(511, 30, 1e5) == 0

    rig.hover = hover
    try:
        await scenario()
    finally:
        rig.hover = sound


@BOTH
def test_a_change_of_speed_acts_in_flight(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await r.hover()
            latitude, longitude = degrees(r, 40.0, 0.0)
            z = 3.0 + (r.config.altitude_m if autopilot == "px4" else 0.0)
            place = (round(latitude * 1e7), round(longitude * 1e7), z)
            params = (-1.0, 1.0, 0.0, math.nan)
            assert await r.command_int(REPOSITION, frame=6, params=params, place=place) == 0
            assert await r.command(SPEED, 1, 1.2, -1) == 0
            await asyncio.sleep(6.0)
            assert r.speed_m_s == pytest.approx(1.2, abs=0.25)
            # PX4 takes all of them for its own speed again (navigator_main.cpp).
            refused = 0 if autopilot == "px4" else mavlink.MAV_RESULT_FAILED
            for none in (math.nan, 0.0, -1.0):
                assert await r.command(SPEED, 1, none) == refused
            await r.command(176, 1, *((4, 3) if autopilot == "px4" else (5,)))
            assert await r.command(SPEED, 1, 1.2) == refused

    virtually(scenario())


@BOTH
def test_sticks_fly(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await r.hover()

            async def push(seconds: float, x: int, z: int = 500) -> None:
                for _ in range(round(seconds * 10)):
                    r.send(mavlink.MAVLink_manual_control_message(1, x, 0, z, 0, 0))
                    await asyncio.sleep(0.1)

            mode = (3, 0) if autopilot == "px4" else (5, 0)
            await push(0.5, 0)
            assert await r.command(MODE, 1, *mode) == 0
            await push(3.0, 200)
            assert north_m(r) > 1.0
            await push(4.0, 0)
            stood = north_m(r)
            await push(2.0, 0, 800)
            assert r.height_m > 3.8
            assert north_m(r) == pytest.approx(stood, abs=0.4)
            # Without sticks PX4 returns, ArduCopter stays where it is.
            await asyncio.sleep(4.0)
            assert r.vehicle.autopilot.failsafe is (autopilot == "px4")

    virtually(scenario())


def test_rc_override_flies_arducopter(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="ardupilot") as r:
            await r.hover()
            assert await r.command(MODE, 1, 5) == 0

            def override(*pulses_us: int) -> None:
                four = [*pulses_us, 0, 0, 0, 0]
                r.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *four))

            for _ in range(30):
                override(1500, 1400, 1500, 1500)
                await asyncio.sleep(0.1)
            assert north_m(r) > 1.0
            override(0, 0, 0, 0)
            await asyncio.sleep(3.0)
            assert r.speed_m_s < 0.3

    virtually(scenario())
