"""The scaled run clock in the guard's process: it leads, orchestrator and vehicles follow."""

import asyncio
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from wil_campaign.foundation.clocks.sim_clock_controller import STALL_S, STEP_S, ClockSegment
from wil_campaign.foundation.processes.clock_socket import ClockSockets
from wil_campaign.safety.guard.core.commands import Trouble, VehicleGone
from wil_campaign.vehicles.links.link import Link


class PacedClock(Protocol):
    """The controlled clock (protocol) that follows a vehicle's time: a `PacedLoop`."""

    @property
    def segment(self) -> ClockSegment:
        """Return the segment of the followed clock that holds now."""

    def follow(self, segment: ClockSegment) -> None:
        """Continue the clock by another segment."""

    def call_wall_later(self, delay_s: float, callback: Callable[[], object]) -> asyncio.Handle:
        """Call after so much wall time, whatever the followed clock says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PaceSetup:
    """The pace of the scaled clock.

    nominal: times real time. leader: the simulation with a pace of its own whose time the clock
    follows; None where all vehicles follow the clock. followers: the vehicles whose processes do.
    launched: the simulations with a pace of their own, the leader among them.
    """

    nominal: float
    leader: str | None = None
    followers: tuple[str, ...] = ()
    launched: tuple[str, ...] = ()


class RunClock:
    """The base of what leads the run clock: a step every `STEP_S` of wall time.

    publish: sends the orchestrator a segment. trouble: called with what is wrong with a vehicle,
    once for each. wall: CLOCK_MONOTONIC.
    """

    def __init__(
        self,
        *,
        setup: PaceSetup,
        loop: PacedClock,
        publish: Callable[[ClockSegment], None],
        trouble: Callable[[Trouble], None],
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        self._setup = setup
        self._loop = loop
        self._publish = publish
        self._trouble = trouble
        self._wall = wall
        self._sockets = ClockSockets(reached=self.reached, left=self.leave)
        self._reported: set[str] = set()
        self._begun: ClockSegment | None = None

    def tap(self, name: str, link: Link) -> Link:  # noqa: ARG002 - for who listens
        """Return a vehicle's link, through which the run clock may listen."""
        return link

    def inherit(self, name: str) -> socket.socket | None:
        """Return the clock's socket for a vehicle's process to inherit; None where it has none."""
        return self._sockets.open(name) if name in self._setup.followers else None

    def begin(self) -> None:
        """Start to lead the run clock: everything that had to be started runs."""
        if self._begun is None:
            now_s = self._wall()
            self._begun = ClockSegment(now_s, self._loop.segment.at(now_s), self._loop.segment.rate)
            self._begin(self._begun)
            self._step()

    @property
    def pace(self) -> float | None:
        """Return how many times real time the clock ran since it is led; None before."""
        if self._begun is None:
            return None
        now_s = self._wall()
        span_s = max(now_s - self._begun.wall_s, STEP_S)
        return (self._loop.segment.at(now_s) - self._begun.run_s) / span_s

    def reached(self, name: str, run_s: float) -> None:
        """Take how far a process has come that follows the run clock."""

    def leave(self, name: str) -> None:
        """Take that a process has ended that followed the run clock."""

    def close(self) -> None:
        """Close the sockets to the vehicles' processes."""
        self._sockets.close()

    def _begin(self, segment: ClockSegment) -> None:
        """Start the run clock at the time of the wall clock."""
        raise NotImplementedError

    def _advance(self, wall_s: float) -> ClockSegment:
        raise NotImplementedError

    def _step(self) -> None:
        self._send(self._advance(self._wall()))
        self._loop.call_wall_later(STEP_S, self._step)

    def _send(self, segment: ClockSegment) -> None:
        self._loop.follow(segment)
        self._sockets.send(segment)
        self._publish(segment)

    def _report_stall(self, name: str) -> None:
        text = (
            f"the simulation of {name} hangs: its time has not advanced for "
            f"{STALL_S:g} s; the simulator hangs or was stopped"
        )
        self._report(VehicleGone(name, text))

    def _report(self, trouble: Trouble) -> None:
        if trouble.vehicle not in self._reported:
            self._reported.add(trouble.vehicle)
            self._trouble(trouble)
