"""Sensor models against truth, statistics of their noise, and their repeatability."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicles.sensors.sensor_rigs import rng
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.sensors.depth import DepthNoise, DepthSensor
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import motor_speeds
from wil_campaign.worlds.camera import Intrinsics


@given(
    rate_hz=st.floats(0.1, 1000.0),
    start_s=st.floats(0.0, 100.0),
    after_s=st.floats(0.0, 200.0),
    span_s=st.floats(0.0, 1.0),
)
def test_ticks_are_complete_and_never_twice(
    rate_hz: float, start_s: float, after_s: float, span_s: float
) -> None:
    timing = Timing(rate_hz, start_s=start_s)
    first = timing.index_after(after_s)
    assert timing.time_of(first) > after_s or first == 0
    assert first == 0 or timing.time_of(first - 1) <= after_s
    middle, end = after_s + span_s / 3.0, after_s + span_s
    parts = [*timing.between(after_s, middle), *timing.between(middle, end)]
    assert parts == [*timing.between(after_s, end)]


@pytest.mark.parametrize("wrong", [{"rate_hz": 0.0}, {"rate_hz": math.nan}, {"latency_s": -1.0}])
def test_a_timing_that_cannot_be(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"rate|latency"):
        Timing(**{"rate_hz": 10.0, **wrong})


def test_nothing_arrives_before_it_was_sampled() -> None:
    timing, generator = Timing(10.0, latency_s=0.001, jitter_s=0.01), rng()
    late = [timing.arrival_s(1.0, generator) - 1.0 for _ in range(500)]
    assert min(late) == 0.0
    assert max(late) > 0.02


def picture(depth_m: float, *, width: int = 160, height: int = 120) -> CameraReading:
    return CameraReading(
        t_s=1.0,
        arrived_s=1.05,
        seq=4,
        source="twin",
        image_bgr=np.zeros((height, width, 3), np.uint8),
        intrinsics=Intrinsics.from_fov(width, height, 1.2),
        depth_m=np.full((height, width), depth_m, np.float32),
    )


def test_stereo_depth_errs_with_the_square_of_distance() -> None:
    noise, sensor, generator = DepthNoise(), DepthSensor(noise=DepthNoise()), rng()
    for distance_m in (1.0, 2.0, 4.0):
        source = picture(distance_m)
        seen = sensor.sample(source, generator)
        sigma = distance_m**2 * noise.subpixel_px / (source.intrinsics.fx_px * noise.baseline_m)
        assert seen.depth_m.std() == pytest.approx(sigma, rel=0.05)
        assert seen.depth_m.dtype == np.float32
        assert (seen.t_s, seen.arrived_s, seen.seq) == (1.0, 1.05, 4)
    assert np.isinf(sensor.sample(picture(11.0), generator).depth_m).all()
    assert np.isinf(sensor.sample(picture(math.inf), generator).depth_m).all()
    a, b = sensor.sample(picture(2.0), generator), sensor.sample(picture(2.0), generator)
    assert not np.array_equal(a.depth_m, b.depth_m)


def test_depth_without_noise_is_the_images_own() -> None:
    source = picture(3.0)
    assert DepthSensor().sample(source, rng()).depth_m is source.depth_m
    with pytest.raises(ValueError, match="no depth_m"):
        DepthSensor().sample(replace(source, depth_m=None), rng())


def test_rotor_speed_from_thrust() -> None:
    assert motor_speeds((0.5 * 9.80665 / 4, 0.0, -1.0)) == pytest.approx((469.1, 0.0, 0.0), abs=0.2)
