"""Sockets of the run clock: the leading process sends segments, vehicles' processes progress.

A child inherits one end of a packet socket and finds its number in `CLOCK_DESCRIPTOR`. When the
leader has ended, the child's clock continues by itself: its vehicle has to be able to land.
"""

import asyncio
import math
import socket
import sys
import time
from collections.abc import Callable, Mapping

from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.clocks.progress import ClockProgressReporter
from wil_campaign.foundation.clocks.sim_clock_controller import ClockSegment
from wil_campaign.foundation.processes.codec import (
    Finite,
    MessageCodec,
    ProcessMessage,
    ProcessMessageError,
)

CLOCK_DESCRIPTOR = "WIL_CAMPAIGN_CLOCK"
"""The environment variable with the file descriptor of a child's end."""
_PACKET_BYTES = 256
_PACKETS_A_TURN = 64


class ContinueClock(ProcessMessage, frozen=True):
    """Clock message: how the run clock continues."""

    segment: ClockSegment


class ProgressReached(ProcessMessage, frozen=True):
    """Clock message: the process has done all that was due until a moment of the run clock."""

    run_s: Finite


_continue: MessageCodec[ContinueClock] = MessageCodec(ContinueClock)
_reached: MessageCodec[ProgressReached] = MessageCodec(ProgressReached)


def clock_environment(end: socket.socket | None) -> dict[str, str]:
    """Return the environment variable of a child's end of the clock socket; empty without one."""
    return {} if end is None else {CLOCK_DESCRIPTOR: str(end.fileno())}


class ClockSockets:
    """The leader's ends of the sockets to the processes that follow its clock.

    reached: called with a process's name and progress. left: called when one has ended.
    """

    def __init__(
        self, *, reached: Callable[[str, float], None], left: Callable[[str], None]
    ) -> None:
        self._reached = reached
        self._left = left
        self._ends: dict[str, socket.socket] = {}

    def open(self, name: str) -> socket.socket:
        """Open a socket to a process; return the end to be inherited, and then closed here."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        self._drop(name)
        self._ends[name] = ours
        asyncio.get_running_loop().add_reader(ours, self._read, name, ours)
        return theirs

    def send(self, segment: ClockSegment) -> None:
        """Send all processes a segment; one whose socket is full hangs, and misses it."""
        packet = _continue.encode(ContinueClock(segment))
        for end in self._ends.values():
            try:
                end.send(packet)
            except OSError:
                continue  # A closed socket is detected by reading.

    def close(self) -> None:
        """Close the leader's ends."""
        for name in tuple(self._ends):
            self._drop(name)

    def _drop(self, name: str) -> None:
        end = self._ends.pop(name, None)
        if end is not None:
            asyncio.get_running_loop().remove_reader(end)
            end.close()

    def _read(self, name: str, end: socket.socket) -> None:
        run_s: float | None = None
        try:
            for _ in range(_PACKETS_A_TURN):
                packet = end.recv(_PACKET_BYTES)
                if not packet:
                    raise ConnectionResetError
                run_s = _reached.decode(packet).run_s
        except BlockingIOError:
            pass
        except ProcessMessageError:
            return
        except OSError:
            self._drop(name)
            self._left(name)
            return
        if run_s is not None:
            self._reached(name, run_s)


class InheritedClock:
    """A child's end: its paced loop follows the leader's clock, and reports its progress."""

    def __init__(self, *, loop: PacedLoop, end: socket.socket) -> None:
        self._loop = loop
        self._end = end
        self._progress: ClockProgressReporter | None = None
        end.setblocking(False)
        # Read before all other input: requests are handled at the clock time they were sent at.
        loop.add_first_reader(end, self._read)

    @classmethod
    def of(cls, loop: PacedLoop, environment: Mapping[str, str]) -> "InheritedClock | None":
        """Return the clock that the environment names; None without one."""
        number = environment.get(CLOCK_DESCRIPTOR)
        if number is None:
            return None
        return cls(loop=loop, end=socket.socket(fileno=int(number)))

    def close(self) -> None:
        """Close the child's end; its clock continues as it is."""
        if self._progress is not None:
            self._progress.stop()
        self._loop.remove_reader(self._end)
        self._end.close()

    def _read(self) -> None:
        segment: ClockSegment | None = None
        try:
            while packet := self._end.recv(_PACKET_BYTES):
                segment = _continue.decode(packet).segment
        except BlockingIOError:
            if segment is not None:
                self._follow(segment)
            return
        except ProcessMessageError as error:
            sys.stderr.write(f"clock: {error}\n")
            return
        except OSError:
            pass
        self._continue_alone()

    def _follow(self, segment: ClockSegment) -> None:
        self._loop.follow(segment)
        if self._progress is None and math.isfinite(segment.holds_s):
            self._progress = ClockProgressReporter(loop=self._loop, report=self._send)

    def _send(self, run_s: float) -> None:
        try:
            self._end.send(_reached.encode(ProgressReached(run_s)))
        except OSError:
            return  # A closed socket is detected by reading; a leader that hangs misses reports.

    def _continue_alone(self) -> None:
        self.close()
        rate = max(1.0, self._loop.segment.rate)
        self._loop.follow(ClockSegment(time.monotonic(), self._loop.time(), rate))
