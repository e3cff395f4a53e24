"""Publishes readings by ZeroMQ: images as simulators send them, others as sources take them."""

import zmq

from wil_campaign.plugins.outlets.image_delivery import DeliveryError
from wil_campaign.plugins.outlets.threaded_delivery import ThreadedDelivery
from wil_campaign.plugins.readings.messagepack import pack_header
from wil_campaign.plugins.readings.written_reading import written_reading
from wil_campaign.plugins.simulator.image_parts import (
    Buffer,
    encode_depth_part,
    encode_ids_part,
    encode_image_part,
)
from wil_campaign.plugins.simulator.simulator_protocol import PROTOCOL
from wil_campaign.vehicles.readings import CameraReading, Reading


def published_parts(
    reading: CameraReading, *, topic: str, encoding: str = "bgr8", jpeg_quality: int = 90
) -> list[Buffer]:
    """Return an image as a ZMQ message: topic, header, then an entry of `parts` each.

    Raises ValueError for an unknown encoding.
    """
    parts: list[tuple[str, str, Buffer]] = [
        (
            "image",
            encoding,
            encode_image_part(reading.image_bgr, encoding, jpeg_quality=jpeg_quality),
        )
    ]
    if reading.depth_m is not None:
        parts.append(("depth", "f32", encode_depth_part(reading.depth_m)))
    if reading.object_ids is not None:
        parts.append(("ids", "u8", encode_ids_part(reading.object_ids)))
    i, pose = reading.intrinsics, reading.camera_pose
    header = {
        "protocol": PROTOCOL,
        "type": "picture",
        "seq": reading.seq,
        "t_s": reading.t_s,
        "arrived_s": reading.arrived_s,
        "source": reading.source,
        "rendered": reading.rendered,
        "position_ned_m": list(pose.position_ned_m) if pose is not None else None,
        "q_wxyz": list(pose.q_wxyz) if pose is not None else None,
        "camera": {
            "width_px": i.width_px,
            "height_px": i.height_px,
            "fx_px": i.fx_px,
            "fy_px": i.fy_px,
            "cx_px": i.cx_px,
            "cy_px": i.cy_px,
            "distortion": list(i.distortion),
        },
        "parts": [{"name": name, "encoding": how} for name, how, _ in parts],
    }
    return [topic.encode(), pack_header(header), *(data for _, _, data in parts)]


class ZmqSink:
    """Publishes readings by ZMQ; a Sink. A slow subscriber misses some and blocks nothing.

    waiting: how many messages may wait for a subscriber.
    """

    def __init__(
        self, *, address: str, topic: str, encoding: str, jpeg_quality: int, waiting: int
    ) -> None:
        self.name = f"zmq+{address}"
        self._address = address
        self._topic = topic
        self._encoding = encoding
        self._jpeg_quality = jpeg_quality
        self._most_waiting = waiting
        self._context: zmq.Context[zmq.Socket[bytes]] | None = None
        self._socket: zmq.Socket[bytes] | None = None
        self.endpoint = ""
        """Where subscribers connect: the address with its port, once open."""

    def open(self) -> None:
        """Bind the ZMQ socket. Raises DeliveryError."""
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        self._socket.setsockopt(zmq.SNDHWM, self._most_waiting)
        self._socket.setsockopt(zmq.LINGER, 100)
        try:
            self._socket.bind(self._address)
        except zmq.ZMQError as error:
            raise DeliveryError(
                f"{self.name}: cannot bind: {error.strerror}; choose a free port of this "
                "machine, as in tcp://127.0.0.1:5601"
            ) from error
        self.endpoint = self._socket.getsockopt_string(zmq.LAST_ENDPOINT)

    def write(self, reading: Reading) -> None:
        """Publish one reading by ZMQ."""
        if self._socket is None:
            raise DeliveryError(f"{self.name} is not open")
        if not isinstance(reading, CameraReading):
            self._socket.send_multipart([self._topic.encode(), written_reading(reading)])
            return
        parts = published_parts(
            reading,
            topic=self._topic,
            encoding=self._encoding,
            jpeg_quality=self._jpeg_quality,
        )
        self._socket.send_multipart(parts, copy=False)

    def close(self) -> None:
        """Close the ZMQ socket; pending images get a tenth of a second."""
        if self._socket is not None:
            self._socket.close()
        if self._context is not None:
            self._context.term()


class ZmqDelivery(ThreadedDelivery):
    """A delivery of readings to ZMQ subscribers.

    address: to bind, `tcp://HOST:PORT`, port `*` for any. topic: first part of each message.
    encoding: `bgr8` (no loss, much data), `png` or `jpeg`. depth:
    how many readings may wait to be sent, and twice as many for a slow subscriber.
    """

    def __init__(
        self,
        *,
        address: str,
        topic: str = "mixed",
        encoding: str = "bgr8",
        jpeg_quality: int = 90,
        depth: int = 2,
    ) -> None:
        if encoding not in {"bgr8", "png", "jpeg"}:
            raise DeliveryError(
                f"{address}: unknown encoding {encoding!r}; choose bgr8, png or jpeg"
            )
        self._zmq = ZmqSink(
            address=address,
            topic=topic,
            encoding=encoding,
            jpeg_quality=jpeg_quality,
            waiting=2 * depth,
        )
        self.topic = topic
        super().__init__(sink=self._zmq, depth=depth)

    @property
    def endpoint(self) -> str:
        """Return where ZMQ subscribers connect; empty before it is open."""
        return self._zmq.endpoint
