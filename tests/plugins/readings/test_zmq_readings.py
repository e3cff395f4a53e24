"""Readings that a program publishes: each type as it was sent, and nothing that is spoiled."""

import asyncio
import json
import math
from collections.abc import Iterator
from typing import Any, get_args

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np
import pytest

from tests.plugins.readings.publisher import ALL, LENS, Publisher, message, publishing
from tests.vehicles.readings.thermometer import ThermometerReading
from wil_campaign.campaigns.schema.sensors import sensor_parts
from wil_campaign.campaigns.schema.sources import SourcedPart
from wil_campaign.plugins.readings import reading_message
from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.plugins.readings.reading_message import (
    SampleStamps,
    read_envelope,
    read_header,
    read_reading,
)
from wil_campaign.plugins.readings.zmq_readings import ZmqReadings
from wil_campaign.vehicles.readings import (
    DepthReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    RangefinderReading,
    Reading,
    reading_types,
)
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.sources.camera_source import SourceError, SourceStalledError
from wil_campaign.vehicles.sources.readings.live_readings import OLDEST_S
from wil_campaign.worlds.frames import AT_ORIGIN

WHEN = SampleStamps(10.0, 10.01, "real", AT_ORIGIN, LENS)
SOURCED = sorted(
    get_args(part.model_fields["type"].annotation)[0]
    for part in sensor_parts()
    if issubclass(part, SourcedPart)
)
"""The types that a campaign may take from a program."""


def read(data: bytes) -> Reading:
    header = read_header(data)
    return read_reading(header, read_envelope(header).kind, WHEN)


@pytest.mark.parametrize("kind", SOURCED)
def test_each_type_that_a_program_may_send_is_read_as_it_was_sent(kind: str) -> None:
    assert kind in ALL, "ALL of publisher.py has a message of each type"
    for data in (msgpack.packb(message(kind)), json.dumps(message(kind)).encode()):
        found = read(data)
        assert type(found) is reading_types()[kind]
        assert reading_fault(found) is None
        assert (found.t_s, found.arrived_s, found.source) == (10.0, 10.01, "real")


def test_a_reading_of_numbers_alone_needs_no_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    types = {**reading_types(), "thermometer": ThermometerReading}
    monkeypatch.setattr(reading_message, "reading_types", lambda: types)
    monkeypatch.setitem(ALL, "thermometer", {"temperature_deg_c": -4, "samples": -3})
    for data in (msgpack.packb(message("thermometer")), json.dumps(message("thermometer"))):
        found: Any = read(data if isinstance(data, bytes) else data.encode())
        assert found == ThermometerReading(10.0, 10.01, 0, "real", -4.0, -3)
    for changes in ({"samples": 1.5}, {"samples": None}, {"temperature_deg_c": math.nan}):
        with pytest.raises(BadMessageError, match=next(iter(changes))):
            read(msgpack.packb(message("thermometer", **changes)))


def test_arrays_may_be_bytes() -> None:
    ranges = np.array([1.0, np.inf, 2.5], "<f4")
    scan = read(msgpack.packb(message("lidar", ranges_m=ranges.tobytes())))
    listed = read(msgpack.packb(message("lidar")))
    assert isinstance(scan, LidarScanReading)
    assert isinstance(listed, LidarScanReading)
    assert scan.ranges_m.tolist() == listed.ranges_m.tolist() == [1.0, math.inf, 2.5]
    points = np.arange(30_000, dtype="<f4")
    cloud = read(msgpack.packb(message("lidar_points", points_frd_m=points.tobytes())))
    assert isinstance(cloud, LidarPointsReading)
    assert cloud.points_frd_m.shape == (10_000, 3)
    sound = read(msgpack.packb(message("microphone", samples=b"\x00\x80\xff\x7f")))
    assert isinstance(sound, MicrophoneReading)
    assert sound.samples.tolist() == [-32768, 32767]
    millimetres = np.array([1000, 2000, 3000, 0, 5000, 65535], "<u2")
    others: tuple[dict[str, Any], ...] = ({}, {"depth_mm": millimetres.tobytes()})
    for sent in others:
        image = read(msgpack.packb(message("depth", **sent)))
        assert isinstance(image, DepthReading)
        assert (image.intrinsics, image.rendered, image.camera_pose) == (LENS, False, None)
        last_m = 65.535 if sent else 6.5
        assert image.depth_m == pytest.approx(np.array([[1, 2, 3], [math.inf, 5, last_m]]))
    nothing = read(json.dumps(message("rangefinder", range_m=None)).encode())
    assert isinstance(nothing, RangefinderReading)
    assert math.isinf(nothing.range_m)


