"""The orchestrator's side of a guard in another process: what `LocalGuard` is in this one."""

import asyncio
import math
import os
import socket
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from typing import Self

from wil_campaign.foundation.clocks.paced_loop import call_wall_later
from wil_campaign.foundation.processes.feed_socket import feed_environment, feed_pair
from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.foundation.tasks import (
    SuppressedErrors,
    report_task_error,
    start_task,
    stop_tasks,
)
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.stopping import AccelerationEstimate, VehicleMotion
from wil_campaign.safety.guard.core.commands import Command, NewFences, OrchestratorAlive
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import GuardEvent, is_about_fences
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.safety.guard.local_guard import Record
from wil_campaign.safety.guard.process.channel import GuardChannel
from wil_campaign.safety.guard.process.channel_link import ChannelLink
from wil_campaign.safety.guard.process.guard_config import GuardConfig
from wil_campaign.safety.guard.process.guard_launch import LaunchedGuard, spawn_guard
from wil_campaign.safety.guard.process.guard_stderr import guard_stderr_tail, remove_empty_stderr
from wil_campaign.safety.guard.process.messages import (
    ClockPace,
    ConfigMessage,
    EndGuard,
    EventMessage,
    FollowClock,
    FrameBytes,
    FrameSent,
    GuardFailed,
    GuardStatus,
    LinksOpened,
    OrchestratorReached,
    StartVehicle,
    ToOrchestrator,
    UnreadBytes,
    VehicleEnded,
    VehiclePosition,
    VehicleStarted,
    to_orchestrator,
)
from wil_campaign.safety.guard.process.orphaned_links import OrphanedLinks, orphaned_link_maker
from wil_campaign.safety.guard.process.remote_clock import RemoteClock
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.links.link import Link, LinkError

ALIVE_S = 0.1
_OPEN_S = 20.0
_START_S = 10.0
_END_S = 15.0
_CHECK_S = 0.2
_MOST_SILENT_CHECKS = 10
"""Of our own turns, not of time: a machine that was asleep must not make us kill our guard."""
_POLL_S = 0.1
_LATEST_S = 0.06
"""How long a position that is no breach, and a sign of life, wait for a packet to ride with."""


class GuardFailedError(Exception):
    """An exception in the remote guard's process; holds what it wrote to stderr."""


