"""Readings, and what is found wrong with them."""

import dataclasses
import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    NumbersReading,
    PoseReading,
    RangefinderReading,
    Reading,
    reading_types,
    samples_from_pressure,
    sensor_type_of,
)
from wil_campaign.vehicles.readings.checks import reading_fault, reading_fault_after
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

INTRINSICS = Intrinsics.from_fov(8, 6, 1.2)
CAMERA = CameraReading(
    t_s=1.0,
    arrived_s=1.1,
    seq=3,
    source="real",
    image_bgr=np.zeros((6, 8, 3), np.uint8),
    intrinsics=INTRINSICS,
    depth_m=np.full((6, 8), np.inf, np.float32),
    object_ids=np.zeros((6, 8), np.uint8),
)
DEPTH = DepthReading(1.0, 1.1, 3, "twin", np.full((6, 8), np.inf, np.float32), INTRINSICS)
SCAN = LidarScanReading(
    1.0, 1.1, 3, "twin", np.array([1.0, np.inf, 3.0], np.float32), -0.1, 0.1, 0.1, 12.0
)
POINTS = LidarPointsReading(1.0, 1.1, 3, "twin", np.ones((4, 3), np.float32))
RANGE = RangefinderReading(1.0, 1.1, 3, "real", 2.0, 0.1, 12.0)
GPS = GpsReading(1.0, 1.1, 3, "real", 47.0, 8.0, 500.0, (0.0, 0.0, 0.0), 1.0, 2.0)
POSE = PoseReading(1.0, 1.1, "real", Pose.of(1.0, 2.0, 3.0), (0.0, 0.0, 0.0), seq=3)
IMU = ImuReading(1.0, 1.1, 3, "real", (0.0, 0.0, -9.8), (0.0, 0.0, 0.0))
SOUND = MicrophoneReading(1.0, 1.1, 3, "real", np.zeros(16, np.int16), 16_000, 28.0)
ALL: tuple[Reading, ...] = (CAMERA, DEPTH, SCAN, POINTS, RANGE, GPS, POSE, IMU, SOUND)

NAN, INF = math.nan, math.inf


def test_the_table_names_every_kind_of_reading_once() -> None:
    types = reading_types()
    assert {*types.values(), NumbersReading} == set(get_args(Reading))
    assert [types[sensor_type_of(reading)] for reading in ALL] == [type(r) for r in ALL]


@pytest.mark.parametrize("reading", ALL, ids=sensor_type_of)
def test_readings_are_frozen_slotted_and_timed(reading: Reading) -> None:
    names = {field.name for field in dataclasses.fields(reading)}
    assert {"t_s", "arrived_s", "seq", "source"} <= names
    assert not hasattr(reading, "__dict__")
    with pytest.raises(dataclasses.FrozenInstanceError):
        reading.t_s = 2.0  # type: ignore[misc]  # that is what is tested


@pytest.mark.parametrize("reading", ALL, ids=sensor_type_of)
def test_a_good_reading_has_no_fault(reading: Reading) -> None:
    assert reading_fault(reading) is None
    assert reading_fault_after(reading, None) is None
    assert reading_fault_after(replace(reading, t_s=1.05), reading) is None


@pytest.mark.parametrize("reading", ALL, ids=sensor_type_of)
@pytest.mark.parametrize(("t_s", "arrived_s"), [(NAN, 1.0), (INF, INF), (1.0, NAN), (1.0, 0.5)])
def test_times_that_cannot_be(reading: Reading, t_s: float, arrived_s: float) -> None:
    fault = reading_fault(replace(reading, t_s=t_s, arrived_s=arrived_s))
    assert fault is not None
    assert fault.kind == "time"


@pytest.mark.parametrize("reading", ALL, ids=sensor_type_of)
@pytest.mark.parametrize("t_s", [1.0, 0.9])
def test_time_that_does_not_advance(reading: Reading, t_s: float) -> None:
    fault = reading_fault_after(replace(reading, t_s=t_s), reading)
    assert fault is not None
    assert fault.kind == "backwards"
    assert f"{t_s:.6f}" in fault.detail