@pytest.mark.parametrize(
    ("kind", "changes", "said"),
    [
        ("imu", {"protocol": "wil/reading/2"}, "we speak"),
        ("imu", {"specific_force_frd_m_s2": [0, 0, math.nan]}, "finite"),
        ("imu", {"rates_frd_rad_s": [0, 0]}, "3 finite numbers"),
        ("gps", {"latitude_deg": "47"}, "finite number"),
        ("pose", {"q_wxyz": [0, 0, 0, 0]}, "q_wxyz"),
        ("lidar", {"ranges_m": b"\x00\x00\x00"}, "ranges_m"),
        ("lidar", {"ranges_m": [1.0, math.nan]}, "ranges_m"),
        ("lidar", {"ranges_m": [1.0] * 100_001}, "at most 100000"),
        ("lidar_points", {"points_frd_m": [1.0, 2.0]}, "three for each point"),
        ("depth", {"depth_m": [1.0] * 5}, "5 numbers, not 3x2"),
        ("depth", {"depth_m": [1.0, math.nan] * 3}, "depth_m"),
        ("depth", {"depth_mm": [1, 2, 3, 4, 5, -6]}, "whole numbers"),
        ("depth", {"camera": {"width_px": 2, "height_px": 3}}, "is 2x3, and the sensor .* 3x2"),
        (
            "depth",
            {"camera": {"width_px": 3, "height_px": 2, "fx_px": 3.0}},
            "focal length is 3 px",
        ),
        ("depth", {"camera": None}, "not a map"),
        ("microphone", {"samples": [40_000]}, "whole numbers"),
        ("microphone", {"samples": [0.5]}, "whole numbers"),
        ("rangefinder", {"seq": -1}, "whole number"),
        ("rangefinder", {"t_s": math.inf}, "finite number"),
    ],
)
def test_a_breach_of_the_protocol_is_named_with_its_key(
    kind: str, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(BadMessageError, match=said):
        read(msgpack.packb(message(kind, **changes)))


def test_no_message_is_too_large_or_too_deep() -> None:
    with pytest.raises(BadMessageError, match="more than 4194304"):
        read_header(bytes(5 * 2**20))
    with pytest.raises(BadMessageError):
        read_header(b"{" + b'"a":[' * 100_000)


@pytest.fixture
def publisher() -> Iterator[Publisher]:
    one = Publisher()
    yield one
    one.close()


def source(publisher: Publisher, kind: str = "rangefinder", **more: Any) -> ZmqReadings:
    return ZmqReadings(address=publisher.address, sensor="one", kind_of=kind, side="real", **more)


async def taken_until_it_stalls(live: ZmqReadings) -> None:
    while True:
        await anext(live)


async def test_readings_come_on_the_run_clock_and_a_silence_is_a_stall(
    publisher: Publisher,
) -> None:
    sending = asyncio.create_task(publishing(publisher, "rangefinder"))
    async with source(publisher, open_s=30.0, stall_s=30.0) as live:
        found = [await anext(live) for _ in range(20)]
        now_s = asyncio.get_running_loop().time()
        assert all(one.arrived_s - OLDEST_S <= one.t_s <= one.arrived_s <= now_s for one in found)
        assert [one.t_s for one in found] == sorted({one.t_s for one in found})
        live._stall_s = 0.5
        sending.cancel()
        with pytest.raises(SourceStalledError, match=r"no rangefinder reading for 0\.5 s"):
            await taken_until_it_stalls(live)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"sensor": "other"}, r"of other sensors arrived \(other\)"),
        ({"type": "gps"}, "is a 'gps' in the message, and a rangefinder in the campaign"),
        ({"range_min_m": 20.0}, "range limits are 20"),
        ({"protocol": "x"}, "we speak"),
    ],
)
async def test_readings_that_cannot_be_used_are_named_when_the_source_opens(
    publisher: Publisher, changes: dict[str, Any], said: str
) -> None:
    sending = asyncio.create_task(publishing(publisher, "rangefinder", **changes))
    with pytest.raises(SourceError, match=said):
        async with source(publisher, open_s=4.0):
            pass
    sending.cancel()


