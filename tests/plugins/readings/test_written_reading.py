"""Readings as messages for programs: what is read back is what was written, of every type."""

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from tests.recipes.samples import beam, cloud, depth, fix, imu, pose, scan
from wil_campaign.plugins.readings.messagepack import MessageHeader
from wil_campaign.plugins.readings.reading_message import (
    SampleStamps,
    read_envelope,
    read_header,
    read_reading,
)
from wil_campaign.plugins.readings.written_reading import written_reading
from wil_campaign.vehicles.readings import DepthReading, MicrophoneReading, Reading, sensor_type_of
from wil_campaign.worlds.frames import Pose

SOUND = MicrophoneReading(1.0, 1.0, 3, "twin", np.arange(-4, 4, dtype=np.int16), 16_000, 20.0)
READINGS: tuple[Any, ...] = (
    beam(2.5),
    beam(math.inf),
    scan([1.0, math.inf, 3.0]),
    cloud([[1, 2, 3], [4, 5, 6]]),
    fix(47.4, 8.5),
    imu(),
    pose(),
    pose(Pose.of(1, 2, 3, yaw_rad=0.5), velocity_ned_m_s=None),
    SOUND,
)


def equal(one: Any, other: Any) -> bool:
    if isinstance(one, Pose):  # a reader normalises attitudes
        return one.position_ned_m == other.position_ned_m and np.allclose(one.q_wxyz, other.q_wxyz)
    return np.array_equal(one, other) if isinstance(one, np.ndarray) else bool(one == other)


@pytest.mark.parametrize("reading", READINGS, ids=sensor_type_of)
def test_a_source_reads_back_what_was_written(reading: Reading) -> None:
    written = replace(reading, sensor="mine", t_s=12.5, seq=7)
    header = read_header(written_reading(written))
    envelope = read_envelope(header)
    assert (envelope.sensor, envelope.seq, envelope.sent_s) == ("mine", 7, 12.5)
    assert envelope.kind == sensor_type_of(reading)
    assert header.number("arrived_s") == reading.arrived_s
    mount = getattr(reading, "mount", Pose((0, 0, 0)))
    when = SampleStamps(t_s=12.5, arrived_s=reading.arrived_s, side="twin", mount=mount)
    back = read_reading(header, envelope.kind, when)
    for field in fields(reading):
        if field.name not in {"seq", "sensor", "object_ids"}:
            assert equal(getattr(back, field.name), getattr(written, field.name)), field.name


def test_a_depth_image_has_its_camera() -> None:
    reading = depth(np.array([[1.0, math.inf], [2.0, 3.0]]))
    header = MessageHeader.unpack(written_reading(reading), most_bytes=10_000)
    assert header.text("type") == "depth"
    camera = header.header("camera")
    size = camera.whole("height_px"), camera.whole("width_px")
    values = header.array("depth_m", np.dtype("<f4"), most=100).reshape(size)
    assert np.array_equal(values, reading.depth_m)
    assert camera.number("fx_px") == reading.intrinsics.fx_px
    mount = Pose((0.1, 0.0, -0.2))
    when = SampleStamps(1.0, 1.0, "twin", mount, reading.intrinsics)
    back = read_reading(header, "depth", when)
    assert isinstance(back, DepthReading)
    assert back.mount == mount
    assert np.array_equal(back.depth_m, reading.depth_m)
