"""Readings that a program publishes by ZeroMQ. Wall clock only."""

from typing import Self

import zmq

from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.plugins.readings.reading_message import (
    MAX_READING_BYTES,
    SampleStamps,
    read_envelope,
    read_header,
    read_reading,
)
from wil_campaign.plugins.readings.subscription import Subscription
from wil_campaign.vehicles.readings import Source
from wil_campaign.vehicles.sources.arrival_clock import ArrivalClock
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.readings.live_readings import LiveReadings
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

_MOST_NAMES = 8


class ZmqReadings(LiveReadings):
    """The readings of one sensor in the messages of a ZeroMQ publisher; a ReadingSource.

    address: tcp://HOST:PORT that the publisher has bound. sensor: its name in the messages.
    kind_of: its type. camera: the model of a depth camera. topic: prefix of the first part.
    latency_s: sampling to arrival of the quickest. open_s: how long the first reading may take.
    Messages of other sensors are ignored.
    """

    def __init__(
        self,
        *,
        address: str,
        sensor: str,
        kind_of: str,
        side: Source,
        mount: Pose = AT_ORIGIN,
        camera: Intrinsics | None = None,
        topic: str = "",
        latency_s: float = 0.0,
        open_s: float = 5.0,
        stall_s: float = 1.0,
    ) -> None:
        super().__init__(
            name=f"{side} {sensor} from {address}", what=f"{kind_of} reading", stall_s=stall_s
        )
        self._address = address
        self._sensor = sensor
        self._kind_of = kind_of
        self._side: Source = side
        self._mount = mount
        self._camera = camera
        self._topic = topic.encode()
        self._open_s = open_s
        self._clock = ArrivalClock(latency_s=latency_s)
        self._last_seq: int | None = None
        self._others: set[str] = set()

    async def __aenter__(self) -> Self:
        """Subscribe, and wait for the first reading. Raises SourceError."""
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        self._socket.setsockopt(zmq.RCVHWM, 1000)
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_READING_BYTES)
        self._socket.subscribe(self._topic)
        try:
            self._socket.connect(self._address)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise SourceError(f"{self.name}: not a valid address: {error.strerror}") from error
        self._subscription = Subscription(self._socket, self._take)
        self._subscription.start()
        try:
            await self._wait_for_first(self._open_s)
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the socket; nothing is taken afterwards."""
        self._subscription.stop()
        self._context.destroy(linger=0)

    def _silence_reason(self) -> str:
        """Return why nothing arrived at all, or what to do, in words."""
        if self._others:
            known = ", ".join(sorted(self._others))
            return f"only messages of other sensors arrived ({known}): set `name` to one of them"
        return "nothing arrived; check that a publisher has bound this address, and its topic"

    def _take(self, data: bytes, arrived_s: float) -> None:
        try:
            self.receive(data, arrived_s)
        except BadMessageError as error:
            self.refuse(str(error))

    def receive(self, data: bytes, arrived_s: float) -> None:
        """Take a message that arrived at a time of the run clock. Raises BadMessageError."""
        header = read_header(data)
        envelope = read_envelope(header)
        if envelope.sensor != self._sensor:
            if len(self._others) < _MOST_NAMES:
                self._others.add(f"{envelope.sensor:.40}")
            return
        if envelope.kind != self._kind_of:
            raise BadMessageError(
                f"'{self._sensor}' is a {envelope.kind!r:.40} in the message, and a "
                f"{self._kind_of} in the campaign"
            )
        skipped = self._skipped(envelope.seq, envelope.sent_s)
        resets = self._clock.resets
        t_s = self._clock.run_time(envelope.sent_s, arrived_s)
        if self._clock.resets > resets:
            skipped = None  # the numbers of another beginning
        self.restarts += skipped is None
        when = SampleStamps(t_s, arrived_s, self._side, self._mount, self._camera)
        self.offer(read_reading(header, self._kind_of, when), skipped=skipped or 0)

    def _skipped(self, seq: int, sent_s: float) -> int | None:
        """Return how many readings are missing before this one; None where a sender restarted.

        Raises BadMessageError for one that later ones overtook, or that repeats a number.
        """
        last = self._last_seq
        if last is not None and (seq == last or (seq < last and self._clock.is_overtaken(sent_s))):
            raise BadMessageError(f"its `seq` {seq} arrived after {last}")
        self._last_seq = seq
        if last is None:
            return 0
        return seq - last - 1 if seq > last else None
