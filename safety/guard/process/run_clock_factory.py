"""Which run clock the guard's process leads: lockstep, or that of a simulation's own pace.

Keeps the guard's clock with the time of a simulated vehicle, under the scaled clock.

Time is read beneath a campaign's bad radio: a simulator's pace is no part of the link that is
tested. A simulator whose time does not advance for seconds hangs, and one whose time leaves that of
the other is not flying the same flight: both end the run, in words.
"""

import asyncio
import struct
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from wil_campaign.foundation.clocks.pace_trim import PaceTrim
from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.clocks.sim_clock_controller import (
    BootTrack,
    ClockDivergence,
    ClockSegment,
    SimClockController,
)
from wil_campaign.safety.guard.core.commands import ClocksApart, Trouble
from wil_campaign.safety.guard.core.events import GuardedVehicle
from wil_campaign.safety.guard.process.channel import GuardChannel
from wil_campaign.safety.guard.process.guard_config import GuardConfig
from wil_campaign.safety.guard.process.lockstep_clock import LockstepClock
from wil_campaign.safety.guard.process.messages import ClockPace
from wil_campaign.safety.guard.process.run_clock import PacedClock, PaceSetup, RunClock
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import FrameSplitter, MavlinkFrame

_BOOT_MS_AT = {2: 8, 30: 0, 32: 0, 33: 0}
"""Where time_boot_ms is in SYSTEM_TIME, ATTITUDE, LOCAL_POSITION_NED and GLOBAL_POSITION_INT."""
_u32 = struct.Struct("<I")

PaceFrame = Callable[[float], bytes]
"""Returns the frame that tells a simulation its pace, times real time."""