async def test_nothing_at_all_names_the_remedy(publisher: Publisher) -> None:
    with pytest.raises(SourceError, match="check that a publisher has bound this address"):
        async with source(publisher, open_s=0.3):
            pass


async def test_missing_readings_are_counted_and_repeated_ones_are_not_used(
    publisher: Publisher,
) -> None:
    live = source(publisher)
    for seq, t_s in ((0, 1.0), (3, 1.1), (3, 1.1), (4, 1.2)):
        data = msgpack.packb(message("rangefinder", seq, t_s))
        try:
            live.receive(data, 50.0 + t_s)
        except BadMessageError as error:
            live.refuse(str(error))
    found = [await anext(live) for _ in range(3)]
    assert (live.counts.missed, live.counts.damaged) == (2, 1)
    assert [one.t_s for one in found] == pytest.approx([51.0, 51.1, 51.2])


@pytest.mark.parametrize("scale", [1000.0, 100.0])
async def test_ranges_in_another_unit_than_their_limit_are_refused(
    publisher: Publisher, scale: float
) -> None:
    """An autonomy saw them as far away, and flew into what is near."""
    live = source(publisher)
    with pytest.raises(BadMessageError, match=r"`range_m` has \d+ m, and `range_max_m` is 12 m"):
        live.receive(msgpack.packb(message("rangefinder", range_m=1.5 * scale)), 50.0)
    live.receive(msgpack.packb(message("rangefinder", 1, 100.1, range_m=12.0)), 50.1)
    live.receive(msgpack.packb(message("rangefinder", 2, 100.2, range_m=None)), 50.2)
    taken = [await anext(live) for _ in range(2)]
    assert [one.range_m for one in taken if isinstance(one, RangefinderReading)] == [12.0, math.inf]
    scan = source(publisher, "lidar")
    with pytest.raises(BadMessageError, match="`ranges_m` has"):
        scan.receive(msgpack.packb(message("lidar", ranges_m=[1.5, None, 2.5 * scale])), 50.0)


@pytest.mark.parametrize("how", ["on one clock", "on two clocks", "milliseconds"])
async def test_two_senders_and_stamps_in_another_unit_are_not_used(
    publisher: Publisher, how: str
) -> None:
    live = source(publisher)
    for k in range(100):
        now_s = 50.0 + 0.02 * k
        scale = 1000.0 if how == "milliseconds" else 1.0
        live.receive(msgpack.packb(message("rangefinder", k, scale * now_s)), now_s)
        if how != "milliseconds":
            sent_s = now_s + 0.01 + (500.0 if how == "on two clocks" else 0.0)
            other = message("rangefinder", 3000 - k, sent_s, range_m=9.0)
            live.receive(msgpack.packb(other), now_s + 0.01)
    assert live.counts.restarts > 90
    assert live.counts.damaged > 90
    assert how == "on one clock" or live.counts.missed == 0, "by the numbers of another"
    assert "there are two senders, or its stamps are not seconds" in live.complaint
    with pytest.raises(SourceStalledError, match="there are two senders"):
        _ = [one async for one in live]
    assert live.counts.delivered < 15


@pytest.mark.parametrize("t_s", [1.4, -8.0])
async def test_a_sender_that_starts_anew_is_followed(publisher: Publisher, t_s: float) -> None:
    live = source(publisher)
    for number, (seq, sent_s) in enumerate(
        ((90, 10.0), (91, 10.1), (0, 9.0 + t_s), (1, 9.1 + t_s))
    ):
        live.receive(msgpack.packb(message("rangefinder", seq, sent_s)), 50.0 + 0.1 * number)
    with pytest.raises(BadMessageError, match="`seq` 0 arrived after 1"):
        live.receive(msgpack.packb(message("rangefinder", 0, 9.0 + t_s)), 50.5)
    assert (live.counts.restarts, live.counts.missed, live.counts.damaged) == (1, 0, 0)
    assert [(await anext(live)).seq for _ in range(4)] == [0, 1, 2, 3]
