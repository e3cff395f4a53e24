import asyncio
import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.charge import set_remaining
from wil_campaign.vehicles.embedded.physics.plant import PlantError
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.worlds.frames import Pose, angle_between

Scenario = Callable[[Any], Any]
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
CAGE = load_profile("cage")


class Wall:
    """A wall across the way north."""

    def __init__(self, north_m: float) -> None:
        self.north_m = north_m
        self.events: list[tuple[str, float]] = []

    def contact(self, pose_0: Pose, t_0: float, pose_1: Pose, t_1: float) -> str | None:
        assert t_1 > t_0
        return "wall" if pose_1.position_ned_m[0] > self.north_m else None

    def notify(self, event: str, t_s: float) -> None:
        self.events.append((event, t_s))


def test_the_same_seed_flies_the_same_bytes(rig: Any, virtually: Scenario) -> None:
    async def scenario(seed: int) -> tuple[str, tuple[float, float, float]]:
        async with rig(autopilot="px4", profile=CAGE, seed=seed) as r:
            await r.hover()
            await r.stream(2.0, mask=3527, velocity=(1.0, 0.0, 0.0))
            digest = hashlib.sha256(bytes(r.raw)).hexdigest()
            return digest, r.vehicle.truth().pose.position_ned_m

    first, again, other = virtually(scenario(7)), virtually(scenario(7)), virtually(scenario(8))
    assert first == again
    assert first[0] != other[0]
    assert first[1] != other[1]


@BOTH
def test_flies_in_the_cage(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot, profile=CAGE) as r:
            await r.hover(1.2)
            samples: list[Any] = []
            r.vehicle.on_truth(samples.append, 10)
            await asyncio.sleep(20.0)
            heights = [-s.pose.position_ned_m[2] for s in samples]
            assert max(abs(h - 1.2) for h in heights) < 0.3
            off_m = max(math.hypot(*s.pose.position_ned_m[:2]) for s in samples)
            assert 0.01 < off_m < 0.6

    virtually(scenario())


def test_truth_starts_where_the_vehicle_stands(rig: Any, virtually: Scenario) -> None:
    start = Pose.of(1.5, -2.0, 0.3, yaw_rad=2.0)

    async def scenario() -> None:
        async with rig(autopilot="px4", start=start) as r:
            await asyncio.sleep(0.1)
            truth = r.vehicle.truth()
            assert truth.pose.position_ned_m == pytest.approx(start.position_ned_m, abs=1e-3)
            assert angle_between(truth.pose.q_wxyz, start.q_wxyz) < 1e-3
            assert truth.on_ground
            assert truth.motors_stopped
            # The estimator counts from where it began, and points where the vehicle points.
            local = r.last["LOCAL_POSITION_NED"]
            assert (local.x, local.y, local.z) == pytest.approx((0, 0, 0), abs=0.05)
            assert r.last["ATTITUDE"].yaw == pytest.approx(2.0, abs=0.02)
            await r.hover(1.0)
            assert r.vehicle.truth().pose.position_ned_m == pytest.approx(
                (1.5, -2.0, -1.0), abs=0.15
            )

    virtually(scenario())


