"""What is injected comes from the right reading, at its rate, through the vehicle's driver."""

import asyncio
import math
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import pytest

from tests.orchestrator.external.rigs import FakeDriver, FakeStation
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.foundation.files.documents import parse_document
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.injection.injection_setups import InjectionSetup
from wil_campaign.plugins.injection.injector import Injector, ScenePoses
from wil_campaign.vehicles.readings import LidarScanReading, PoseReading, RangefinderReading
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.geodesy import Geodetic, LocalFrame
from wil_campaign.worlds.world_file.world import World

WORLD = """\
schema: wil/world/1
origin: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488}
objects:
  intruder:
    shape: {box: {size_m: [0.5, 0.5, 0.2]}}
    pose: {north_m: 100, up_m: 20}
    exists_in: {sim: Wv, wil: Wv}
    motion:
      waypoints:
        - {north_m: 0, east_m: 0, up_m: 20, speed_m_s: 10}
  pad:
    shape: {box: {size_m: [0.5, 0.5, 0.02]}}
    pose: {north_m: 3, east_m: -1, up_m: 0.02}
"""


def scan(t_s: float, seq: int = 0) -> LidarScanReading:
    ranges = np.full(72, 2.5, np.float32)
    return LidarScanReading(
        t_s=t_s,
        arrived_s=t_s,
        seq=seq,
        source="mixed",
        start_angle_rad=-math.pi,
        step_rad=math.radians(5.0),
        ranges_m=ranges,
        range_min_m=0.1,
        range_max_m=10.0,
    )


def pose(t_s: float, velocity: tuple[float, float, float] | None = None) -> PoseReading:
    return PoseReading(t_s, t_s, "real", Pose((1.0, 2.0, -3.0)), velocity, seq=0)


def injector(
    context: FakeStation,
    *injections: InjectionSetup,
    autopilot: str = "px4",
    is_attached: bool = False,
) -> Injector:
    world = World.parse(parse_document(WORLD.encode(), name="world.yaml"))
    return Injector(
        context=cast("VehicleContext", context),
        autopilot=autopilot,
        injections=injections,
        scene_poses=ScenePoses(world.scene("wil", "Wv"), world.frame, {"goal": 0.0}),
        is_attached=is_attached,
    )


def names(context: FakeStation) -> list[str]:
    return [message.get_type() for message in context.driver.told]


def test_a_scan_goes_out_at_its_rate_and_only_to_its_vehicle() -> None:
    async def feed() -> tuple[FakeStation, Injector, Injector]:
        real, twin = FakeStation(), FakeStation("twin")
        one = InjectionSetup(thing="obstacle_distance", to=("real",), sensor="lidar")
        told, other = injector(real, one), injector(twin, one)
        for _ in range(50):
            await asyncio.sleep(0.02)
            now_s = asyncio.get_running_loop().time()
            told.perceived("lidar", scan(now_s))
            told.perceived("other", scan(now_s))
            other.perceived("lidar", scan(now_s))
        return real, told, other

    real, told, other = run_virtual(feed())
    assert set(names(real)) == {"OBSTACLE_DISTANCE"}
    assert len(real.driver.told) == 10
    assert min(real.driver.told[0].distances) == 250
    (result,) = told.results
    assert (result.vehicle, result.thing, result.sent, result.stale) == (
        "real",
        "obstacle_distance",
        10,
        0,
    )
    assert other.injections == ()


def test_a_range_sensor_stands_by_until_the_takeoff_and_no_dead_one_in_flight() -> None:
    async def wait() -> list[int]:
        real, run_state = FakeStation(), RunState(time=asyncio.get_running_loop().time)
        setup = InjectionSetup(thing="obstacle_distance", to=("real",), sensor="lidar")
        standing = asyncio.create_task(injector(real, setup).stand_by(run_state))
        sent = []
        for stage in ("identify", "ready", "arm", "takeoff", "goal"):
            run_state.enter(stage)
            await asyncio.sleep(1.05)
            sent.append(len(real.driver.told))
        assert standing.done()
        assert set(names(real)) == {"OBSTACLE_DISTANCE"}
        assert {cm for message in real.driver.told for cm in message.distances} == {65_535}
        return sent

    sent = run_virtual(wait())
    assert sent[0] == 0
    assert 0 < sent[1] < sent[2] == sent[3] == sent[4]