BAD: list[tuple[Reading, dict[str, Any], str]] = [
    (CAMERA, {"image_bgr": np.zeros((6, 9, 3), np.uint8)}, "shape"),
    (CAMERA, {"image_bgr": np.zeros((6, 8), np.uint8)}, "shape"),
    (CAMERA, {"image_bgr": np.zeros((6, 8, 3), np.float32)}, "type"),
    (CAMERA, {"depth_m": np.zeros((6, 8), np.float64)}, "type"),
    (CAMERA, {"depth_m": np.full((6, 8), NAN, np.float32)}, "not_finite"),
    (CAMERA, {"object_ids": np.zeros((5, 8), np.uint8)}, "shape"),
    (CAMERA, {"intrinsics": replace(INTRINSICS, fx_px=0.0)}, "intrinsics"),
    (CAMERA, {"intrinsics": replace(INTRINSICS, cx_px=NAN)}, "intrinsics"),
    (CAMERA, {"intrinsics": replace(INTRINSICS, distortion=(0.1,))}, "intrinsics"),
    (DEPTH, {"depth_m": np.full((6, 8), -1.0, np.float32)}, "negative"),
    (DEPTH, {"depth_m": np.full((6, 8), -INF, np.float32)}, "negative"),
    (DEPTH, {"depth_m": np.zeros((8, 6), np.float32)}, "shape"),
    (
        DEPTH,
        {
            "depth_m": np.zeros((0, 0), np.float32),
            "intrinsics": replace(INTRINSICS, width_px=0, height_px=0),
        },
        "intrinsics",
    ),
    (SCAN, {"ranges_m": np.array([1.0, NAN], np.float32)}, "not_finite"),
    (SCAN, {"ranges_m": np.array([1.0, -0.5], np.float32)}, "negative"),
    (SCAN, {"ranges_m": np.zeros(0, np.float32)}, "empty"),
    (SCAN, {"ranges_m": np.zeros((2, 2), np.float32)}, "shape"),
    (SCAN, {"ranges_m": np.zeros(4, np.float64)}, "type"),
    (SCAN, {"object_ids": np.zeros(2, np.uint8)}, "shape"),
    (SCAN, {"step_rad": NAN}, "not_finite"),
    (SCAN, {"step_rad": 0.0}, "out_of_range"),
    (SCAN, {"range_max_m": 0.0}, "out_of_range"),
    (POINTS, {"points_frd_m": np.zeros((0, 3), np.float32)}, "empty"),
    (POINTS, {"points_frd_m": np.full((2, 3), INF, np.float32)}, "not_finite"),
    (POINTS, {"points_frd_m": np.zeros((2, 4), np.float32)}, "shape"),
    (POINTS, {"object_ids": np.zeros(3, np.uint8)}, "shape"),
    (RANGE, {"range_m": NAN}, "not_finite"),
    (RANGE, {"range_m": -1.0}, "negative"),
    (RANGE, {"range_min_m": 13.0}, "out_of_range"),
    (GPS, {"latitude_deg": 91.0}, "out_of_range"),
    (GPS, {"longitude_deg": -181.0}, "out_of_range"),
    (GPS, {"altitude_m": NAN}, "not_finite"),
    (GPS, {"horizontal_accuracy_m": -1.0}, "negative"),
    (POSE, {"pose": Pose((0.0, NAN, 0.0))}, "not_finite"),
    (POSE, {"pose": Pose((0.0, 0.0, 0.0), (0.5, 0.0, 0.0, 0.0))}, "out_of_range"),
    (POSE, {"velocity_ned_m_s": (0.0, INF, 0.0)}, "not_finite"),
    (IMU, {"rates_frd_rad_s": (0.0, NAN, 0.0)}, "not_finite"),
    (SOUND, {"samples": np.zeros(0, np.int16)}, "empty"),
    (SOUND, {"samples": np.zeros(4, np.float32)}, "type"),
    (SOUND, {"sample_rate_hz": 0}, "out_of_range"),
    (SOUND, {"full_scale_pa": NAN}, "out_of_range"),
]


@pytest.mark.parametrize(("reading", "changes", "kind"), BAD)
def test_the_fault_of_a_bad_reading_is_named(
    reading: Reading, changes: dict[str, Any], kind: str
) -> None:
    fault = reading_fault(replace(reading, **changes))
    assert fault is not None
    assert fault.kind == kind
    assert fault.detail


def test_a_range_of_infinity_is_no_fault() -> None:
    assert reading_fault(replace(RANGE, range_m=INF)) is None
    assert reading_fault(replace(SCAN, ranges_m=np.full(4, INF, np.float32))) is None


def test_a_camera_that_changes_its_size_in_flight() -> None:
    other = replace(CAMERA, t_s=2.0, intrinsics=Intrinsics.from_fov(16, 12, 1.2))
    fault = reading_fault_after(other, CAMERA)
    assert fault is not None
    assert (fault.kind, fault.detail) == ("changed", "the image size was 8x6 and is 16x12")
    focal = reading_fault_after(
        replace(CAMERA, t_s=2.0, intrinsics=Intrinsics.from_fov(8, 6, 1.0)), CAMERA
    )
    assert focal is not None
    assert focal.kind == "changed"
    kind = reading_fault_after(IMU, POSE)
    assert kind is not None
    assert kind.kind == "changed"


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=64), st.floats(0.1, 100.0))
def test_sound_is_kept_to_half_a_step(shape: list[float], full_scale_pa: float) -> None:
    pressure = np.array(shape) * full_scale_pa * (32767 / 32768)
    samples = samples_from_pressure(pressure, full_scale_pa)
    back = replace(SOUND, samples=samples, full_scale_pa=full_scale_pa).pressure_pa
    assert back.dtype == np.float32
    assert np.abs(back - pressure).max() <= 0.51 * full_scale_pa / 32768


def test_sound_beyond_full_scale_is_clipped_not_wrapped() -> None:
    samples = samples_from_pressure(np.array([2.0, -2.0]), 1.0)
    assert samples.tolist() == [32767, -32768]
    assert SOUND.duration_s == 0.001


def test_beams_of_a_scan_have_angles() -> None:
    assert SCAN.angles_rad == pytest.approx([-0.1, 0.0, 0.1])
