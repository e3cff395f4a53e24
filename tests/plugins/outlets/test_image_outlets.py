"""Pictures go where the campaign says, and a ground station finds them."""

import asyncio
import socket
from typing import Any, cast

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.plugins.outlets.camera_component import CameraComponent, VideoStream
from wil_campaign.plugins.outlets.ground_station import GroundStation
from wil_campaign.plugins.outlets.image_delivery import DeliveryCounts, ImageDelivery
from wil_campaign.plugins.outlets.image_outlets import OpenOutlet, RunOutlets, image_delivery
from wil_campaign.plugins.outlets.outlet_setups import ImageOutlet
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.readings import CameraReading, Source
from wil_campaign.worlds.camera import CameraMount, Intrinsics

SMALL = Intrinsics.from_fov(16, 12, 1.2)
CAMERA = CameraSetup(name="camera", rate_hz=10.0, intrinsics=SMALL, mount=CameraMount())


class Kept:
    """A delivery that keeps what it gets."""

    trouble = ""

    def __init__(self, name: str) -> None:
        self.name = name
        self.got: list[CameraReading] = []

    @property
    def counts(self) -> DeliveryCounts:
        return DeliveryCounts(len(self.got), len(self.got))

    def deliver(self, reading: CameraReading) -> None:
        self.got.append(reading)


def reading(source: Source, sensor: str = "camera") -> CameraReading:
    image_bgr = np.zeros((12, 16, 3), np.uint8)
    return CameraReading(1.0, 1.0, 0, source, image_bgr, SMALL, sensor=sensor)


def test_each_way_out_gets_its_own_images() -> None:
    mixed, twins, raw = Kept("mixed"), Kept("twins"), Kept("raw")
    outlets = RunOutlets(
        [
            OpenOutlet(cast("ImageDelivery", mixed), "camera", "real", perceived=True),
            OpenOutlet(cast("ImageDelivery", twins), "camera", "twin", perceived=True),
            OpenOutlet(cast("ImageDelivery", raw), "camera", "real", perceived=False),
        ]
    )
    outlets.perceived(reading("mixed"), ("real", "twin"))
    outlets.perceived(reading("mixed", "other"), ("real",))
    outlets.perceived(reading("mixed"), ("twin",))
    outlets.untouched(reading("real"))
    outlets.untouched(reading("twin"))
    assert [len(one.got) for one in (mixed, twins, raw)] == [1, 2, 1]
    assert raw.got[0].source == "real"
    assert [result.offered for result in outlets.result.outlets] == [1, 2, 1]


def test_deliveries_are_made_for_the_size_of_the_camera() -> None:
    kinds = {
        "rtp": image_delivery(
            ImageOutlet(kind="rtp", address="127.0.0.1:5600", sensor="camera"),
            CAMERA,
            sdp_path=None,
        ).name,
        "zmq": image_delivery(
            ImageOutlet(kind="zmq", address="tcp://127.0.0.1:5601", sensor="camera"),
            CAMERA,
            sdp_path=None,
        ).name,
        "v4l2": image_delivery(
            ImageOutlet(kind="v4l2", address="/dev/video10", sensor="camera"),
            CAMERA,
            sdp_path=None,
        ).name,
    }
    assert kinds == {
        "rtp": "rtp://127.0.0.1:5600",
        "zmq": "zmq+tcp://127.0.0.1:5601",
        "v4l2": "/dev/video10",
    }


class Screen:
    """A ground station's socket."""

    def __init__(self, port: socket.socket) -> None:
        self._port = port
        self._codec = MavlinkCodec(system_id=255, component_id=190)
        self._waiting: list[Any] = []
        self.peer: Any = None

    def received(self, name: str) -> Any:
        """Return the next message of a name."""
        while True:
            while self._waiting:
                message = self._waiting.pop(0)
                if message.get_type() == name:
                    return message
            data, self.peer = self._port.recvfrom(2048)
            self._waiting += self._codec.parse(data)

    def ask(self, message: Any) -> None:
        self._port.sendto(self._codec.pack(message), self.peer)


async def test_a_ground_station_finds_the_stream_and_hears_of_contacts() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("127.0.0.1", 0))
        port.settimeout(10.0)
        screen = Screen(port)
        link = UdpLink(address=parse_link(f"udpout://127.0.0.1:{port.getsockname()[1]}"))
        camera = CameraComponent(
            system_id=1, intrinsics=SMALL, stream=VideoStream(port=5604, name="mixed")
        )
        context = GroundStation(link=link, system_id=1, cameras=(camera,))
        async with link:
            running = asyncio.create_task(context.run())
            beat = await asyncio.to_thread(screen.received, "HEARTBEAT")
            screen.ask(mavlink.MAVLink_command_long_message(1, 100, 512, 0, 269, *[0] * 6))
            stream = await asyncio.to_thread(screen.received, "VIDEO_STREAM_INFORMATION")
            context.contact("real touched gate.left", object_id=7)
            contact = await asyncio.to_thread(screen.received, "COLLISION")
            text = await asyncio.to_thread(screen.received, "STATUSTEXT")
            running.cancel()
            await asyncio.wait([running])
    assert (beat.type, beat.get_srcComponent()) == (mavlink.MAV_TYPE_CAMERA, 100)
    assert stream.uri == "5604"
    assert (contact.id, contact.get_srcSystem()) == (7, 1)
    assert text.text == "real touched gate.left"