def test_a_range_sensor_that_only_stands_by_does_so_in_flight_too() -> None:
    async def fly() -> FakeStation:
        twin, run_state = FakeStation(), RunState(time=asyncio.get_running_loop().time)
        setup = InjectionSetup(
            thing="obstacle_distance", to=("real",), sensor="lidar", only_stands_by=True
        )
        told = injector(twin, setup)
        standing = asyncio.create_task(told.stand_by(run_state))
        for stage in ("identify", "ready", "arm", "takeoff", "goal"):
            run_state.enter(stage)
            await asyncio.sleep(1.0)
            now_s = asyncio.get_running_loop().time()
            told.perceived("lidar", scan(now_s))
        assert told.results == ()
        standing.cancel()
        return twin

    twin = run_virtual(fly())
    assert len(twin.driver.told) >= 19
    assert {cm for message in twin.driver.told for cm in message.distances} == {65_535}


def test_a_rate_of_the_campaign_wins() -> None:
    async def feed() -> FakeStation:
        real = FakeStation()
        setup = InjectionSetup(thing="distance_sensor", to=("real",), sensor="below", rate_hz=4.0)
        told = injector(real, setup)
        for _ in range(100):
            await asyncio.sleep(0.02)
            now_s = asyncio.get_running_loop().time()
            mount = Pose.of(0.0, 0.0, 0.0, pitch_rad=-math.pi / 2)
            told.perceived(
                "below", RangefinderReading(now_s, now_s, 0, "mixed", 1.5, 0.1, 10.0, mount)
            )
        return real

    real = run_virtual(feed())
    assert len(real.driver.told) == 9
    assert real.driver.told[0].current_distance == 150


def test_a_reading_that_is_too_old_is_counted_and_not_sent() -> None:
    async def feed() -> tuple[FakeStation, Injector]:
        real = FakeStation()
        told = injector(
            real, InjectionSetup(thing="obstacle_distance", to=("real",), sensor="lidar")
        )
        await asyncio.sleep(5.0)
        told.perceived("lidar", scan(4.0))
        return real, told

    real, told = run_virtual(feed())
    assert real.driver.told == []
    assert told.results[0].stale == 1


@pytest.mark.parametrize(
    ("thing", "message"),
    [("vision_position_estimate", "VISION_POSITION_ESTIMATE"), ("odometry", "ODOMETRY")],
)
def test_poses_of_motion_capture_go_out_as_they_are(thing: Any, message: str) -> None:
    async def feed() -> FakeStation:
        real = FakeStation()
        told = injector(real, InjectionSetup(thing=thing, to=("real",)))
        for _ in range(100):
            await asyncio.sleep(0.01)
            told.pose(pose(asyncio.get_running_loop().time(), (0.5, 0.0, 0.0)))
        return real

    real = run_virtual(feed())
    assert set(names(real)) == {message}
    assert len(real.driver.told) == 50
    assert (real.driver.told[0].x, real.driver.told[0].z) == (1.0, -3.0)


def test_a_mixed_pose_goes_out_instead_where_its_sensor_is_named() -> None:
    async def feed() -> FakeStation:
        real = FakeStation()
        setup = InjectionSetup(thing="vision_position_estimate", to=("real",), sensor="mocap")
        told = injector(real, setup)
        told.pose(pose(0.0))
        told.perceived("mocap", replace(pose(0.0), pose=Pose((5.0, 0.0, 0.0))))
        return real

    assert [message.x for message in run_virtual(feed()).driver.told] == [5.0]