class RemoteGuard(Guard):
    """The guard in its own process: starts it, talks to it; an async context manager.

    record: gets the commands that went to a vehicle, with the time of the wire; all frames are in
    the .tlog files, which the guard itself writes. fed: vehicles whose process will inherit a
    socket to this one, see `feed`. Leaving ends vehicles and guard: land before
    that. A guard that dies is reported as an event of kind `guard`; `all_down` then waits for the
    autopilots' own failsafes.
    """

    def __init__(
        self,
        *,
        guard_config: GuardConfig,
        record: Record | None = None,
        fed: Collection[str] = (),
    ) -> None:
        super().__init__()
        self._guard_config = guard_config
        self._fed = tuple(fed)
        self._feeds: dict[str, tuple[socket.socket, int]] = {}
        self._record = record
        self._names = tuple(guard_config.vehicles)
        self._links = {
            name: ChannelLink(
                name=f"{name} {guard_config.vehicles[name].link or 'guard'}",
                index=index,
                last=guard_config.vehicles[name].vehicle.limits is not None,
            )
            for index, name in enumerate(self._names)
        }
        self._accelerations = {name: AccelerationEstimate() for name in self._names}
        self._fences = {
            name: vehicle.vehicle.fence
            for name, vehicle in guard_config.vehicles.items()
            if vehicle.vehicle.fence is not None
        }
        """That hold: a position that breaches one does not wait."""
        self._requested_fences: deque[Mapping[str, Fence]] = deque()
        """That the guard was asked to take and has not answered, oldest first; empty for a mere
        proposal. A position that breaches one does not wait either."""
        self._phases = dict.fromkeys(self._names, ContingencyPhase.IDLE)
        self._gone = False
        self._ending = False
        self._silent_checks = 0
        self._ports: dict[str, int] = {}
        self._received: set[str] = set()
        self._children: dict[str, ProcessId] = {}
        self._ended: dict[str, VehicleEnded] = {}
        self._endings: dict[str, asyncio.Event] = {}
        self._waiting: dict[str, asyncio.Future[ToOrchestrator]] = {}
        self._beating: asyncio.Handle | None = None
        self._checking: asyncio.Handle | None = None
        self._clock = RemoteClock(
            report=lambda run_s: self._channel.send(OrchestratorReached(run_s))
        )
        self._aftermath: asyncio.Task[None] | None = None

    @property
    def phases(self) -> dict[str, ContingencyPhase]:
        """Return the remote guard's contingency phases, a tenth of a second old at most."""
        return dict(self._phases)

    @property
    def pid(self) -> int:
        """Return the remote guard's process id."""
        return self._process.pid or 0

    def link(self, name: str) -> Link:
        """Return the link to a vehicle through the remote guard."""
        return self._links[name]

    def port(self, name: str) -> int:
        """Return the remote guard's UDP port for a vehicle; 0 for a link without one."""
        return self._ports[name]

    def feed(self, name: str) -> socket.socket:
        """Return our end of a vehicle's feed; it is closed with the guard."""
        return self._feeds[name][0]

    async def __aenter__(self) -> Self:
        """Start the guard process and wait until its links are open. Raises LinkError."""
        opened: asyncio.Future[ToOrchestrator] = asyncio.get_running_loop().create_future()
        self._waiting[""] = opened
        spawned = self._spawn()
        self._process, self._hold, self._stderr = spawned.process, spawned.hold, spawned.stderr
        self._channel = GuardChannel(
            spawned.end, receives=to_orchestrator, take=self._take, closed=self._on_guard_lost
        )
        for link in self._links.values():
            link.channel = self._channel
        self._channel.open()
        try:
            self._channel.send(ConfigMessage(self._guard_config.packed()))
            async with asyncio.timeout(_OPEN_S):
                answer = await opened
        except BaseException as error:
            # Nothing flies yet. Left alone, it would keep the ports of its links for minutes.
            self._ending = True
            self._process.kill()
            await self._end_process()
            if not isinstance(error, TimeoutError):
                raise
            raise LinkError(f"the guard did not open its links in {_OPEN_S:g} s") from error
        if not isinstance(answer, LinksOpened):
            self._ending = True
            await self._end_process()
            reason = answer.text if isinstance(answer, GuardFailed) else ""
            raise LinkError(reason or guard_stderr_tail(self._guard_config.folder))
        self._ports = dict(zip(self._names, answer.ports, strict=True))
        self._beat()
        self._check()
        return self

    async def __aexit__(self, *_: object) -> None:
        """End the vehicles, then the remote guard."""
        self._ending = True
        for timer in (self._beating, self._checking):
            if timer is not None:
                timer.cancel()
        try:
            if self._aftermath is not None:
                await stop_tasks(self._aftermath)
        finally:
            self._channel.send(EndGuard())
            try:
                await self._end_process()
            finally:
                await self._reap()
        if (self._process.exit_code or 0) > 0:
            report_task_error(
                GuardFailedError(guard_stderr_tail(self._guard_config.folder)), "the guard"
            )

    def follow(self) -> None:
        """Have the remote guard's scaled clock follow the leading vehicle."""
        if self._guard_config.pace is not None:
            self._channel.send(FollowClock())

    def position(self, sample: PoseSample) -> None:
        """Send the remote guard a vehicle's position, from the fastest source there is."""
        index = self._names.index(sample.vehicle)
        pose = sample.pose
        message = VehiclePosition(
            index, sample.t_s, pose.position_ned_m, pose.q_wxyz, sample.velocity_ned_m_s
        )
        if self._is_urgent(sample):
            self._channel.send(message, replaces=index)
        else:
            self._channel.send_soon(message, key=index, within_s=_LATEST_S)

    def send(self, command: Command) -> None:
        """Send the remote guard a command; later signs of life are sent from the event loop."""
        if isinstance(command, OrchestratorAlive):
            self._channel.send_soon(command, key=OrchestratorAlive, within_s=_LATEST_S)
            return
        if isinstance(command, NewFences):
            self._requested_fences.append({} if command.proposed else command.fences)
        self._channel.send(command)

    def _spawn(self) -> LaunchedGuard:
        """Launch the guard process, with the far ends of the vehicles' feeds. Raises LinkError."""
        pairs = {name: feed_pair() for name in self._fed}
        self._feeds = {name: (ours, theirs.fileno()) for name, (ours, theirs) in pairs.items()}
        try:
            return spawn_guard(
                self._guard_config.folder,
                scaled=self._guard_config.pace is not None,
                passed=[theirs.fileno() for _, theirs in pairs.values()],
            )
        except LinkError:
            self._close_feeds()
            raise
        finally:
            for _, theirs in pairs.values():
                theirs.close()

    def _close_feeds(self) -> None:
        for ours, _ in self._feeds.values():
            ours.close()

    async def start(
        self, name: str, argv: Sequence[str], environment: Mapping[str, str] | None = None
    ) -> int:
        """Have the remote guard start a vehicle's process; return its process id.

        Raises LinkError when it cannot be started.
        """
        started: asyncio.Future[ToOrchestrator] = asyncio.get_running_loop().create_future()
        self._waiting[name] = started
        inherited = (self._feeds[name][1],) if name in self._feeds else ()
        variables = {**(environment or {}), **(feed_environment(*inherited) if inherited else {})}
        self._channel.send(StartVehicle(name, tuple(argv), variables, inherited))
        try:
            async with asyncio.timeout(_START_S):
                answer = await started
        except TimeoutError as error:
            raise LinkError(f"{name}: the guard did not start it in {_START_S:g} s") from error
        if not isinstance(answer, VehicleStarted):
            reason = answer.last_output if isinstance(answer, VehicleEnded) else "the guard ended"
            raise LinkError(f"{name} could not be started: {reason}")
        return answer.pid

    async def ended_or(self, name: str, sign: "asyncio.Task[object]", timeout_s: float) -> None:
        """Wait for a sign of life of a child vehicle. Raises LinkError at its end."""
        end = self._endings.setdefault(name, asyncio.Event())
        ended = start_task(end.wait(), name=f"end of {name}")
        try:
            await asyncio.wait(
                {sign, ended}, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED
            )
        finally:
            await stop_tasks(ended)
        if sign.done():
            return
        how = self._ended.get(name)
        reason = f"it reported nothing for {timeout_s:g} s" if how is None else how.last_output
        code = "" if how is None else f" (exit status {how.exit_code})"
        raise LinkError(f"{name} did not start{code}: {reason or 'it printed nothing'}")

    async def end_of(self, name: str) -> int | None:
        """Wait for the end of a vehicle's process under the guard; return its exit code."""
        await self._endings.setdefault(name, asyncio.Event()).wait()
        return self._ended[name].exit_code

    def ended(self, name: str) -> VehicleEnded | None:
        """Return how a vehicle's process under the guard ended; None while it lives."""
        return self._ended.get(name)

    def _is_urgent(self, sample: PoseSample) -> bool:
        """Return whether a position may breach a fence, so the guard gets it at once."""
        settings, place = self._guard_config.settings, sample.pose.position_ned_m
        velocity = sample.velocity_ned_m_s
        if not math.isfinite(sum(place) + sum(velocity)):
            return True
        acceleration = self._accelerations[sample.vehicle].update(velocity, sample.t_s)
        motion = VehicleMotion(place, velocity, acceleration)
        requested = [self._fences, *self._requested_fences]
        return any(
            fences[sample.vehicle].breached(
                motion,
                latency_s=settings.latency_s,
                braking_m_s2=settings.braking_m_s2,
                keep_m=settings.keep_m,
            )
            for fences in requested
            if sample.vehicle in fences
        )

    def _beat(self) -> None:
        self.send(OrchestratorAlive())
        self._beating = call_wall_later(ALIVE_S, self._beat)

    def _check(self) -> None:
        """Kill a remote guard that has been silent for too long."""
        self._silent_checks += 1
        if self._silent_checks > _MOST_SILENT_CHECKS and not self._gone:
            self._process.kill()
            return
        self._checking = call_wall_later(_CHECK_S, self._check)

    def _take(self, message: ToOrchestrator) -> None:
        """Handle a message of the remote guard; the frequent ones first."""
        self._silent_checks = 0
        match message:
            case FrameBytes(index, t_s, data):
                name = self._names[index]
                self._received.add(name)
                self._links[name].arrive(data, t_s)
            case FrameSent(index, t_s, frame):
                if self._record is not None:
                    self._record(self._names[index], t_s, frame)
            case GuardStatus(_, all_down, at_rest, phases):
                self._phases = dict(zip(self._names, phases, strict=True))
                self._show(at_rest=at_rest, all_down=all_down)
            case EventMessage(event):
                self._dispatch_event(event)
            case ClockPace():
                self._clock.take(message)
            case _:
                self._receive_rare(message)

    def _receive_rare(self, message: ToOrchestrator) -> None:
        match message:
            case UnreadBytes(index, arrived_s):
                name = self._names[index]
                self._received.add(name)
                self._links[name].arrived_unread(arrived_s)
                now_s = asyncio.get_running_loop().time()
                self._dispatch_event(GuardEvent(now_s, "unread", name, f"{name}: {message}"))
            case VehicleStarted(name, pid):
                if (known := ProcessId.of(pid)) is not None:
                    self._children[name] = known
                self._answer(name, message)
            case VehicleEnded(name):
                self._ended[name] = message
                self._endings.setdefault(name, asyncio.Event()).set()
                self._answer(name, message)
            case _:
                self._answer("", message)

    def _answer(self, name: str, message: ToOrchestrator) -> None:
        future = self._waiting.pop(name, None)
        if future is not None and not future.done():
            future.set_result(message)

    def _dispatch_event(self, event: GuardEvent) -> None:
        if self._requested_fences and is_about_fences(event):
            taken = self._requested_fences.popleft()
            if event.kind == "geofence":
                self._fences |= taken
        self._report(event)

    def _on_guard_lost(self) -> None:
        """Handle the unexpected end of the guard process."""
        self._gone = True
        self._clock.continue_alone()
        for name in tuple(self._waiting):
            self._answer(name, GuardFailed(""))
        if self._ending:
            return
        now_s = asyncio.get_running_loop().time()
        self._show(at_rest=False, all_down=False)
        self._aftermath = start_task(self._watch_failsafes(), name="after the guard")
        text = "the guard's process ended; the autopilots' own failsafes must act"
        self._dispatch_event(GuardEvent(now_s, "guard", "", text))

    async def _watch_failsafes(self) -> None:
        """Listen to the vehicles after the guard's loss until all are disarmed."""
        vehicles = self._guard_config.vehicles
        watched = {
            name: orphaned_link_maker(vehicle, self._ports[name])
            for name, vehicle in vehicles.items()
            if name in self._received and name not in self._ended
        }
        targets = {name: vehicles[name].vehicle.target for name in watched}
        async with OrphanedLinks(links=watched, targets=targets, received=self._receive) as links:
            # Driver and judge go on receiving until the run is over.
            while True:
                down = all(self._is_down(name, links) for name in watched)
                self._show(at_rest=down, all_down=down or self._down.is_set())
                await asyncio.sleep(_POLL_S)

    def _is_down(self, name: str, links: OrphanedLinks) -> bool:
        child = self._children.get(name)
        return links.armed.get(name) is False or (child is not None and not child.lives)

    def _receive(self, name: str, data: bytes, t_s: float) -> None:
        self._links[name].arrive(data, t_s)

    async def _end_process(self) -> None:
        """Wait for the guard process; one with a vehicle in the air is left to it."""
        if await self._process.wait(_END_S) is None:
            now_s = asyncio.get_running_loop().time()
            text = "the guard continues by itself: a vehicle is still in the air"
            if self._rest.is_set():
                text = "nothing is armed, but the guard's process does not end: a vehicle's "
                text += "process hangs, or the disk takes nothing of its log"
            self._dispatch_event(GuardEvent(now_s, "guard", "", text))
        self._process.release()
        if not self._process.running:
            with SuppressedErrors("the guard's last messages"):
                self._channel.read_rest()
        self._clock.continue_alone()
        self._close_feeds()
        self._channel.close()
        os.close(self._hold)
        self._stderr.close()
        remove_empty_stderr(self._guard_config.folder)

    async def _reap(self) -> None:
        """End the vehicle processes that a dead remote guard left."""
        if self._process.running:
            return
        left = [child for child in self._children.values() if child.lives]
        for child in left:
            await asyncio.to_thread(child.end)
