"""Pictures to subscribers, and to loopback devices."""

import asyncio
from pathlib import Path

import numpy as np
import pytest
import zmq

from tests.recipes.samples import imu
from wil_campaign.plugins.outlets.image_delivery import DeliveryError, ImageDelivery
from wil_campaign.plugins.outlets.v4l2 import v4l2_delivery
from wil_campaign.plugins.outlets.zmq_images import ZmqDelivery, published_parts
from wil_campaign.plugins.readings.messagepack import MessageHeader
from wil_campaign.plugins.simulator.image_parts import (
    decode_depth_part,
    decode_ids_part,
    decode_image_part,
)
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

CAMERA = Intrinsics.from_fov(16, 12, 1.2)
IMAGE = np.random.default_rng(2).integers(0, 256, (12, 16, 3), np.uint8)
DEPTH = np.full((12, 16), 3.5, np.float32)
IDS = np.ones((12, 16), np.uint8)
READING = CameraReading(
    12.5, 12.6, 7, "mixed", IMAGE, CAMERA, DEPTH, IDS, Pose.of(1.0, 2.0, 3.0), rendered=True
)


async def test_a_subscriber_gets_the_picture_with_its_times() -> None:
    context = zmq.Context()
    socket = context.socket(zmq.SUB)
    socket.subscribe(b"mixed")
    try:
        async with ZmqDelivery(address="tcp://127.0.0.1:*") as delivery:
            assert isinstance(delivery, ImageDelivery)
            socket.connect(delivery.endpoint)
            for _ in range(200):
                delivery.deliver(READING)
                if await asyncio.to_thread(socket.poll, 20):
                    break
            parts = socket.recv_multipart()
    finally:
        context.destroy(linger=0)
    header = MessageHeader.unpack(parts[1])
    assert parts[0] == b"mixed"
    assert (header.whole("seq"), header.number("t_s")) == (7, 12.5)
    assert header.number("arrived_s") == 12.6
    assert (header.text("source"), header.flag("rendered", default=False)) == ("mixed", True)
    assert header.numbers("position_ned_m", 3) == (1.0, 2.0, -3.0)
    assert header.header("camera").whole("width_px") == 16
    assert [part.text("name") for part in header.headers("parts")] == ["image", "depth", "ids"]
    assert np.array_equal(decode_image_part(parts[2], "bgr8", (16, 12)), IMAGE)
    assert np.array_equal(decode_depth_part(parts[3], "f32", (16, 12)), DEPTH)
    assert np.array_equal(decode_ids_part(parts[4], "u8", (16, 12)), IDS)


async def test_a_subscriber_gets_every_reading_of_a_fast_sensor() -> None:
    context = zmq.Context()
    socket = context.socket(zmq.SUB)
    socket.subscribe(b"fast")
    got: list[int] = []
    try:
        async with ZmqDelivery(address="tcp://127.0.0.1:*", topic="fast", depth=128) as delivery:
            socket.connect(delivery.endpoint)
            for _ in range(200):
                delivery.deliver(imu(seq=0))
                if await asyncio.to_thread(socket.poll, 20):
                    break
            for seq in range(1, 101):
                delivery.deliver(imu(seq=seq))
            for _ in range(300):
                if 100 in got or not await asyncio.to_thread(socket.poll, 5000):
                    break
                topic, header = socket.recv_multipart()
                assert topic == b"fast"
                got.append(MessageHeader.unpack(header).whole("seq"))
    finally:
        context.destroy(linger=0)
    assert [one for one in got if one] == list(range(1, 101))


def test_a_live_picture_has_no_pose_and_may_be_compressed() -> None:
    live = CameraReading(1.0, 1.1, 0, "real", IMAGE, CAMERA, rendered=False)
    topic, header, image = published_parts(live, topic="real", encoding="png")
    assert topic == b"real"
    assert "position_ned_m" not in MessageHeader.unpack(header)
    assert np.array_equal(decode_image_part(image, "png", (16, 12)), IMAGE)


async def test_an_address_that_cannot_be_bound_and_a_wrong_encoding_are_refused() -> None:
    for address in ("tcp://256.0.0.1:1", "here"):
        with pytest.raises(DeliveryError, match="cannot bind"):
            async with ZmqDelivery(address=address):
                pass
    with pytest.raises(DeliveryError, match="encoding 'gif'"):
        ZmqDelivery(address="tcp://127.0.0.1:*", encoding="gif")


@pytest.mark.parametrize(
    ("device", "words"),
    [("/dev/video98", "No such file.*modprobe v4l2loopback"), ("{folder}/f", "is not a device")],
)
async def test_without_a_loopback_device_it_says_how_to_get_one(
    device: str, words: str, tmp_path: Path
) -> None:
    (tmp_path / "f").touch()
    path = Path(device.format(folder=tmp_path))
    with pytest.raises(DeliveryError, match=words):
        async with v4l2_delivery(device=path, width_px=16, height_px=12, rate_hz=10.0):
            pass


async def test_a_device_that_is_no_video_device_says_so() -> None:
    with pytest.raises(DeliveryError, match=r"dev/null: cannot open for writing.*modprobe"):
        async with v4l2_delivery(device=Path("/dev/null"), width_px=16, height_px=12, rate_hz=10.0):
            pass
