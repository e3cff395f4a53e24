"""The guard in this process: connects links, ticks and records to the pure core.

It works on any event loop: runs in virtual time and in wall time use the same guard.
"""

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import Self

from wil_campaign.foundation.tasks import FAULTS, report_task_error
from wil_campaign.safety.guard.core.commands import CoreMessage, StartOutage
from wil_campaign.safety.guard.core.contingency import ContingencyPhase, ContingencyPlan
from wil_campaign.safety.guard.core.events import (
    GuardedVehicle,
    GuardEvent,
    GuardSettings,
    Outputs,
    ToOrchestrator,
    ToVehicle,
    unrecorded_event,
)
from wil_campaign.safety.guard.core.guard_core import GuardCore
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.links.link import Link, Receiver
from wil_campaign.vehicles.links.link_conditions import Interruptible
from wil_campaign.worlds.frames import Vec3

TICK_HZ = 20.0
_LOGGED = (ToOrchestrator, ToVehicle)

Record = Callable[[str, float, bytes], None]
"""Records a frame: the vehicle's name, the time on the run clock, one whole frame."""


@dataclass(frozen=True, slots=True)
class GuardLinks:
    """The local guard's links for one vehicle. impaired: the link that can have outages."""

    vehicle: Link
    orchestrator: Link
    gcs: Link | None = None
    impaired: Interruptible | None = None


