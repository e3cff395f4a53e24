"""The parent's end of an embedded vehicle's feed: receives truth, sends events and faults."""

import asyncio
import socket
from collections.abc import Callable
from dataclasses import replace
from typing import Self

from wil_campaign.foundation.processes.codec import ProcessMessageError
from wil_campaign.foundation.processes.feed_socket import FeedSocket
from wil_campaign.vehicles.embedded.process.feed import (
    FaultMessage,
    ToVehicle,
    TruthMessage,
    WorldEventMessage,
    from_vehicle,
    is_feed_message_finite,
    to_vehicle,
)
from wil_campaign.vehicles.faults import InjectedFault
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import PoseReading, Source


class FeedClient:
    """The client of one launched embedded vehicle's feed; same interface as `EmbeddedVehicle`.

    end: our end of the feed's socket; an async context manager that closes it.
    """

    def __init__(self, *, source: Source, end: socket.socket) -> None:
        self._source = source
        self._end = end
        self._socket: FeedSocket | None = None
        self._truths: list[tuple[float, Callable[[TruthSample], None], list[float]]] = []
        self._mocaps: list[Callable[[PoseReading], None]] = []
        self._truth: TruthSample | None = None
        self._seq_in = -1
        self._seq_out = 0
        self.garbage = 0
        """Number of packets that are not messages of the feed."""
        self.connected = asyncio.Event()
        """Set with the first packet."""

    def truth(self) -> TruthSample | None:
        """Return the launched vehicle's newest truth; None before the first."""
        return self._truth

    def on_truth(self, callback: Callable[[TruthSample], None], rate_hz: float) -> None:
        """Call `callback` with the embedded vehicle's truth, at most at this rate."""
        self._truths.append((1.0 / rate_hz, callback, [-1.0]))

    def on_mocap(self, callback: Callable[[PoseReading], None]) -> None:
        """Call `callback` with the embedded vehicle's motion capture readings."""
        self._mocaps.append(callback)

    def notify(self, event: str, t_s: float) -> None:
        """Pass an event of the world to the embedded vehicle's contact world."""
        self._send(WorldEventMessage(self._next_seq(), event, t_s))

    def fault(self, fault: InjectedFault) -> None:
        """Inject a fault into the embedded vehicle."""
        self._send(FaultMessage(self._next_seq(), str(fault)))

    async def __aenter__(self) -> Self:
        """Read the feed client's socket from now on."""
        self._socket = FeedSocket(self._end, self._receive)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the feed client's socket."""
        if self._socket is not None:
            self._socket.close()

    def _receive(self, data: bytes) -> None:
        """Handle a packet of the embedded vehicle's feed."""
        try:
            message = from_vehicle.decode(data)
        except ProcessMessageError:
            self.garbage += 1
            return
        if not is_feed_message_finite(message):
            self.garbage += 1
            return
        if message.seq <= self._seq_in:
            return
        self._seq_in = message.seq
        self.connected.set()
        if isinstance(message, TruthMessage):
            self._pass_truth(message.sample)
            return
        now_s = asyncio.get_running_loop().time()
        reading = replace(message.reading, arrived_s=now_s, source=self._source)
        for callback in self._mocaps:
            callback(reading)

    def _pass_truth(self, sample: TruthSample) -> None:
        self._truth = sample
        for interval_s, callback, due_s in self._truths:
            if sample.t_s >= due_s[0] - 1e-3:
                due_s[0] = max(due_s[0] + interval_s, sample.t_s)
                callback(sample)

    def _next_seq(self) -> int:
        """Return the next sequence number to the embedded vehicle."""
        self._seq_out += 1
        return self._seq_out

    def _send(self, message: ToVehicle) -> None:
        if self._socket is not None:
            self._socket.send(to_vehicle.encode(message))
