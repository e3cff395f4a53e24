"""A live source: what is wrong is counted and never handed on; a silence is reported."""

import asyncio
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    RangefinderReading,
)
from wil_campaign.vehicles.readings.checks import reading_rest_fault
from wil_campaign.vehicles.sources.camera_source import SourceStalledError
from wil_campaign.vehicles.sources.readings.frozen_readings import FrozenReadings
from wil_campaign.vehicles.sources.readings.live_readings import LiveReadings
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, quat_from_euler
from wil_campaign.worlds.geodesy import LocalFrame

ZURICH = LocalFrame(47.3977, 8.5456, 488.0)


def imu(t_s: float, arrived_s: float | None = None, down: float = -9.8) -> ImuReading:
    late_s = t_s + 0.01 if arrived_s is None else arrived_s
    return ImuReading(t_s, late_s, 0, "real", (0.0, 0.0, down), (0.0, 0.0, 0.0))


def source() -> LiveReadings:
    return LiveReadings(name="real imu from mavlink", what="RAW_IMU", stall_s=1.0, remedy="plug in")


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (imu(5.0, 4.0), "1 s after its arrival"),
        (imu(5.0, 7.0), "2 s before its arrival"),
        (imu(1.0), "does not advance"),
        (imu(2.0, down=math.nan), "nan"),
    ],
)
def test_a_spoiled_reading_is_never_delivered(bad: ImuReading, said: str) -> None:
    async def taken() -> tuple[list[int], LiveReadings]:
        live = source()
        live.offer(imu(1.0))
        live.offer(bad)
        live.offer(imu(8.0))
        found = [(await anext(live)).seq for _ in range(2)]
        return found, live

    found, live = run_virtual(taken())
    assert found == [0, 2]
    assert (live.counts.delivered, live.counts.damaged) == (2, 1)
    assert said in live.complaint


def test_a_sample_time_after_the_arrival_becomes_the_arrival() -> None:
    async def taken() -> list[float]:
        live = source()
        live.offer(imu(1.0, arrived_s=0.97))
        live.offer(imu(1.02, arrived_s=1.0))
        live.offer(imu(1.03, arrived_s=1.0))
        live.offer(imu(1.04))
        return [(await anext(live)).t_s for _ in range(3)]

    assert run_virtual(taken()) == [0.97, 1.0, 1.04]


def test_a_source_that_sends_only_useless_readings_has_stalled() -> None:
    async def stalls(live: LiveReadings) -> str:
        async def feed() -> None:
            for _ in range(300):
                await asyncio.sleep(0.01)
                live.offer(imu(asyncio.get_running_loop().time(), down=math.nan))

        live.offer(imu(asyncio.get_running_loop().time()))
        await anext(live)
        async with asyncio.TaskGroup() as group:
            feeding = group.create_task(feed())
            with pytest.raises(SourceStalledError) as caught:
                await anext(live)
            feeding.cancel()
        assert asyncio.get_running_loop().time() == pytest.approx(1.0, abs=0.05)
        return str(caught.value)

    said = run_virtual(stalls(source()))
    assert "no RAW_IMU for 1 s after 1 readings" in said
    assert "nan" in said


def test_a_stall_is_reported_again_until_something_comes() -> None:
    async def stalls(live: LiveReadings) -> float:
        for _ in range(3):
            with pytest.raises(SourceStalledError):
                await anext(live)
        return asyncio.get_running_loop().time()

    assert run_virtual(stalls(source())) == pytest.approx(3.0)


def test_the_oldest_reading_is_dropped_when_none_is_taken() -> None:
    async def taken(live: LiveReadings) -> int:
        for k in range(100):
            live.offer(imu(1.0 + 0.001 * k))
        return (await anext(live)).seq

    live = source()
    assert run_virtual(taken(live)) == 36
    assert live.counts.dropped == 36


def test_nothing_at_all_names_the_remedy() -> None:
    assert source().missing_reading_text(5.0).endswith("arrived within 5 s: plug in")


def at(north_m: float, up_m: float = 1.0) -> Pose:
    return Pose((north_m, 0.0, -up_m))


def gps(t_s: float, north_m: float = 0.0) -> GpsReading:
    place = ZURICH.to_geodetic((north_m, 0.0, 0.0))
    return GpsReading(
        t_s, t_s, 0, "real", place.latitude_deg, place.longitude_deg, place.altitude_m,
        (0.0, 0.0, 0.0), 1.0, 1.0,
    )  # fmt: skip


def test_readings_that_stay_while_the_vehicle_moves_are_frozen() -> None:
    frozen = FrozenReadings()
    said = [frozen.receive(gps(0.1 * k), at(0.1 * k)) for k in range(12)]
    assert said[:9] == [None] * 9
    assert "the sensor is frozen" in str(said[9])
    assert frozen.receive(gps(2.0, north_m=1.0), at(1.2)) is None


def test_readings_of_a_vehicle_that_hovers_may_stay() -> None:
    frozen = FrozenReadings()
    assert all(frozen.receive(gps(0.1 * k), at(0.02 * (k % 2))) is None for k in range(50))


def test_a_floor_is_equally_far_and_a_wall_is_not() -> None:
    down = RangefinderReading(
        0.0, 0.0, 0, "real", 1.0, 0.1, 12.0, Pose.of(0.0, 0.0, 0.0, pitch_rad=-math.pi / 2.0)
    )
    over, into = FrozenReadings(), FrozenReadings()
    ahead = replace(down, mount=Pose((0.0, 0.0, 0.0)))
    assert all(over.receive(replace(down, t_s=0.1 * k), at(0.1 * k)) is None for k in range(50))
    assert any(into.receive(replace(ahead, t_s=0.1 * k), at(0.1 * k)) for k in range(50))
    climbing = FrozenReadings()
    assert any(climbing.receive(replace(down, t_s=0.1 * k), at(0.0, 0.1 * k)) for k in range(50))


