"""Requests images of a simulator in another process over ZeroMQ."""

import asyncio
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import zmq

from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.plugins.simulator.image_parts import Buffer
from wil_campaign.plugins.simulator.shown_world import AskedWorld, world_disagreements
from wil_campaign.plugins.simulator.simulator_protocol import (
    ImageRequest,
    LateAnswerError,
    SimulatedImage,
    SimulatorRefusedError,
    SimulatorWelcome,
    ask_parts,
    hello_parts,
    simulated_image_of,
    welcome_of,
)
from wil_campaign.vehicles.cameras.rendered_cameras import NoImageError
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

T = TypeVar("T")

_MAX_MESSAGE_BYTES = 256 * 1024 * 1024


class SimulatorError(SourceError, NoImageError):
    """The simulator's camera gave no usable image."""


class SimulatorTimeoutError(SimulatorError):
    """The simulator did not reply in time."""


@dataclass(frozen=True, slots=True)
class SimulatorCounts:
    """The counts of requests to the simulator's camera by outcome.

    late: replies to requests that had timed out. garbage: replies that broke the protocol.
    refused: requests that the simulator answered with an error.
    """

    asked: int = 0
    answered: int = 0
    timeouts: int = 0
    late: int = 0
    garbage: int = 0
    refused: int = 0


def _no_events() -> Mapping[str, float]:
    """Return no events: the simulator's world is static."""
    return {}


def _nothing_moves(_: float) -> Mapping[str, Pose]:
    """Return no poses: nothing in the simulator's world moves."""
    return {}