def test_ardupilot_gets_no_odometry_without_a_velocity() -> None:
    async def feed() -> FakeStation:
        real = FakeStation()
        setup = InjectionSetup(thing="odometry", to=("real",))
        told = injector(real, setup, autopilot="ardupilot")
        told.pose(pose(0.0))
        return real

    assert run_virtual(feed()).driver.told == []


def test_an_intruder_is_sent_once_a_second_where_it_is() -> None:
    async def feed() -> FakeStation:
        real = FakeStation()
        told = injector(
            real, InjectionSetup(thing="adsb_vehicle", to=("real",), objects=("intruder",))
        )
        task = asyncio.create_task(told.run())
        await asyncio.sleep(4.5)
        task.cancel()
        await asyncio.wait([task])
        return real

    messages = run_virtual(feed()).driver.told
    assert len(messages) == 5
    assert messages[0].callsign == "INTRUDER"
    # 10 m/s to the south, 20 m above an origin at 488 m.
    assert messages[3].heading == 18_000
    assert messages[3].hor_velocity == pytest.approx(1000, abs=2)
    assert messages[3].altitude == pytest.approx(508_000, abs=5)
    moved_deg = (messages[1].lat - messages[3].lat) / 1e7
    assert moved_deg * 111_000 == pytest.approx(20.0, rel=0.01)


def test_an_intruder_flies_at_an_attached_vehicle_wherever_that_stands_on_earth() -> None:
    """It stands 10 km from the world's origin, and points east where the world's start is north."""

    @dataclass
    class Attached(FakeDriver):
        place_deg: tuple[float, float] | None = None

        def place_of(self, world_ned_m: Vec3) -> Geodetic:
            assert self.anchor is not None
            frame = LocalFrame(47.5, 8.6, 300.0)
            return frame.to_geodetic(self.anchor.position_to_local(world_ned_m))

    async def feed() -> FakeStation:
        driver = Attached()
        real = FakeStation(driver=driver)
        setup = InjectionSetup(thing="adsb_vehicle", to=("real",), objects=("intruder",))
        told = injector(real, setup, is_attached=True)
        task = asyncio.create_task(told.run())
        await asyncio.sleep(0.2)
        assert real.driver.told == []  # not before it is known where the vehicle is
        east = Pose.of(0.0, 0.0, 0.0, yaw_rad=math.pi / 2.0)
        real.driver.stands_at(local=east, world=Pose((0.0, 0.0, 0.0)))
        driver.place_deg = 47.5, 8.6
        await asyncio.sleep(2.0)
        task.cancel()
        await asyncio.wait([task])
        return real

    first, *_, last = run_virtual(feed()).driver.told
    ahead = LocalFrame(47.5, 8.6, 300.0).to_ned(first.lat / 1e7, first.lon / 1e7, 320.0)
    assert ahead[0] == pytest.approx(0.0, abs=0.1)
    assert 85.0 < ahead[1] < 100.0
    assert first.altitude == pytest.approx(320_000, abs=20)
    assert last.heading == 27_000  # to the west, towards it
    assert last.lon < first.lon


def test_a_landing_target_is_in_the_autopilots_own_frame() -> None:
    async def feed() -> FakeStation:
        real = FakeStation()
        setup = InjectionSetup(thing="landing_target", to=("real",), objects=("pad",))
        told = injector(real, setup)
        task = asyncio.create_task(told.run())
        await asyncio.sleep(0.2)
        assert real.driver.told == []  # not before it is known where the vehicle is
        real.driver.stands_at(local=Pose((10.0, 0.0, -2.0)), world=Pose((0.0, 0.0, -2.0)))
        await asyncio.sleep(0.5)
        task.cancel()
        await asyncio.wait([task])
        return real

    message = run_virtual(feed()).driver.told[0]
    assert (message.x, message.y, message.z) == pytest.approx((13.0, -1.0, -0.02))
