"""The base of a sensor with external readings: it opens, counts, reports stalls and freezing."""

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import replace

from wil_campaign.campaigns.values.external_setups import ShownAs
from wil_campaign.orchestrator.run_results.result_parts import SourceResult
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.readings import Reading, Source
from wil_campaign.vehicles.readings.copies import with_python_numbers
from wil_campaign.vehicles.readings.kinds import traits_of
from wil_campaign.vehicles.sources.camera_source import (
    ReadingSource,
    SourceCounts,
    SourceError,
    SourceStalledError,
)
from wil_campaign.vehicles.sources.readings.frozen_readings import FrozenReadings
from wil_campaign.worlds.frames import Pose

Deliver = Callable[[Reading], None]


class ExternalSource:
    """A vehicle's sensor with external readings; a Stream of them.

    It is opened with the run, so that an unavailable source is known before the flight. `run`
    delivers the readings since its own beginning: a live source is open already, a recording
    starts then. A live sensor that repeats the same reading while its vehicle moves, or contradicts
    how it moves, counts as stalled, and those readings are not delivered. make: returns the source,
    not opened yet.
    """

    def __init__(
        self,
        *,
        sensor: str,
        shown_as: ShownAs,
        side: Source,
        make: Callable[[], ReadingSource[Reading]],
    ) -> None:
        self._sensor = sensor
        self._shown_as: ShownAs = shown_as
        self._side: Source = side
        self._make = make
        self._source: ReadingSource[Reading] | None = None
        self._stalled: Callable[[str], None] = lambda _: None
        self._stalls = 0
        self._trouble = ""
        self._before = SourceCounts()
        self._has_begun = False
        self._context: VehicleContext | None = None
        self._frozen = FrozenReadings()
        self._is_frozen = False
        self._contradiction: Callable[[Reading, Pose], str | None] | None = None
        self.is_converted = False
        """Whether the recipe converts its units or axes, so that they cannot be checked here."""

    def attach(self, context: VehicleContext) -> None:
        """Attach the vehicle whose sensor this is; before it is identified."""
        self._context = context

    async def open(self, stack: AsyncExitStack) -> None:
        """Open an external source, live or recorded. Raises SourceError."""
        source = self._make()
        if source.kind == "live":
            self._source = await stack.enter_async_context(source)
        else:
            async with source:
                pass

    def on_stall(self, stalled: Callable[[str], None]) -> None:
        """Call `stalled` with the reason whenever the source delivers nothing for too long."""
        self._stalled = stalled

    async def run(self, deliver: Deliver) -> None:
        """Deliver the external readings until cancelled. Raises SourceError at their end."""
        try:
            if self._source is not None:
                await self._run(self._source, deliver)
                return
            async with self._make() as source:
                self._source = source
                await self._run(source, deliver)
        except SourceError as error:
            self._trouble = str(error)
            raise

    @property
    def result(self) -> SourceResult:
        """Return the counts of the external readings since `run` began."""
        counts = self._counts()
        return SourceResult(
            vehicle=str(self._side),
            sensor=self._sensor,
            source=self._shown_as,
            delivered=counts.delivered,
            dropped=counts.dropped,
            missed=counts.missed,
            damaged=counts.damaged,
            stalls=self._stalls,
            trouble=self._trouble,
            restarts=counts.restarts,
        )

    def _stall(self, why: str, *, again: bool = False) -> None:
        """Count and report that the source delivers nothing usable. again: the stall continues."""
        self._stalls += not again
        self._trouble = why
        sensor = f"{self._side} {self._sensor}"  # some sources name it themselves
        self._stalled(why if why.startswith(f"{sensor} ") else f"{sensor}: {why}")

    async def _run(self, source: ReadingSource[Reading], deliver: Deliver) -> None:
        since_s, is_silent = asyncio.get_running_loop().time(), False
        while True:
            try:
                async for received in source:
                    is_silent = False
                    if received.arrived_s < since_s:
                        continue
                    reading = with_python_numbers(received)  # NumPy's cannot be recorded
                    self._begin_counting(source.counts)
                    if source.kind == "file" or not self._report_frozen(reading):
                        deliver(reading)
            except SourceStalledError as error:
                self._stall(str(error), again=is_silent)
                is_silent = True
            else:
                raise SourceError(f"{source.name}: the recording is over")

    def _report_frozen(self, reading: Reading) -> bool:
        """Return whether a live sensor is frozen or contradicts; report it as stalled then."""
        pose = None if self._context is None else self._context.poses.at(reading.t_s).pose
        fault = self._frozen.receive(reading, pose) or self._contradicted(reading, pose)
        if fault is not None:
            self._stall(fault, again=self._is_frozen)
        self._is_frozen = fault is not None
        return self._is_frozen

    def _contradicted(self, reading: Reading, pose: Pose | None) -> str | None:
        make = traits_of(type(reading)).in_flight
        if make is None or pose is None or self.is_converted:
            return None
        if self._contradiction is None:
            self._contradiction = make()
        return self._contradiction(reading, pose)

    def _begin_counting(self, counts: SourceCounts) -> None:
        """Exclude readings before the first delivered one from the counts."""
        if not self._has_begun:
            self._has_begun = True
            self._before = replace(counts, delivered=counts.delivered - 1)

    def _counts(self) -> SourceCounts:
        if self._source is None or not self._has_begun:
            return SourceCounts()
        counts, before = self._source.counts, self._before
        return SourceCounts(
            delivered=counts.delivered - before.delivered,
            dropped=counts.dropped - before.dropped,
            missed=counts.missed - before.missed,
            damaged=counts.damaged - before.damaged,
            restarts=counts.restarts - before.restarts,
        )
