"""Relays between processes: MAVLink and motion capture over UDP, pictures over ZeroMQ.

Each passes everything on as it came until its fault is active.
"""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, cast

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np
import zmq
import zmq.asyncio

from tests.faults.alterations import Alteration
from tests.faults.images import AlteredImage, altered_image
from tests.faults.motion_capture import Alter
from tests.faults.relay import Change
from wil_campaign.foundation.processes.codec import ProcessMessageError
from wil_campaign.vehicles.embedded.process.feed import MocapMessage, from_vehicle
from wil_campaign.vehicles.mavlink.framing import FrameSplitter, MavlinkFrame
from wil_campaign.vehicles.readings import PoseReading

_HOST = "127.0.0.1"
_JUMPS_IMAGES = 10

IsActive = Callable[[], bool]


class _Sender(asyncio.DatagramProtocol):
    """Sends to one port; gives what comes back. That nobody listens there yet is no fault."""

    def __init__(self, take: Callable[[bytes], None]) -> None:
        self._take = take

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Give what came."""
        self._take(data)

    def error_received(self, exc: Exception) -> None:
        """Go on."""


class Receiver(asyncio.DatagramProtocol):
    """Gives what comes, and remembers from where: from one vehicle, or from two."""

    def __init__(self, take: Callable[[bytes], None]) -> None:
        self._take = take
        self.peers: dict[Any, None] = {}

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Give what came."""
        self.peers[addr] = None
        self._take(data)

    def error_received(self, exc: Exception) -> None:
        """Go on."""


@dataclass(slots=True)
class MavlinkRelay:
    """Stands between a vehicle and the program; alters what the vehicle says.

    message_ids: of which kinds; None for all. port: where the vehicle sends to. own: what the
    vehicle itself says in a message's place, before anything is altered; None for what it is.
    heard: the vehicle has said something.
    """

    change: Change
    message_ids: Collection[int] | None
    is_active: IsActive
    port: int = 0
    own: Callable[[MavlinkFrame], MavlinkFrame] | None = None
    altered: int = 0
    heard: asyncio.Event = field(default_factory=asyncio.Event)
    _splitter: FrameSplitter = field(default_factory=FrameSplitter)

    @asynccontextmanager
    async def running(self, to_port: int) -> AsyncIterator[None]:
        """Pass on between the vehicle and a port of the program."""
        loop = asyncio.get_running_loop()
        far: list[asyncio.DatagramTransport] = []

        def to_vehicle(data: bytes) -> None:
            for peer in receiver.peers:
                near.sendto(data, peer)

        def to_program(data: bytes) -> None:
            self._pass_on(data, far[0].sendto)

        near, receiver = await loop.create_datagram_endpoint(
            lambda: Receiver(to_program), local_addr=(_HOST, 0)
        )
        transport, _ = await loop.create_datagram_endpoint(
            lambda: _Sender(to_vehicle), remote_addr=(_HOST, to_port)
        )
        far.append(transport)
        self.port = int(near.get_extra_info("sockname")[1])
        try:
            yield
        finally:
            near.close()
            transport.close()

    def _pass_on(self, data: bytes, send: Callable[[bytes], None]) -> None:
        loop, active = asyncio.get_running_loop(), self.is_active()
        self.heard.set()
        for received in self._splitter.feed(data):
            frame = received if self.own is None else self.own(received)
            concerned = self.message_ids is None or frame.message_id in self.message_ids
            if not active or not concerned:
                send(frame.raw)
                continue
            self.altered += 1
            for delay_s, raw in self.change(frame):
                loop.call_later(delay_s, send, raw) if delay_s > 0.0 else send(raw)


