"""The state of a run: its stage, its decisive events, and whether the flight has to end."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Literal

from wil_campaign.orchestrator.run_results.result_parts import DropOut
from wil_campaign.orchestrator.state.faults import FaultLog, InternalFault, InternalFaults
from wil_campaign.safety.model.verdict import EXCEPTION, DecisiveEvent, DecisiveKind

Stage = Literal[
    "start",
    "identify",
    "ready",
    "arm",
    "takeoff",
    "at_height",
    "goal",
    "done",
    "land",
    "landed",
    "end",
]
StageWatcher = Callable[[Stage, float], None]
DecisiveWatcher = Callable[[DecisiveEvent], None]
DropOutWatcher = Callable[[str, DropOut], None]


class FlightError(Exception):
    """A stage of the run that failed; the message says for which vehicle and why."""


class RunState:
    """The state of a run: stages, decisive events, faults; every part reports here.

    `over` is set when a decisive event ends the flight early. During an operator's hold that waits
    for the release: the operator wants to inspect the situation. The exception of a watcher decides
    the run, and the other watchers are still called. log_fault: called with each internal
    exception; `faults` lists them all.
    """

    def __init__(self, *, time: Callable[[], float], log_fault: FaultLog = lambda _: None) -> None:
        self.time = time
        self._faults = InternalFaults(time=time, log=log_fault, take=self._decide_fault)
        self._deciding_faults = 0
        self.stage: Stage = "start"
        self.entered_s: dict[Stage, float] = {"start": time()}
        self.decisive: list[DecisiveEvent] = []
        self.over = asyncio.Event()
        self.note_at: Callable[[float], str] = lambda _: ""
        """Returns the note of the judged vehicle's autonomy at a time; set once there are
        vehicles."""
        self.autonomy_folders: set[Path] = set()
        """Folders of the code under test: what it raises beside its calls is its failure."""
        self.step_files: frozenset[Path] = frozenset()
        """Files of the recipe's own steps, which may stand in those folders."""
        self.environment: dict[str, str] = {}
        """What observers add to the environment of the run's programs."""
        self._is_held = False
        self.holds = 0
        """How often the operator has held the run."""
        self._is_end_due = False
        self._stage_watchers: list[StageWatcher] = []
        self._entries: dict[Stage, asyncio.Event] = {}
        self._decisive_watchers: list[DecisiveWatcher] = []
        self.dropped_out: dict[str, DropOut] = {}
        """Vehicles that dropped out while the others fly on, by name."""
        self._drop_out_watchers: list[DropOutWatcher] = []

    def on_stage(self, watcher: StageWatcher) -> None:
        """Call `watcher(stage, t_s)` at each entry of the run into a stage."""
        self._stage_watchers.append(watcher)

    def on_decisive(self, watcher: DecisiveWatcher) -> None:
        """Call `watcher(event)` at each decisive event of the run."""
        self._decisive_watchers.append(watcher)

    def on_drop_out(self, watcher: DropOutWatcher) -> None:
        """Call `watcher(vehicle, drop_out)` when a vehicle drops out from now on."""
        self._drop_out_watchers.append(watcher)

    def drop_out(self, vehicle: str, reason: str) -> None:
        """Record that a vehicle dropped out and the others fly on; the first call counts."""
        if vehicle in self.dropped_out:
            return
        self.dropped_out[vehicle] = left = DropOut(self.time(), reason)
        for watcher in tuple(self._drop_out_watchers):
            with self.recording_faults(f"the drop-out of {vehicle}"):
                watcher(vehicle, left)

    @contextmanager
    def watching_drop_out(self, vehicle: str, end: Callable[[], None]) -> Iterator[None]:
        """Call `end` when a vehicle drops out within the context."""

        def watcher(name: str, _: DropOut) -> None:
            if name == vehicle:
                end()

        self._drop_out_watchers.append(watcher)
        try:
            yield
        finally:
            self._drop_out_watchers.remove(watcher)

    def enter(self, stage: Stage) -> float:
        """Enter a stage of the run now; return the time."""
        now_s = self.time()
        self.stage = stage
        self.entered_s[stage] = now_s
        if stage in self._entries:
            self._entries[stage].set()
        for watcher in self._stage_watchers:
            with self.recording_faults(f"stage {stage}"):
                watcher(stage, now_s)
        return now_s

    def reached(self, stage: Stage) -> bool:
        """Return whether the run has entered a stage."""
        return stage in self.entered_s

    async def reaching(self, stage: Stage) -> None:
        """Wait until the run has entered a stage."""
        if not self.reached(stage):
            await self._entries.setdefault(stage, asyncio.Event()).wait()

    def decide(
        self,
        kind: DecisiveKind,
        reason: str,
        *,
        t_s: float | None = None,
        source: str = "",
        trace: str = "",
        ends_flight: bool = True,
    ) -> None:
        """Record a decisive event. ends_flight: whether the run's vehicles have to land.

        trace: the traceback of an exception, for the log and the result.
        """
        at_s = self.time() if t_s is None else t_s
        event = DecisiveEvent(at_s, kind, reason, source, self.note_at(at_s), trace)
        self.decisive.append(event)
        if ends_flight and self._is_held:
            self._is_end_due = True
        elif ends_flight:
            self.over.set()
        if self._deciding_faults > 1:
            return  # Else a watcher that always raises would be called without end.
        for watcher in self._decisive_watchers:
            with self.recording_faults("a watcher of decisive events"):
                watcher(event)

    @property
    def faults(self) -> tuple[InternalFault, ...]:
        """Return the internal exceptions of the run so far."""
        return tuple(self._faults.all)

    def fault(self, error: BaseException, where: str) -> None:
        """Record an internal exception, once: it decides the run as ERROR."""
        self._faults.record(error, where)

    def recording_faults(self, where: str) -> AbstractContextManager[None]:
        """Record an exception raised within as the run's fault, and suppress it."""
        return self._faults.recording(where)

    def _decide_fault(self, fault: InternalFault) -> None:
        self._deciding_faults += 1
        try:
            self.decide("ERROR", fault.text, source=EXCEPTION)
        finally:
            self._deciding_faults -= 1

    @property
    def held(self) -> bool:
        """Return whether the operator holds the run."""
        return self._is_held

    def hold(self) -> None:
        """Begin an operator's hold: no decisive event ends the flight until `release`."""
        self._is_held = True
        self.holds += 1

    def release(self) -> None:
        """End the hold; a decisive event that was to end the flight meanwhile does so now."""
        self._is_held = False
        if self._is_end_due:
            self.over.set()
