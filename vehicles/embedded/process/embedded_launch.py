"""The parent's side of a vehicle process: its truth and motion capture, and faults for it."""

import asyncio
from collections.abc import Callable
from types import TracebackType
from typing import Self, cast

from vehicles.clocks.sim_clock_controller import Segment
from vehicles.embedded.physics.states import TruthSample
from vehicles.embedded.process.feed import (
    FeedError,
    Kind,
    Motion,
    Notice,
    decode,
    encode,
    mocap_reading,
    pace_text,
    truth_sample,
)
from vehicles.embedded.process.injected_faults import Fault
from vehicles.links.link import LinkError
from vehicles.readings import PoseReading, Source


class FeedClient(asyncio.DatagramProtocol):
    """Hears one vehicle's feed; the same interface as the vehicle in process.

    An async context manager that binds `port` (0: any) on loopback.
    """

    def __init__(self, *, source: Source, port: int = 0, host: str = "127.0.0.1") -> None:
        self._source = source
        self._where = (host, port)
        self._transport: asyncio.DatagramTransport | None = None
        self._peer: tuple[str, int] | None = None
        self._truths: list[tuple[float, Callable[[TruthSample], None], list[float]]] = []
        self._mocaps: list[Callable[[PoseReading], None]] = []
        self._truth: TruthSample | None = None
        self._seq_in = -1
        self._seq_out = 0
        self.garbage = 0
        """Datagrams that were none of the feed's."""
        self.heard = asyncio.Event()
        """Set with the first datagram."""

    @property
    def port(self) -> int:
        """Return the port that is heard on; 0 when closed."""
        if self._transport is None:
            return 0
        return int(self._transport.get_extra_info("sockname")[1])

    def truth(self) -> TruthSample | None:
        """Return the newest truth; None before the first."""
        return self._truth

    def on_truth(self, callback: Callable[[TruthSample], None], rate_hz: float) -> None:
        """Have the truth given to `callback`, at most so often."""
        self._truths.append((1.0 / rate_hz, callback, [-1.0]))

    def on_mocap(self, callback: Callable[[PoseReading], None]) -> None:
        """Have motion capture's readings given to `callback`."""
        self._mocaps.append(callback)

    def notify(self, event: str, t_s: float) -> None:
        """Pass an event of the world to the vehicle's surroundings."""
        self._send(Notice(Kind.EVENT, self._next_seq(), round(t_s * 1e6), event))

    def fault(self, fault: Fault) -> None:
        """Make a fault in the vehicle."""
        t_us = round(asyncio.get_running_loop().time() * 1e6)
        self._send(Notice(Kind.FAULT, self._next_seq(), t_us, str(fault)))

    def pace(self, segment: Segment) -> None:
        """Have the vehicle's clock go on by this piece."""
        t_us = round(segment.run_s * 1e6)
        self._send(Notice(Kind.PACE, self._next_seq(), t_us, pace_text(segment)))

    async def __aenter__(self) -> Self:
        """Bind the port. Raises LinkError when it is taken."""
        loop = asyncio.get_running_loop()
        try:
            await loop.create_datagram_endpoint(lambda: self, local_addr=self._where)
        except OSError as error:
            raise LinkError(f"feed udp://{self._where[0]}:{self._where[1]}: {error}") from error
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the socket."""
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Take a datagram of the vehicle."""
        try:
            datagram = decode(data)
        except FeedError:
            self.garbage += 1
            return
        if not isinstance(datagram, Motion) or datagram.seq <= self._seq_in:
            return
        self._peer, self._seq_in = addr, datagram.seq
        self.heard.set()
        if datagram.kind is Kind.TRUTH:
            self._give_truth(truth_sample(datagram))
            return
        now_s = asyncio.get_running_loop().time()
        reading = mocap_reading(datagram, arrived_s=now_s, source=self._source)
        for callback in self._mocaps:
            callback(reading)

    def _give_truth(self, sample: TruthSample) -> None:
        self._truth = sample
        for interval_s, callback, due_s in self._truths:
            if sample.t_s >= due_s[0] - 1e-3:
                due_s[0] = max(due_s[0] + interval_s, sample.t_s)
                callback(sample)

    def _next_seq(self) -> int:
        self._seq_out += 1
        return self._seq_out

    def _send(self, notice: Notice) -> None:
        if self._transport is not None and self._peer is not None:
            self._transport.sendto(encode(notice), self._peer)
