"""What a client changes while ArduCopter flies: pauses, and what the nose points at."""

import asyncio
import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.flight.test_mission_flight import at, begin, mission, ready
from tests.vehicles.embedded.autopilot.services.test_missions import item, upload

Scenario = Callable[[Any], Any]
PAUSE, ROI, NO_ROI = 193, 195, 197
VELOCITY = 3527


def north_m(r: Any) -> float:
    return float(r.vehicle.truth().pose.position_ned_m[0])


def heading_deg(r: Any) -> float:
    return math.degrees(r.vehicle.autopilot.state.now.euler_rad[2])


async def look(r: Any, north: float, east: float) -> int:
    place = at(r, north, east)
    return int(
        await r.command_int(
            ROI, frame=3, params=(0.0, 0.0, 0.0, 0.0), place=(place["x"], place["y"], 0.0)
        )
    )


def test_guided_pauses_goes_on_and_looks_at_a_region(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="ardupilot") as r:
            await r.hover()
            assert await look(r, 0.0, 30.0) == 0
            await asyncio.sleep(4.0)
            assert heading_deg(r) == pytest.approx(90.0, abs=6.0)
            assert await r.command(PAUSE, 2.0) == mavlink.MAV_RESULT_DENIED
            assert await r.command(PAUSE, 0.0) == 0
            # Setpoints wait for the end of the pause.
            r.setpoint(mask=3576, position=(4.0, 0.0, -3.0))
            await asyncio.sleep(3.0)
            assert abs(north_m(r)) < 0.5
            assert await r.command(PAUSE, 1.0) == 0
            await r.until(lambda: abs(north_m(r) - 4.0) < 0.6, limit_s=20.0)
            assert await look(r, -30.0, 0.0) == 0
            await asyncio.sleep(5.0)
            assert abs(heading_deg(r)) == pytest.approx(180.0, abs=6.0)
            assert await r.command(NO_ROI) == 0
            assert await r.command(ROI, 0, 0, 0, 0, 100.0, 0.0) == mavlink.MAV_RESULT_FAILED
            assert await r.command(176, 1, 17) == 0
            assert await r.command(PAUSE, 0.0) == mavlink.MAV_RESULT_FAILED

    virtually(scenario())


def test_a_mission_pauses_on_its_way(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="ardupilot") as r:
            await ready(r)
            items = mission(
                r,
                item(0, 22, 0, z=3.0),
                item(0, ROI, 0, z=0.0, **at(r, 0.0, 300.0)),
                item(0, 16, 0, z=3.0, **at(r, 30.0, 0.0)),
            )
            assert await upload(r, 0, items) == 0
            await begin(r)
            assert await r.command(PAUSE, 0.0) == mavlink.MAV_RESULT_FAILED
            await r.until(lambda: north_m(r) > 3.0)
            assert await r.command(PAUSE, 0.0) == 0
            await asyncio.sleep(5.0)
            stood = north_m(r)
            assert await r.command(512, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT) == 0
            assert r.last["MISSION_CURRENT"].mission_state == mavlink.MISSION_STATE_PAUSED
            await asyncio.sleep(2.0)
            assert north_m(r) == pytest.approx(stood, abs=0.3)
            assert heading_deg(r) == pytest.approx(90.0, abs=8.0)
            assert await r.command(PAUSE, 1.0) == 0
            await r.until(lambda: len(r.of("MISSION_ITEM_REACHED")) == 2)
            assert north_m(r) == pytest.approx(30.0, abs=2.5)

    virtually(scenario())


def test_px4_takes_regions_of_interest_for_its_gimbal(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await asyncio.sleep(1.0)
            assert await look(r, 0.0, 30.0) == 0
            assert await r.command(PAUSE, 0.0) == mavlink.MAV_RESULT_UNSUPPORTED

    virtually(scenario())
