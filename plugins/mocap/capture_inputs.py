"""Motion capture inputs: UDP datagrams, or a ZeroMQ subscription. Wall clock only."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Self

import zmq

from wil_campaign.campaigns.values.external_setups import MocapSetup
from wil_campaign.plugins.mocap.motion_capture import CaptureDecoder
from wil_campaign.plugins.readings.subscription import Subscription
from wil_campaign.vehicles.readings import PoseReading, Source
from wil_campaign.vehicles.sources.camera_source import SourceError

Deliver = Callable[[PoseReading], None]
_MOST_OTHERS = 8


def udp_capture(setups: Mapping[Source, MocapSetup], deliver: Deliver) -> "UdpCapture":
    """Return the input of vehicles whose motion capture comes by UDP to one port."""
    one = next(iter(setups.values()))
    return UdpCapture(
        host=one.host,
        port=one.port,
        capture=_capture(setups),
        deliver=deliver,
        sender=one.sender,
    )


def zmq_capture(setups: Mapping[Source, MocapSetup], deliver: Deliver) -> "ZmqCapture":
    """Return the input of vehicles whose motion capture comes from one ZeroMQ publisher."""
    one = next(iter(setups.values()))
    return ZmqCapture(
        address=one.address, capture=_capture(setups), deliver=deliver, topic=one.topic.encode()
    )


def _capture(setups: Mapping[Source, MocapSetup]) -> CaptureDecoder:
    """Return what reads the messages of some vehicles' bodies."""
    return CaptureDecoder(
        bodies={setup.body: vehicle for vehicle, setup in setups.items()},
        latency_s=next(iter(setups.values())).latency_s,
    )


class UdpCapture(asyncio.DatagramProtocol):
    """A motion capture input by UDP, one message per datagram; an async context manager.

    host: an address of this machine; 0.0.0.0 for all of them. deliver: called in the loop with
    each reading, in order. sender: the address whose messages are taken, HOST or HOST:PORT; by
    default that of the first sound message. Those of any other are dropped, and their sender is
    named in `others`.
    """

    def __init__(
        self, *, host: str, port: int, capture: CaptureDecoder, deliver: Deliver, sender: str = ""
    ) -> None:
        self.name = f"motion capture on UDP {host}:{port}"
        self._address = (host, port)
        self.capture = capture
        self._deliver = deliver
        self._named = sender
        self._sender: tuple[str, int] | None = None
        self.others: dict[str, str] = {}
        """Messages about other senders, by their address; the first few."""
        self._transport: asyncio.DatagramTransport | None = None

    @property
    def rivals(self) -> str:
        """Return in words which other senders there are, where none was named; "" without any."""
        return "" if self._named else "; ".join(self.others.values())

    @property
    def port(self) -> int:
        """Return the capture input's bound UDP port; 0 when closed."""
        if self._transport is None:
            return 0
        return int(self._transport.get_extra_info("sockname")[1])

    async def __aenter__(self) -> Self:
        """Bind the capture input's UDP port. Raises SourceError."""
        self._loop = asyncio.get_running_loop()
        try:
            self._transport, _ = await self._loop.create_datagram_endpoint(
                lambda: self, local_addr=self._address
            )
        except OSError as error:
            raise SourceError(
                f"{self.name}: {error.strerror}; another program may use this port: end that "
                "program, or choose another port"
            ) from error
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the capture input; nothing is delivered afterwards."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            # The transport closes its socket one turn later.
            await asyncio.sleep(0)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Take a capture datagram of the one sender (asyncio calls this)."""
        if not self._is_sender(addr):
            self._note_other(addr)
            return
        garbage = self.capture.garbage
        for reading in self.capture.receive(data, self._loop.time()):
            self._deliver(reading)
        if self._sender is None and self.capture.garbage == garbage:
            self._sender = addr

    def _is_sender(self, addr: tuple[str, int]) -> bool:
        if self._sender is not None:
            return addr == self._sender
        return not self._named or self._named in {addr[0], _text(addr)}

    def _note_other(self, addr: tuple[str, int]) -> None:
        if len(self.others) >= _MOST_OTHERS or _text(addr) in self.others:
            return
        taken = self._named if self._sender is None else _text(self._sender)
        self.others[_text(addr)] = (
            f"{self.name} is sent to by {_text(addr)} as well as by {taken}, whose poses alone are "
            "taken"
        )


def _text(addr: tuple[str, int]) -> str:
    return f"{addr[0]}:{addr[1]}"


class ZmqCapture:
    """A motion capture input by ZMQ subscription, last message part; async context manager.

    address: `tcp://HOST:PORT` that a publisher has bound. topic: prefix of the first part.
    """

    def __init__(
        self, *, address: str, capture: CaptureDecoder, deliver: Deliver, topic: bytes = b""
    ) -> None:
        self.name = f"motion capture at {address}"
        self._address = address
        self.capture = capture
        self._deliver = deliver
        self.others: dict[str, str] = {}
        self.rivals = ""
        self._topic = topic

    async def __aenter__(self) -> Self:
        """Subscribe the capture input; a publisher may come later. Raises SourceError."""
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        self._socket.setsockopt(zmq.RCVHWM, 1000)
        self._socket.setsockopt(zmq.MAXMSGSIZE, 65_536)
        self._socket.subscribe(self._topic)
        try:
            self._socket.connect(self._address)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise SourceError(
                f"{self.name}: not a valid address: {error.strerror}; an example is "
                "tcp://192.168.1.10:5570"
            ) from error
        self._subscription = Subscription(self._socket, self._take)
        self._subscription.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the capture input; nothing is delivered afterwards."""
        self._subscription.stop()
        self._context.destroy(linger=0)

    def _take(self, data: bytes, arrived_s: float) -> None:
        for reading in self.capture.receive(data, arrived_s):
            self._deliver(reading)
