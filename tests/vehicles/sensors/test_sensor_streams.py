"""Sensors that run by themselves or are asked: their times, numbers and truth."""

import asyncio
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.navigation.imu import ImuSensor
from wil_campaign.vehicles.cameras.rendered_cameras import RenderedImage
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import DepthReading, ImuReading, PoseReading, Reading
from wil_campaign.vehicles.sensors.depth import DepthSensor
from wil_campaign.vehicles.sensors.lens import LensImage
from wil_campaign.vehicles.sensors.sensor_streams import (
    TRUTH_DELAY_S,
    OnDemandSensor,
    PoseStream,
    RenderedDepth,
    SensorStream,
)
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.vehicles.sensors.truth_history import TruthHistory, truth_of
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.frames import Pose, quat_from_euler

CAMERA = Intrinsics.from_fov(32, 24, 1.2)


def sample(t_s: float, north_m: float = 0.0) -> TruthSample:
    return TruthSample(
        t_s,
        Pose.of(north_m, 0.0, 1.0),
        (1.0, 0.0, 0.0),
        on_ground=False,
        motors_stopped=False,
        rates_frd_rad_s=(north_m, 0.0, 0.0),
        specific_force_frd_m_s2=(0.0, 0.0, -9.0 - north_m),
        thrusts_n=(1.0, 1.0, 1.0, 1.0),
    )


def track(hz: float, until_s: float) -> TruthHistory:
    """A vehicle that flies north at 1 m/s."""
    found = TruthHistory()
    for k in range(int(until_s * hz) + 1):
        found.add(sample(k / hz, k / hz))
    return found


@given(st.floats(0.0, 0.99))
def test_truth_in_between_is_interpolated(t_s: float) -> None:
    truth = track(10.0, 1.0).at(t_s)
    assert truth is not None
    assert truth.pose.position_ned_m[0] == pytest.approx(t_s, abs=1e-9)
    assert truth.rates_frd_rad_s[0] == pytest.approx(t_s, abs=1e-9)
    assert truth.specific_force_frd_m_s2[2] == pytest.approx(-9.0 - t_s, abs=1e-9)
    assert truth.motor_speeds_rad_s == pytest.approx(truth_of(sample(0.0)).motor_speeds_rad_s)


def test_nothing_is_known_before_the_first_sample_nor_after_a_silence() -> None:
    found = TruthHistory()
    assert found.at(1.0) is None
    found.add(sample(1.0))
    found.add(sample(0.5))
    assert found.at(0.9) is None
    assert found.at(1.0) == truth_of(sample(1.0))
    predicted = found.at(1.1)
    assert predicted is not None
    assert predicted.pose.position_ned_m == pytest.approx((0.1, 0.0, -1.0))  # at 1 m/s
    assert found.at(1.3) is None
    found.add(sample(2.0))
    assert found.at(1.5) is None


def test_a_track_forgets() -> None:
    found = TruthHistory()
    for k in range(5000):
        found.add(sample(k / 250.0))
    assert found.at(5.0) is None
    assert found.at(19.5) is not None


class Taken:
    def __init__(self) -> None:
        self.readings: list[tuple[float, Reading]] = []

    def __call__(self, reading: Reading) -> None:
        self.readings.append((asyncio.get_running_loop().time(), reading))


async def for_a_while(run: Callable[[Taken], object], seconds: float) -> Taken:
    taken = Taken()
    task = asyncio.ensure_future(run(taken))  # type: ignore[call-overload]  # a coroutine
    await asyncio.sleep(seconds)
    task.cancel()
    await asyncio.wait([task])
    return taken


def test_a_sensor_samples_at_its_ticks_and_delivers_when_it_says() -> None:
    timing = Timing(rate_hz=50.0, latency_s=0.03)
    stream = SensorStream(
        sensor=ImuSensor(source="real", timing=timing),
        track=track(250.0, 2.0),
        rate_hz=50.0,
        rng=np.random.default_rng(0),
    )
    taken = run_virtual(for_a_while(stream.run, 1.0))
    times = [reading.t_s for _, reading in taken.readings]
    assert times == pytest.approx([k / 50.0 for k in range(49)])
    assert [reading.seq for _, reading in taken.readings] == list(range(49))
    for at_s, reading in taken.readings:
        assert at_s == reading.arrived_s == pytest.approx(reading.t_s + 0.03)
        assert isinstance(reading, ImuReading)
        assert reading.rates_frd_rad_s[0] == pytest.approx(reading.t_s)