class ClockFollower(RunClock):
    """A run clock that follows the time of a simulation with a pace of its own.

    leader: the vehicle that it simulates. systems: of the vehicles, by name. pace_frames: of the
    simulations whose pace can be set; they keep the time of one that cannot, else of the
    leader.
    """

    def __init__(
        self,
        *,
        setup: PaceSetup,
        leader: str,
        systems: Mapping[str, int],
        loop: PacedClock,
        publish: Callable[[ClockSegment], None],
        trouble: Callable[[Trouble], None],
        pace_frames: Mapping[str, PaceFrame] | None = None,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(setup=setup, loop=loop, publish=publish, trouble=trouble, wall=wall)
        self._leader = leader
        self._systems = systems
        self._controller = SimClockController(nominal=setup.nominal)
        self._tracks = {name: BootTrack(nominal=setup.nominal) for name in systems}
        self._tracks[leader] = self._controller.track
        self._apart = {name: ClockDivergence() for name in systems if name != leader}
        self._links: dict[str, Link] = {}
        self._pace_frames = dict(pace_frames or {})
        fixed = [name for name in setup.launched if name not in self._pace_frames]
        self._reference = leader if leader in fixed or not fixed else fixed[0]
        self._pace_frames.pop(self._reference, None)
        self._trims = {name: PaceTrim(nominal=setup.nominal) for name in self._pace_frames}

    def tap(self, name: str, link: Link) -> Link:
        """Return a vehicle's link that the clock follower listens to as well."""
        tapped, frames = TappedLink(link), FrameSplitter()
        self._links[name] = link
        system, track = self._systems[name], self._tracks[name]

        def receive(data: bytes, _: float) -> None:
            wall_s = self._wall()
            for frame in frames.feed(data):
                if frame.system == system and frame.message_id in _BOOT_MS_AT:
                    track.received(wall_s, boot_s_of(frame))

        tapped.tap(receive)
        return tapped

    def _begin(self, segment: ClockSegment) -> None:
        self._controller.begin(segment)

    def _advance(self, wall_s: float) -> ClockSegment:
        segment = self._controller.step(wall_s)
        if self._controller.stalled:
            self._report_stall(self._leader)
        elif self._controller.locked:
            for name in self._apart:
                self._look(name, wall_s, segment)
            self._trim(wall_s)
        return segment

    def _trim(self, wall_s: float) -> None:
        """Tell simulations the pace at which they keep the time of the one that they follow."""
        reference = self._tracks[self._reference]
        if not reference.known or reference.still_s(wall_s) > reference.ahead_s:
            return
        _, rate = reference.line(wall_s)
        for name, trim in self._trims.items():
            if name not in self._links or not self._tracks[name].known:
                continue
            ahead_s = self._off_s(name) - self._off_s(self._reference)
            pace = trim.update(wall_s=wall_s, ahead_s=ahead_s, rate=rate)
            if pace is not None:
                self._links[name].write(self._pace_frames[name](pace))

    def _off_s(self, name: str) -> float:
        """Return by how much a simulation's time is ahead of the run clock."""
        return self._apart[name].off_s if name in self._apart else 0.0

    def _look(self, name: str, wall_s: float, segment: ClockSegment) -> None:
        apart, track = self._apart[name], self._tracks[name]
        if not apart.look(track, wall_s=wall_s, run_s=segment.run_s):
            return
        which = "ahead of" if apart.off_s > 0.0 else "behind"
        own = f"{track.line(wall_s)[1]:.1f}" if track.known else "?"
        text = (
            f"the time of {name} is {abs(apart.off_s):.1f} s {which} that of {self._leader}: "
            f"asked for {self._setup.nominal:g} times real time they attain {own} and "
            f"{segment.rate:.1f}; ask for less"
        )
        self._report(ClocksApart(name, text))


def boot_s_of(frame: MavlinkFrame) -> float:
    """Return the time since boot in a frame of one of the messages that the clock follows."""
    at = _BOOT_MS_AT[frame.message_id]
    # MAVLink 2 leaves out zeros at the end.
    stamp: int = _u32.unpack(frame.payload.ljust(at + 4, b"\0")[at : at + 4])[0]
    return stamp / 1000.0


def run_clock_of(
    guard_config: GuardConfig,
    *,
    channel: GuardChannel[Any],
    trouble: Callable[[Trouble], None],
    took_over: Callable[[], bool],
) -> RunClock | None:
    """Return what leads the scaled clock; None under the wall clock.

    took_over: whether the guard has latched.
    """
    loop, setup = asyncio.get_running_loop(), guard_config.pace
    if setup is None or not isinstance(loop, PacedLoop):
        return None

    def publish(segment: ClockSegment) -> None:
        holds_s = None if setup.leader is not None else segment.holds_s
        channel.send(ClockPace(segment.wall_s, segment.run_s, segment.rate, holds_s))

    if setup.leader is None:
        return LockstepClock(
            setup=setup, loop=loop, publish=publish, trouble=trouble, took_over=took_over
        )
    return ClockFollower(
        setup=setup,
        leader=setup.leader,
        systems={
            name: vehicle.vehicle.target.system for name, vehicle in guard_config.vehicles.items()
        },
        pace_frames=_pace_frames(guard_config, setup.launched),
        loop=loop,
        publish=publish,
        trouble=trouble,
    )


def _pace_frames(guard_config: GuardConfig, launched: Iterable[str]) -> dict[str, PaceFrame]:
    """Return by name the frames that tell a launched simulation its pace, where it heeds one."""
    settings, frames = guard_config.settings, dict[str, PaceFrame]()
    for name in launched:
        vehicle = guard_config.vehicles[name].vehicle
        if vehicle.autopilot.heeds_pace:
            codec = MavlinkCodec(system_id=settings.system_id, component_id=settings.component_id)
            frames[name] = partial(_pace_frame, vehicle, codec)
    return frames


def _pace_frame(vehicle: GuardedVehicle, codec: MavlinkCodec, times_real_time: float) -> bytes:
    return codec.pack(vehicle.autopilot.set_simulation_pace(vehicle.target, times_real_time))