class LocalGuard(Guard):
    """The guard inside this process: holds the vehicle links; an async context manager.

    The frames of a decision are sent before anything is recorded or reported. `record` gets every
    frame from and to a vehicle; if it raises OSError the guard goes on without it for this vehicle,
    and an event reports it. early_s: by how much a tick may come early, together with a vehicle's
    frame: the process then wakes once for both. ticked: called after each tick.
    """

    def __init__(
        self,
        *,
        vehicles: Mapping[str, GuardedVehicle],
        links: Mapping[str, GuardLinks],
        settings: GuardSettings | None = None,
        plan: ContingencyPlan | None = None,
        record: Record | None = None,
        early_s: float = 0.0,
        ticked: Callable[[], None] | None = None,
    ) -> None:
        if vehicles.keys() != links.keys():
            raise ValueError(f"vehicles {sorted(vehicles)} and links {sorted(links)} differ")
        super().__init__()
        self.core = GuardCore(vehicles=vehicles, settings=settings, plan=plan)
        self._links = dict(links)
        self._with_gcs = frozenset(name for name, vehicle in vehicles.items() if vehicle.gcs)
        self._record = record
        self._unrecorded: set[str] = set()
        self._stack = AsyncExitStack()
        self._early_s = early_s
        self._ticked = ticked
        self._timer: asyncio.TimerHandle | None = None
        self._next_count = 0
        self._earliest_s = math.inf
        """From when on a frame triggers the next tick."""
        self._start_s = 0.0

    @property
    def started_s(self) -> float:
        """Return the loop's time at which the local guard's ticks began."""
        return self._start_s

    @property
    def phases(self) -> dict[str, ContingencyPhase]:
        """Return the contingency phase of each vehicle in the local guard."""
        return self.core.phases

    async def __aenter__(self) -> Self:
        """Open the local guard's links and start ticks. Raises LinkError."""
        async with AsyncExitStack() as stack:
            for name, ends in self._links.items():
                ends.vehicle.receive(self._vehicle_receiver(name, ends))
                ends.orchestrator.receive(self._receiver(self.core.from_orchestrator, name))
                if ends.gcs is not None:
                    ends.gcs.receive(self._receiver(self.core.from_gcs, name))
                for link in (ends.orchestrator, ends.gcs, ends.vehicle):
                    if link is not None:
                        await stack.enter_async_context(link)
            self._stack = stack.pop_all()
        self._start_s = asyncio.get_running_loop().time()
        self._schedule(1)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Stop the local guard's ticks and close its links; land before that."""
        self._earliest_s = math.inf
        if self._timer is not None:
            self._timer.cancel()
        await self._stack.aclose()

    def position(self, sample: PoseSample) -> None:
        """Give the local guard a vehicle's position, from the fastest available source."""
        self._apply(self.core.position(sample), sample.t_s)

    def place(self, name: str, position_ned_m: Vec3, velocity_ned_m_s: Vec3, t_s: float) -> None:
        """Give the local guard a vehicle's position in the world, as `position` does."""
        self._apply(self.core.place(name, position_ned_m, velocity_ned_m_s, t_s), t_s)

    def send(self, command: CoreMessage | StartOutage) -> None:
        """Execute a command, or act on what the guard's process found."""
        if isinstance(command, StartOutage):
            self._start_outage(command)
        else:
            now_s = self._now_s()
            self._apply(self.core.apply(command, now_s), now_s)

    def _start_outage(self, outage: StartOutage) -> None:
        impaired = self._links[outage.vehicle].impaired
        if impaired is None:
            raise ValueError(f"the link of {outage.vehicle} does not support outages")
        impaired.start_outage(outage.duration_s)

    def _receiver(self, take: Callable[[str, bytes, float], Outputs], name: str) -> Receiver:
        def receive(data: bytes, t_s: float) -> None:
            self._apply(take(name, data, t_s), t_s)

        return receive

    def _vehicle_receiver(self, name: str, ends: GuardLinks) -> Receiver:
        """Return the receiver of a vehicle's bytes: it forwards frames, then judges them.

        No result of judging holds a vehicle's frame back, so that forwarding comes first.
        """
        core, record = self.core, self._record_frames
        orchestrator, gcs = ends.orchestrator, ends.gcs if name in self._with_gcs else None

        def receive(data: bytes, t_s: float) -> None:
            frames = core.split_from_vehicle(name, data)
            if not frames:
                return
            raw = [frame.raw for frame in frames]
            forwarded = raw[0] if len(raw) == 1 else b"".join(raw)
            orchestrator.write(forwarded)
            if gcs is not None:
                gcs.write(forwarded)
            outputs = core.judge_vehicle(name, frames, t_s)
            if outputs:
                self._write_all(outputs)
            trouble = record(name, t_s, raw)
            if outputs or trouble:
                self._note_all(outputs, t_s, trouble)
            if t_s >= self._earliest_s:
                self._tick_early()

        return receive

    def _schedule(self, count: int) -> None:
        loop = asyncio.get_running_loop()
        # Ticks that were missed while the loop stalled are skipped.
        count = max(count, int((loop.time() - self._start_s) * TICK_HZ + 1e-6) + 1)
        at_s = self._start_s + count / TICK_HZ
        self._next_count = count
        self._earliest_s = at_s - self._early_s if self._early_s else math.inf
        self._timer = loop.call_at(at_s, self._tick, count)

    def _tick_early(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._tick(self._next_count)

    def _tick(self, count: int) -> None:
        self._schedule(count + 1)
        now_s = self._now_s()
        self._apply(self.core.tick(now_s), now_s)
        self._show(at_rest=not self.core.may_be_armed(now_s), all_down=self.core.all_down)
        if self._ticked is not None:
            self._ticked()

    def _apply(self, outputs: Outputs, t_s: float) -> None:
        if outputs:
            self._write_all(outputs)
            self._note_all(outputs, t_s, [])

    def _write_all(self, outputs: Outputs) -> None:
        for output in outputs:
            if not isinstance(output, GuardEvent):
                ends, frames = self._links[output.name], output.frames
                data = frames[0] if len(frames) == 1 else b"".join(frames)
                if isinstance(output, ToVehicle):
                    ends.vehicle.write(data)
                elif isinstance(output, ToOrchestrator):
                    ends.orchestrator.write(data)
                elif ends.gcs is not None:
                    ends.gcs.write(data)

    def _note_all(self, outputs: Outputs, t_s: float, trouble: list[GuardEvent]) -> None:
        """Record the frames of a decision; then report its events and failures to record."""
        events: list[GuardEvent] = []
        for output in outputs:
            if isinstance(output, GuardEvent):
                events.append(output)
            elif isinstance(output, _LOGGED):
                trouble = [*trouble, *self._record_frames(output.name, t_s, output.frames)]
        for event in (*events, *trouble):
            self._report(event)

    def _record_frames(self, name: str, t_s: float, frames: Sequence[bytes]) -> list[GuardEvent]:
        """Record frames; return an event with the reason if the vehicle's recording ends now.

        A programming error in `record` is reported, and the flight continues.
        """
        record = self._record
        if record is None or name in self._unrecorded:
            return []
        try:
            for frame in frames:
                record(name, t_s, frame)
        except OSError as error:
            self._unrecorded.add(name)
            return [unrecorded_event(name, t_s, error)]
        except FAULTS as error:
            report_task_error(error, "the record of frames")
        return []

    @staticmethod
    def _now_s() -> float:
        return asyncio.get_running_loop().time()