def test_a_reading_without_latency_still_waits_for_its_truth() -> None:
    stream = SensorStream(
        sensor=ImuSensor(source="real", timing=Timing(rate_hz=200.0)),
        track=track(250.0, 2.0),
        rate_hz=200.0,
        rng=np.random.default_rng(0),
    )
    taken = run_virtual(for_a_while(stream.run, 0.5))
    late = {round(reading.arrived_s - reading.t_s, 9) for _, reading in taken.readings}
    assert late == {TRUTH_DELAY_S}


def test_samples_without_truth_are_left_out_with_their_numbers() -> None:
    holed = TruthHistory()
    for k in [*range(50), *range(125, 250)]:  # 0.3 s of silence
        holed.add(sample(k / 250.0))
    stream = SensorStream(
        sensor=ImuSensor(source="real"),
        track=holed,
        rate_hz=50.0,
        rng=np.random.default_rng(0),
    )
    taken = run_virtual(for_a_while(stream.run, 0.9))
    numbers = [reading.seq for _, reading in taken.readings]
    assert set(range(45)) - set(numbers) == set(range(10, 25))
    assert stream.left_out == 15


def test_motion_capture_is_numbered_and_thinned() -> None:
    async def capture() -> Taken:
        heard: list[Callable[[PoseReading], None]] = []
        stream = PoseStream(listen=heard.append, rate_hz=25.0)
        taken = Taken()
        task = asyncio.ensure_future(stream.run(taken))
        await asyncio.sleep(0)
        for k in range(100):
            heard[0](PoseReading(k / 100.0, k / 100.0 + 0.01, "real", Pose((0, 0, 0))))
        await asyncio.sleep(1.0)
        task.cancel()
        await asyncio.wait([task])
        return taken

    readings = [reading for _, reading in run_virtual(capture()).readings]
    assert [reading.t_s for reading in readings] == pytest.approx([k / 25.0 for k in range(25)])
    assert [reading.seq for reading in readings] == list(range(25))


class Ramp:
    """A source whose distance is the camera's height, and whose ids are one."""

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> RenderedImage:
        assert want_depth
        assert want_ids
        size = (intrinsics.height_px, intrinsics.width_px)
        depth = np.full(size, -camera_pose.position_ned_m[2], np.float32)
        return LensImage(np.zeros((*size, 3), np.uint8), depth, np.ones(size, np.uint8))


def rendered_depth(mount: CameraMount) -> RenderedDepth:
    return RenderedDepth(
        source=Ramp(),
        intrinsics=CAMERA,
        mount=mount,
        side="twin",
        sensor=DepthSensor(),
        timing=Timing(10.0, latency_s=0.05),
    )


def test_a_depth_camera_sees_from_where_it_sits() -> None:
    sensor = rendered_depth(CameraMount(Pose.of(0.0, 0.0, 0.5)))
    reading = sensor.sample(truth_of(sample(0.0)), 3.0, np.random.default_rng(0))
    assert np.all(reading.depth_m == np.float32(1.5))
    assert reading.t_s == 3.0
    assert reading.arrived_s == pytest.approx(3.05)
    assert reading.camera_pose is not None
    assert reading.camera_pose.position_ned_m[2] == pytest.approx(-1.5)
    assert reading.mount == Pose.of(0.0, 0.0, 0.5)


def test_a_depth_camera_on_a_gimbal_turns_in_a_tilted_body() -> None:
    body = Pose((1.0, 2.0, -3.0), quat_from_euler(0.2, 0.3, 0.4))
    mount = CameraMount(Pose.of(0.1, 0.0, 0.0), stabilized=True)
    reading = rendered_depth(mount).sample(Truth(body), 3.0, np.random.default_rng(0))
    assert reading.camera_pose is not None
    seen_from = body.compose(reading.mount)
    assert seen_from.position_ned_m == pytest.approx(reading.camera_pose.position_ned_m)
    assert seen_from.q_wxyz == pytest.approx(reading.camera_pose.q_wxyz)


def test_an_asked_sensor_answers_at_once_and_counts() -> None:
    async def ask() -> list[Reading]:
        asked = OnDemandSensor(sensor=rendered_depth(CameraMount()), rng=np.random.default_rng(0))
        await asyncio.sleep(2.0)
        return [await asked.ask(Pose.of(0.0, 0.0, float(k)), 1.9) for k in range(1, 4)]

    readings = run_virtual(ask())
    assert [reading.seq for reading in readings] == [0, 1, 2]
    for height_m, reading in enumerate(readings, 1):
        assert isinstance(reading, DepthReading)
        assert (reading.t_s, reading.arrived_s) == (1.9, 2.0)
        assert np.all(reading.depth_m == np.float32(height_m))
        assert math.isfinite(float(reading.depth_m.max()))