class ZmqImageSource:
    """A simulator's camera by ZMQ as an ImageSource; an async context manager.

    address: `tcp://HOST:PORT` that the simulator has bound. world: what the simulator is asked to
    show; `disagreements` says where it shows something else. events, moved (at a time): called
    before each request. `picture` blocks, for a thread (`compute=asyncio.to_thread`); several
    threads may call it, they wait in turn.
    An image is returned only if it is the requested one: its number, pose, time, size and type are
    checked. Wall clock only.
    """

    def __init__(
        self,
        *,
        address: str,
        timeout_s: float = 1.0,
        open_timeout_s: float = 5.0,
        world: AskedWorld = AskedWorld(),  # noqa: B008 - frozen
        events: Callable[[], Mapping[str, float]] = _no_events,
        moved: Callable[[float], Mapping[str, Pose]] = _nothing_moves,
    ) -> None:
        self.name = address
        self._timeout_s = timeout_s
        self._open_timeout_s = open_timeout_s
        self._world = world
        self._events = events
        self._moved = moved
        self._lock = threading.Lock()
        self._seq = 0
        self.counts = SimulatorCounts()
        self.trouble = ""
        """Why the last failed request got no image."""
        self.welcome = SimulatorWelcome("")

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Return in words where the world that it shows differs from the requested one."""
        return world_disagreements(self._world, self.welcome.shown)

    async def __aenter__(self) -> Self:
        """Connect to the simulator and greet it. Raises SimulatorError."""
        self._context = zmq.Context()
        try:
            self._socket = self._connect()
            await asyncio.to_thread(self._greet)
        except BaseException:
            await self._close()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        """Disconnect from the simulator; a request under way is awaited."""
        await self._close()

    async def warm_up(self, camera_pose: Pose, intrinsics: Intrinsics, t_s: float) -> None:
        """Request a first image, which takes an engine long, and leave it out of the counts.

        Waits as long as for the connection. Raises SimulatorError.
        """
        await asyncio.to_thread(
            self.picture,
            camera_pose,
            intrinsics,
            t_s,
            want_ids=bool(self.welcome.objects),
            within_s=self._open_timeout_s,
        )
        self.counts = SimulatorCounts()

    async def ask(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = True,
        want_ids: bool = True,
    ) -> SimulatedImage:
        """Return a simulator's image without blocking the loop. Raises SimulatorError."""
        return await asyncio.to_thread(
            self.picture,
            camera_pose,
            intrinsics,
            t_s,
            want_depth=want_depth,
            want_ids=want_ids,
        )

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
        within_s: float | None = None,
    ) -> SimulatedImage:
        """Return a simulator's image; blocks within its limit. Raises SimulatorError."""
        events, moved = self._events(), self._moved(t_s)
        with self._lock:
            self._seq += 1
            ask = ImageRequest(
                self._seq, t_s, camera_pose, intrinsics, want_depth, want_ids, events, moved
            )
            self._count(asked=1)
            try:
                image = self._request(
                    ask_parts(ask),
                    lambda parts: simulated_image_of(parts, ask),
                    within_s or self._timeout_s,
                )
            except SimulatorError as error:
                self.trouble = str(error)
                raise
            except zmq.ZMQError as error:
                raise SimulatorError(
                    f"{self.name}: the connection is closed ({error.strerror}); request images "
                    "within `async with`"
                ) from error
            self._count(answered=1)
            return image

    def _connect(self) -> "zmq.Socket[bytes]":
        socket = self._context.socket(zmq.DEALER)
        socket.setsockopt(zmq.LINGER, 0)
        # A request is for a simulator that is connected now, not queued for one that returns later.
        socket.setsockopt(zmq.IMMEDIATE, 1)
        socket.setsockopt(zmq.SNDHWM, 2)
        socket.setsockopt(zmq.MAXMSGSIZE, _MAX_MESSAGE_BYTES)
        socket.setsockopt(zmq.HEARTBEAT_IVL, 1000)
        try:
            socket.connect(self.name)
        except zmq.ZMQError as error:
            socket.close()
            raise SimulatorError(
                f"{self.name}: not a valid address of a simulator: {error.strerror}; an example is "
                "tcp://127.0.0.1:5555"
            ) from error
        return socket

    def _greet(self) -> None:
        """Send the simulator hello and keep its welcome."""
        with self._lock:
            hello = hello_parts(self._world)
            self.welcome = self._request(hello, welcome_of, self._open_timeout_s)

    def _send(self, parts: Sequence[Buffer], deadline_s: float) -> None:
        if not self._socket.poll(_left_ms(deadline_s), zmq.POLLOUT):
            self._count(timeouts=1)
            raise SimulatorTimeoutError(
                f"{self.name}: no simulator is connected; start it, or check why it stopped"
            )
        # The empty part makes this DEALER socket look like a REQ socket to the simulator's REP.
        self._socket.send_multipart([b"", *parts])

    def _request(
        self, parts: Sequence[Buffer], read: Callable[[Sequence[Buffer]], T], within_s: float
    ) -> T:
        """Send a request and return the simulator's reply to it; late ones are skipped."""
        deadline_s = time.monotonic() + within_s
        self._send(parts, deadline_s)
        while True:
            reply = self._receive(deadline_s, within_s)
            try:
                return read(reply)
            except LateAnswerError:
                self._count(late=1)
            except SimulatorRefusedError as error:
                self._count(refused=1)
                raise SimulatorError(f"{self.name}: the simulator refused: {error}") from error
            except BadMessageError as error:
                self._count(garbage=1)
                raise SimulatorError(
                    f"{self.name}: the simulator's reply is wrong: {error}; "
                    "see docs/simulator-protocol.md"
                ) from error

    def _receive(self, deadline_s: float, within_s: float) -> Sequence[Buffer]:
        """Return the simulator's next message. Raises SimulatorTimeoutError."""
        if not self._socket.poll(_left_ms(deadline_s), zmq.POLLIN):
            self._count(timeouts=1)
            raise SimulatorTimeoutError(
                f"{self.name}: the simulator did not answer in {within_s:g} s; it hangs, "
                "has stopped, or is too slow for this limit"
            )
        parts = [frame.buffer for frame in self._socket.recv_multipart(copy=False)]
        return parts[1:] if len(parts[0]) == 0 else parts

    def _count(self, **more: int) -> None:
        changed = {name: getattr(self.counts, name) + n for name, n in more.items()}
        self.counts = replace(self.counts, **changed)

    async def _close(self) -> None:
        await asyncio.to_thread(self._close_socket)

    def _close_socket(self) -> None:
        with self._lock:
            self._context.destroy(linger=0)


def _left_ms(deadline_s: float) -> int:
    return max(0, round((deadline_s - time.monotonic()) * 1000.0))
