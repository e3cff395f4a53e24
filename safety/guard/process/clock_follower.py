"""Keeps the guard's clock with the time of a simulated vehicle, under the scaled clock.

Time is read beneath a campaign's bad radio: a simulator's pace is no part of the link that is
tested. A simulator whose time stands still for seconds hangs, and one whose time leaves that of
the other is not flying the same flight: both end the run, in words.
"""

import asyncio
import struct
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

from vehicles.clocks.sim_clock_controller import (
    STALL_S,
    STEP_S,
    BootTrack,
    ClockDivergence,
    Segment,
    SimClockController,
)
from vehicles.links.link import Link
from vehicles.links.tapped import TappedLink
from vehicles.mavlink.framing import Frame, FrameSplitter

_BOOT_MS_AT = {2: 8, 30: 0, 32: 0, 33: 0}
"""Where time_boot_ms is in SYSTEM_TIME, ATTITUDE, LOCAL_POSITION_NED and GLOBAL_POSITION_INT."""
_u32 = struct.Struct("<I")

Trouble = Literal["stalled", "apart"]


class PacedClock(Protocol):
    """The controlled clock (protocol) that follows a vehicle's time: a `PacedLoop`."""

    @property
    def segment(self) -> Segment:
        """Return the segment of the followed clock that holds now."""

    def follow(self, segment: Segment) -> None:
        """Continue the clock by another segment."""

    def call_wall_later(self, delay_s: float, callback: Callable[[], object]) -> asyncio.Handle:
        """Call after so much wall time, whatever the followed clock says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PaceSetup:
    """The pace of the scaled clock. nominal: times real time. leader: whose time it follows.

    follows_us: the leader has no pace of its own, but is told the run clock.
    """

    nominal: float
    leader: str
    follows_us: bool


class ClockFollower:
    """Makes the paced loop's clock follow a vehicle; reports its segments and problems.

    systems: of the vehicles, by name. wall: CLOCK_MONOTONIC. trouble: called with a vehicle, what
    it is, and that in words; once for each vehicle.
    """

    def __init__(
        self,
        *,
        setup: PaceSetup,
        systems: Mapping[str, int],
        loop: PacedClock,
        tell: Callable[[Segment], None],
        trouble: Callable[[str, Trouble, str], None],
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        self._setup = setup
        self._systems = systems
        self._loop = loop
        self._tell = tell
        self._trouble = trouble
        self._wall = wall
        self._steering = SimClockController(nominal=setup.nominal, follows_us=setup.follows_us)
        self._tracks = {
            name: self._steering.track if name == setup.leader else BootTrack() for name in systems
        }
        self._apart = {name: ClockDivergence() for name in systems if name != setup.leader}
        self._reported: set[str] = set()
        self._begun: Segment | None = None

    def tap(self, name: str, link: Link) -> Link:
        """Return a vehicle's link that the clock follower listens to as well."""
        tapped, frames = TappedLink(link), FrameSplitter()
        system, track = self._systems[name], self._tracks[name]

        def hear(data: bytes, _: float) -> None:
            wall_s = self._wall()
            for frame in frames.feed(data):
                if frame.system == system and frame.message_id in _BOOT_MS_AT:
                    track.received(wall_s, boot_s_of(frame))

        tapped.tap(hear)
        return tapped

    def begin(self) -> None:
        """Start to follow the leader's clock: everything that had to be started runs."""
        if self._begun is None:
            now_s = self._wall()
            self._begun = Segment(now_s, self._loop.segment.at(now_s), self._loop.segment.rate)
            self._steering.begin(self._begun)
            self._step()

    @property
    def pace(self) -> float | None:
        """Return how many times real time the clock ran since it follows; None before."""
        if self._begun is None:
            return None
        now_s = self._wall()
        span_s = max(now_s - self._begun.wall_s, STEP_S)
        return (self._steering.segment.at(now_s) - self._begun.run_s) / span_s

    def _step(self) -> None:
        wall_s = self._wall()
        segment = self._steering.step(wall_s)
        self._loop.follow(segment)
        self._tell(segment)
        self._loop.call_wall_later(STEP_S, self._step)
        leader = self._setup.leader
        if self._steering.stalled:
            self._publish_pace(
                leader,
                "stalled",
                f"{leader} stands still: its time has not advanced for {STALL_S:g} s; "
                "its simulator "
                "hangs, or was stopped",
            )
        elif self._steering.locked:
            for name in self._apart:
                self._look(name, wall_s, segment)

    def _look(self, name: str, wall_s: float, segment: Segment) -> None:
        apart, track = self._apart[name], self._tracks[name]
        if not apart.look(track, wall_s=wall_s, run_s=segment.run_s):
            return
        which = "ahead of" if apart.off_s > 0.0 else "behind"
        own = f"{track.line(wall_s)[1]:.1f}" if track.known else "?"
        self._publish_pace(
            name,
            "apart",
            f"the time of {name} is {abs(apart.off_s):.1f} s {which} that of {self._setup.leader}: "
            f"asked for {self._setup.nominal:g} times real time they attain {own} and "
            f"{segment.rate:.1f}; ask for less",
        )

    def _publish_pace(self, name: str, trouble: Trouble, text: str) -> None:
        if name not in self._reported:
            self._reported.add(name)
            self._trouble(name, trouble, text)


def boot_s_of(frame: Frame) -> float:
    """Return the time since boot in a frame of one of the messages that the clock follows."""
    at = _BOOT_MS_AT[frame.message_id]
    # MAVLink 2 leaves out zeros at the end.
    stamp: int = _u32.unpack(frame.payload.ljust(at + 4, b"\0")[at : at + 4])[0]
    return stamp / 1000.0