def test_a_hall_need_not_face_north(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        start = Pose.of(1.0, 0.0, 0.0, yaw_rad=0.5)
        async with rig(autopilot="ardupilot", start=start, heading_rad=-1.0) as r:
            await r.hover(2.0)
            assert await r.command(512, mavlink.MAVLINK_MSG_ID_ATTITUDE) == 0
            assert r.last["ATTITUDE"].yaw == pytest.approx(-1.0, abs=0.05)
            assert r.vehicle.truth().pose.yaw_rad == pytest.approx(0.5, abs=0.05)
            # Two metres to the earth's north are two metres to 1.5 rad in the hall.
            r.setpoint(mask=0b0000_1101_1111_1000, position=(2.0, 0.0, -2.0))
            await asyncio.sleep(8.0)
            expected = (1.0 + 2.0 * math.cos(1.5), 2.0 * math.sin(1.5), -2.0)
            assert r.vehicle.truth().pose.position_ned_m == pytest.approx(expected, abs=0.2)

    virtually(scenario())


def test_truth_and_motion_capture_come_at_their_rates(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4", profile=CAGE) as r:
            truths: list[Any] = []
            readings: list[Any] = []
            r.vehicle.on_truth(truths.append, 50)
            r.vehicle.on_mocap(readings.append)
            await asyncio.sleep(10.0)
            assert len(truths) == pytest.approx(500, abs=1)
            assert len(readings) == pytest.approx(1000, abs=3)
            gaps = {round(b.t_s - a.t_s, 3) for a, b in pairwise(truths)}
            assert gaps == {0.02}
            latencies = [reading.arrived_s - reading.t_s for reading in readings]
            assert min(latencies) >= CAGE.mocap.latency_s - 1e-9
            assert max(latencies) <= CAGE.mocap.latency_s + 0.008
            assert {reading.source for reading in readings} == {"real"}

    virtually(scenario())


@BOTH
def test_a_physical_contact_stops_the_motors(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        wall = Wall(1.0)
        async with rig(autopilot=autopilot, contact_world=wall) as r:
            await r.hover(2.0)
            await r.stream(0.3, mask=3527, velocity=(1.0, 0.0, 0.0))
            if autopilot == "px4":
                await r.command(176, 1, 6)
            await r.stream(4.0, mask=3527, velocity=(1.0, 0.0, 0.0))
            truth = r.vehicle.truth()
            assert truth.contact == "wall"
            assert truth.motors_stopped
            assert truth.on_ground
            assert any("wall" in text for text in r.texts())
            status = mavlink.MAV_STATE_FLIGHT_TERMINATION if autopilot == "px4" else 3
            assert r.status == status
            assert truth.pose.position_ned_m[0] < 2.5

    virtually(scenario())


def test_it_passes_events_to_moving_objects(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        wall = Wall(1.0)
        async with rig(autopilot="px4", contact_world=wall) as r:
            r.vehicle.notify("gate_passed", 1.5)
            assert wall.events == [("gate_passed", 1.5)]
        async with rig(autopilot="px4") as r:
            r.vehicle.notify("gate_passed", 1.5)

    virtually(scenario())


def test_it_is_silent_after_a_kill(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await r.hover()
            r.vehicle.kill()
            await asyncio.sleep(0.1)
            heard, where = len(r.heard), r.vehicle.truth()
            await asyncio.sleep(5.0)
            assert len(r.heard) == heard
            assert r.vehicle.truth() == where

    virtually(scenario())


def test_it_flies_on_while_it_is_mute(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await r.hover()
            r.vehicle.mute(muted=True)
            await asyncio.sleep(0.1)
            heard = len(r.heard)
            r.send(mavlink.MAVLink_command_long_message(1, 1, 21, 0, 0, 0, 0, 0, 0, 0, 0))
            await asyncio.sleep(5.0)
            assert len(r.heard) == heard
            assert r.height_m == pytest.approx(3.0, abs=0.2)
            r.vehicle.mute(muted=False)
            await asyncio.sleep(1.1)
            assert len(r.heard) > heard
            assert r.custom_mode == 0x03040000

    virtually(scenario())


@BOTH
def test_a_failed_motor_brings_it_down(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await r.hover()
            r.vehicle.fail_motor(2)
            await r.until(lambda: not r.armed, limit_s=6.0)
            truth = r.vehicle.truth()
            assert truth.contact == "ground"
            assert truth.motors_stopped
            assert r.height_m == pytest.approx(0.0, abs=0.2)
            assert math.hypot(*truth.pose.position_ned_m[:2]) < 3.0
            assert any("ground" in text for text in r.texts())

    virtually(scenario())


@BOTH
def test_it_falls_with_an_empty_battery(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await r.hover()
            set_remaining(r.vehicle.body.battery, 0.0)
            await r.until(lambda: r.vehicle.truth().on_ground, limit_s=3.0)

    virtually(scenario())


@pytest.mark.parametrize(("from_deg", "ahead"), [(0.0, True), (180.0, False)])
def test_a_script_sets_the_wind_of_arducopter(
    rig: Any, virtually: Scenario, from_deg: float, ahead: bool
) -> None:
    """Its nose goes down into the wind of its SITL: 30 m/s are 9.5 m/s at a height of 6 m."""

    async def scenario() -> list[float]:
        async with rig(autopilot="ardupilot") as r:
            await r.hover(6.0)
            found = []
            for speed in (0.0, 30.0):
                for name, value in ((b"SIM_WIND_DIR", from_deg), (b"SIM_WIND_SPD", speed)):
                    r.send(mavlink.MAVLink_param_set_message(1, 1, name, value, 9))
                await asyncio.sleep(15.0)
                pose = r.vehicle.truth().pose
                found.append(pose.to_parent((1.0, 0.0, 0.0))[2] - pose.position_ned_m[2])
            return found

    still, blown = virtually(scenario())
    assert abs(still) < 0.02
    assert (blown > 0.05) if ahead else (blown < -0.05)


def test_px4_terminates_a_tumble_only_without_its_breaker(rig: Any, virtually: Scenario) -> None:
    async def scenario(breaker: int) -> bool:
        parameters = {"CBRK_FLIGHTTERM": breaker}
        async with rig(autopilot="px4", parameters=parameters) as r:
            await r.hover(8.0)
            r.vehicle.fail_motor(2)
            await asyncio.sleep(0.8)
            assert r.height_m > 1.0
            return bool(r.vehicle.autopilot.terminated)

    assert virtually(scenario(0))
    assert not virtually(scenario(121212))


def test_its_clock_is_its_own(rig: Any, virtually: Scenario) -> None:
    clock = CAGE.clock.model_copy(update={"boot_offset_s": 12.5, "drift_ppm": 400.0})

    async def scenario() -> None:
        profile = CAGE.model_copy(update={"clock": clock})
        async with rig(autopilot="px4", profile=profile) as r:
            await asyncio.sleep(50.0)
            sent_s, message = next(
                (t, m) for t, m in reversed(r.heard) if m.get_type() == "ATTITUDE"
            )
            expected_s = 12.5 + (sent_s - 0.003) * (1.0 + 400e-6)
            assert message.time_boot_ms / 1e3 == pytest.approx(expected_s, abs=0.009)

    virtually(scenario())


def test_its_time_boot_ms_begins_anew_after_49_days(rig: Any, virtually: Scenario) -> None:
    clock = CAGE.clock.model_copy(update={"boot_offset_s": 2**32 * 1e-3 - 1.0, "drift_ppm": 0.0})

    async def scenario() -> None:
        profile = CAGE.model_copy(update={"clock": clock})
        async with rig(autopilot="px4", profile=profile) as r:
            await asyncio.sleep(3.0)
            stamps = [m.time_boot_ms for _, m in r.heard if m.get_type() == "ATTITUDE"]
            assert max(stamps) > 2**32 - 200
            assert 1800 < stamps[-1] < 2001

    virtually(scenario())


def test_a_failure_of_the_physics_is_loud(rig: Any, virtually: Scenario) -> None:
    faults: list[str] = []

    async def scenario() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda *_: None)
        async with rig(autopilot="px4") as r:
            r.vehicle.on_fault(lambda: faults.append("fault"))
            await r.hover()
            r.vehicle.body._plant._factors[0] = math.nan
            await asyncio.sleep(1.0)

    with pytest.raises(PlantError, match="diverged"):
        virtually(scenario())
    assert faults == ["fault"]


def test_after_a_long_stop_time_is_dropped(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await asyncio.sleep(2.0)
            # As when the process was stopped: the timer fires ten seconds late.
            vehicle = r.vehicle
            vehicle._timer.cancel()
            await asyncio.sleep(10.0)
            vehicle._tick()
            await asyncio.sleep(1.0)
            assert vehicle.autopilot.t_s == pytest.approx(3.0, abs=0.05)
            assert vehicle.truth().t_s == pytest.approx(13.0, abs=0.05)

    virtually(scenario())


def test_a_standing_vehicle_costs_no_physics(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await asyncio.sleep(3.0)
            before = r.vehicle.body._plant._fdm.get_sim_time()
            await asyncio.sleep(3.0)
            assert r.vehicle.body._plant._fdm.get_sim_time() == before
            await r.hover()
            assert r.vehicle.body._plant._fdm.get_sim_time() > before

    virtually(scenario())


def test_unequal_motors_and_sag_differ_by_seed(rig: Any, virtually: Scenario) -> None:
    motors = CAGE.motors.model_copy(update={"spread": 0.05})
    profile = CAGE.model_copy(update={"motors": motors})

    async def scenario(seed: int) -> list[float]:
        async with rig(autopilot="px4", profile=profile, seed=seed) as r:
            return list(r.vehicle.body._plant._factors)

    assert virtually(scenario(1)) != virtually(scenario(2))
    assert virtually(scenario(1)) == virtually(scenario(1))


def test_a_system_id_must_be_one(rig: Any) -> None:
    with pytest.raises(ValueError, match="system_id"):
        rig(autopilot="px4", system_id=0)


def test_unknown_parameters_are_named(rig: Any) -> None:
    with pytest.raises(ValueError, match="NO_SUCH"):
        rig(autopilot="px4", parameters={"NO_SUCH": 1.0})


def test_the_configuration_can_be_replaced(rig: Any) -> None:
    config = rig(autopilot="px4").config
    assert replace(config, system_id=3).system_id == 3