@dataclass(slots=True)
class CaptureRelay:
    """Takes a vehicle's motion capture from its feed, and sends it on as `wil/mocap/1`.

    port: where the vehicle sends its feed. A frame's number goes with its time, so that what
    comes twice has the same number twice.
    """

    alter: Alter
    is_active: IsActive
    body: str
    port: int = 0
    altered: int = 0

    @asynccontextmanager
    async def running(self, to_port: int) -> AsyncIterator[None]:
        """Pass on to a port of the program."""
        loop = asyncio.get_running_loop()
        far: list[asyncio.DatagramTransport] = []
        near, _ = await loop.create_datagram_endpoint(
            lambda: Receiver(lambda data: self._pass_on(data, far[0].sendto)),
            local_addr=(_HOST, 0),
        )
        transport, _ = await loop.create_datagram_endpoint(
            lambda: _Sender(lambda _: None), remote_addr=(_HOST, to_port)
        )
        far.append(transport)
        self.port = int(near.get_extra_info("sockname")[1])
        try:
            yield
        finally:
            near.close()
            transport.close()

    def _pass_on(self, data: bytes, send: Callable[[bytes], None]) -> None:
        try:
            message = from_vehicle.decode(data)
        except ProcessMessageError:
            return
        if not isinstance(message, MocapMessage):
            return
        active = self.is_active()
        self.altered += active
        for reading in self.alter(message.reading) if active else (message.reading,):
            send(self._packed(reading))

    def _packed(self, reading: PoseReading) -> bytes:
        body = {
            "name": self.body,
            "position_m": list(reading.pose.position_ned_m),
            "q_wxyz": list(reading.pose.q_wxyz),
        }
        frame = {
            "protocol": "wil/mocap/1",
            "seq": max(0, round(reading.t_s * 1000)),
            "t_s": reading.t_s,
            "frame": "ned",
            "bodies": [body],
        }
        return cast("bytes", msgpack.packb(frame))


@dataclass(slots=True)
class PictureRelay:
    """Stands between the program and a simulator that draws; alters what is drawn."""

    alteration: Alteration
    is_active: IsActive
    size_px: tuple[int, int]
    address: str = ""
    altered: int = 0
    _first: list[bytes] = field(default_factory=list)

    @asynccontextmanager
    async def running(self, simulator: str) -> AsyncIterator[None]:
        """Pass on between the program and a simulator's address."""
        context = zmq.asyncio.Context()
        near, far = context.socket(zmq.ROUTER), context.socket(zmq.DEALER)
        near.linger = far.linger = 0
        port = near.bind_to_random_port(f"tcp://{_HOST}")
        far.connect(simulator)
        self.address = f"tcp://{_HOST}:{port}"
        tasks = [
            asyncio.create_task(self._forward(near, far), name="questions"),
            asyncio.create_task(self._return(far, near), name="pictures"),
        ]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)
            near.close()
            far.close()
            context.term()

    async def _forward(self, near: Any, far: Any) -> None:
        while True:
            await far.send_multipart(await near.recv_multipart())

    async def _return(self, far: Any, near: Any) -> None:
        loop = asyncio.get_running_loop()
        while True:
            parts = await far.recv_multipart()
            head = parts.index(b"") + 1
            header = msgpack.unpackb(parts[head])
            if header.get("type") != "picture" or not self.is_active():
                await near.send_multipart(parts)
                continue
            self.altered += 1
            kind = self.alteration.kind
            if kind == "stop":
                continue
            if kind == "delay":
                send = _detached(near.send_multipart, parts)
                loop.call_later(abs(self.alteration.step_s), send)
                continue
            await near.send_multipart([*parts[:head], *self._altered(header, parts[head:])])

    def _altered(self, header: dict[str, Any], parts: list[bytes]) -> list[bytes]:
        """Return header and arrays as they go on."""
        self._first = self._first or parts
        kind = self.alteration.kind
        if kind == "duplicate":
            return self._first
        if kind == "freeze":
            return [parts[0], *self._first[1:]]
        if kind == "jump" and self.altered % (2 * _JUMPS_IMAGES) >= _JUMPS_IMAGES:
            return parts
        shape = (self.size_px[1], self.size_px[0])
        given = {one["name"]: data for one, data in zip(header["parts"], parts[1:], strict=True)}
        depth, ids = given.get("depth"), given.get("ids")
        drawn = AlteredImage(
            np.frombuffer(given["image"], np.uint8).reshape(*shape, 3),
            None if depth is None else np.frombuffer(depth, np.dtype("<f4")).reshape(shape),
            None if ids is None else np.frombuffer(ids, np.uint8).reshape(shape),
        )
        off = altered_image(drawn, self.alteration)
        made = {"image": off.image_bgr, "depth": off.depth_m, "ids": off.object_ids}
        arrays = [made[one["name"]] for one in header["parts"]]
        return [parts[0], *(array.tobytes() for array in arrays if array is not None)]


def _detached(send: Any, parts: list[bytes]) -> Callable[[], None]:
    """Return a call that sends later; a socket that is closed by then has nobody left."""

    async def late() -> None:
        with contextlib.suppress(zmq.ZMQError):
            await send(parts)

    def begin() -> None:
        tasks.append(asyncio.create_task(late(), name="late picture"))

    tasks: list[asyncio.Task[None]] = []
    return begin