def test_walls_are_equally_far_from_any_height() -> None:
    scan = LidarScanReading(0.0, 0.0, 0, "real", np.full(8, 2.0, np.float32), -3.0, 0.75, 0.1, 12.0)
    climbing, going = FrozenReadings(), FrozenReadings()
    assert not any(
        climbing.receive(replace(scan, t_s=0.1 * k), at(0.0, 0.1 * k)) for k in range(50)
    )
    assert any(going.receive(replace(scan, t_s=0.1 * k), at(0.1 * k)) for k in range(50))


def test_at_rest_a_wrong_unit_or_axis_shows() -> None:
    here = at(0.0, 0.0)

    def fault_text(reading: Any, pose: Pose = here) -> str:
        return reading_rest_fault(reading, pose=pose, frame=ZURICH) or ""

    assert fault_text(imu(0.0)) == ""
    for down in (-1.0, -980.0, -32.2):
        assert "unit is wrong" in fault_text(imu(0.0, down=down))
    assert "not forward, right, down" in fault_text(imu(0.0, down=9.8))
    turning = replace(imu(0.0), rates_frd_rad_s=(0.0, 0.0, 2.0))
    assert "rate at rest is" in fault_text(turning)
    assert fault_text(gps(0.0)) == ""
    assert "latitude, longitude" in fault_text(replace(gps(0.0), latitude_deg=4.73977))
    assert "m above or" in fault_text(replace(gps(0.0), altitude_m=488_000.0))
    pose = PoseReading(0.0, 0.0, "real", here)
    assert fault_text(pose) == ""
    assert "unit or frame" in fault_text(replace(pose, pose=Pose((1000.0, 0.0, 0.0))))
    turned = Pose((0.0, 0.0, 0.0), quat_from_euler(math.pi, 0.0, 0.0))
    assert "axes are wrong" in fault_text(replace(pose, pose=turned))


def test_a_microphone_that_says_the_same_block_is_frozen_and_silence_is_not() -> None:
    for value, is_frozen in ((0, False), (7, True)):
        watch, blocks = FrozenReadings(), np.full(64, value, np.int16)
        said = [
            watch.receive(
                MicrophoneReading(0.1 * k, 0.1 * k, k, "real", blocks, 16_000, 1.0), at(0.0)
            )
            for k in range(20)
        ]
        assert any(said) is is_frozen


def image(t_s: float, picture: Any) -> CameraReading:
    lens = Intrinsics.from_fov(16, 12, 1.2)
    return CameraReading(t_s, t_s, 0, "real", picture.copy(), lens, rendered=False)


def test_images_that_stay_while_the_vehicle_moves_or_turns_are_frozen() -> None:
    picture = np.random.default_rng(1).integers(0, 255, (12, 16, 3)).astype(np.uint8)
    going, turning, hovering = FrozenReadings(), FrozenReadings(), FrozenReadings()
    said = [going.receive(image(0.1 * k, picture), at(0.06 * k)) for k in range(12)]
    assert said[:9] == [None] * 9
    assert "moved 0.54 m and turned 0 deg meanwhile: the sensor is frozen" in str(said[9])
    for k in range(12):
        turned = Pose.of(0.0, 0.0, -1.0, yaw_rad=math.radians(3.0 * k))
        fault = turning.receive(image(0.1 * k, picture), turned)
        assert (fault is not None) is (k >= 9)
        assert hovering.receive(image(0.1 * k, picture), at(0.02 * (k % 2))) is None


def seen(t_s: float, depth_m: Any) -> DepthReading:
    lens = Intrinsics.from_fov(16, 12, 1.2)
    image = np.full((12, 16), depth_m, np.float32)
    return DepthReading(t_s, t_s, 0, "real", image, lens, rendered=False)


def test_depth_that_stays_while_the_vehicle_moves_or_turns_is_frozen() -> None:
    going, turning, blind = FrozenReadings(), FrozenReadings(), FrozenReadings()
    for k in range(12):
        turned = Pose.of(0.0, 0.0, -1.0, yaw_rad=math.radians(3.0 * k))
        assert (going.receive(seen(0.1 * k, 2.0), at(0.06 * k)) is not None) is (k >= 9)
        assert (turning.receive(seen(0.1 * k, 2.0), turned) is not None) is (k >= 9)
        assert blind.receive(seen(0.1 * k, math.inf), at(0.3 * k)) is None, "nothing came back"


def test_at_rest_depth_in_millimetres_or_in_a_thousandth_shows() -> None:
    def fault(depth_m: float) -> str:
        return reading_rest_fault(seen(0.0, depth_m), pose=at(0.0, 0.0), frame=ZURICH) or ""

    assert [fault(depth_m) for depth_m in (0.2, 60.0, math.inf)] == [""] * 3
    assert "above 1500 m: its unit is wrong" in fault(1500.0)
    assert "below 0.0015 m: its unit is wrong" in fault(0.0015)


def test_a_camera_with_noise_or_that_sends_each_image_twice_is_not_frozen() -> None:
    rng, noisy, twice = np.random.default_rng(1), FrozenReadings(), FrozenReadings()
    pictures = [rng.normal(110.0, 2.0, (12, 16, 3)).astype(np.uint8) for _ in range(30)]
    for k, picture in enumerate(pictures):
        assert noisy.receive(image(0.1 * k, picture), at(0.3 * k)) is None
        assert twice.receive(image(0.1 * k, pictures[k // 2]), at(0.3 * k)) is None
