"""Perception of a run: the vehicles' sensors, mixed by the recipe and delivered to runners.

What we draw is drawn for the autonomies: drawn images end soon after the last of them has ended.
"""

import asyncio
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

from wil_campaign.foundation.tasks import stop_tasks
from wil_campaign.orchestrator.run.perception.mixing_budget import MixingBudgetWatch
from wil_campaign.orchestrator.run.perception.mixing_loop import MixingLoop
from wil_campaign.orchestrator.run.perception.mixing_statistics import MixingStatistics
from wil_campaign.orchestrator.run.perception.runner_factory import AnyRunner
from wil_campaign.orchestrator.state.mixtures import MixedFrame
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.recipes.working import StepError
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.faults import FaultySignal
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.sensors.sensor_streams import ReadingStream

Take = Callable[[Reading], None]

_TAIL_S = 0.5
"""How long images go on after the goal: the last command is seen to act."""
_EARLY_TAIL_S = 2.5
"""The same in a flight that was ended before `done`: what ended it is seen, as the report shows
the two seconds after a moment."""


@dataclass(slots=True)
class PerceivedSensor:
    """A vehicle's sensor, and the consumers of its readings.

    vehicle, sensor: names. fault: injected into its readings; None for no fault. is_drawn: whether
    its readings are images that are drawn on request, which end with the goal.
    """

    vehicle: str
    sensor: str
    stream: ReadingStream
    takers: list[Take] = field(default_factory=list)
    fault: FaultySignal[Reading] | None = None
    is_drawn: bool = False

    async def run(self) -> None:
        """Deliver the sensor's readings until cancelled."""
        await self.stream.run(self._deliver)

    def _deliver(self, reading: Reading) -> None:
        """Deliver a reading under the sensor's name to all consumers."""
        if reading.sensor != self.sensor:
            reading = replace(reading, sensor=self.sensor)
        if self.fault is not None:
            passed = self.fault.passed(reading)
            if passed is None:
                return
            reading = passed
        for take in self.takers:
            take(reading)


@dataclass(slots=True)
class Perception:
    """Perception of a run: its sensors and mixing loops, and the runners that perceive.

    listeners: called with each mixture and its input readings, also where it was dropped.
    has_external_sensors: whether a sensor's readings come from an external source. of_images: the
    mixings of images, by name, with their topics. images_ended: called with the topics of the drawn
    images and of the mixtures when they have ended.
    """

    runners: Mapping[str, AnyRunner]
    run_state: RunState
    budgets: MixingBudgetWatch
    has_external_sensors: bool = False
    sources: list[PerceivedSensor] = field(default_factory=list)
    listeners: list[Callable[[MixedFrame], None]] = field(default_factory=list)
    of_images: dict[str, tuple[str, ...]] = field(default_factory=dict)
    images_ended: Callable[[tuple[str, ...]], None] = lambda _: None

    @property
    def mixings(self) -> tuple[MixingLoop, ...]:
        """Return perception's mixing loops, in the order of the recipe."""
        return tuple(self.budgets.loops)

    @property
    def bound_to_twin(self) -> tuple[str, ...]:
        """Return the mixings whose twin readings are taken from the twin's own pose."""
        return tuple(mixing.name for mixing in self.mixings if mixing.mixer.pose_request is None)

    @property
    def statistics(self) -> MixingStatistics | None:
        """Return the statistics of the recipe's first combination; None without mixing."""
        return self.mixings[0].statistics if self.mixings else None

    def report_mixture(self, frame: MixedFrame) -> None:
        """Check a mixture and pass it on to perception's listeners."""
        self.budgets.frame(frame)
        for listener in self.listeners:
            listener(frame)

    async def run(self, alive: Callable[[], None]) -> None:
        """From the takeoff on, run sensors and mixing loops until cancelled.

        Drawn images and their mixtures end with the goal, except for a short tail. alive: called
        several times a second while budgets are watched.
        """
        await self.run_state.reaching("takeoff")
        async with asyncio.TaskGroup() as group:
            group.create_task(self.run_state.reaching("end"), name="perception without sensors")
            drawn: list[asyncio.Task[None]] = []
            topics: list[str] = []
            for source in self.sources:
                task = group.create_task(
                    self._sense(source), name=f"{source.vehicle} {source.sensor} sensor"
                )
                if source.is_drawn:
                    drawn.append(task)
                    topics.append(f"/{source.vehicle}/{source.sensor}")
            for mixing in self.mixings:
                task = group.create_task(self._mix(mixing), name=f"mixing {mixing.name}")
                if mixing.name in self.of_images:
                    drawn.append(task)
                    topics.extend(self.of_images[mixing.name])
            if self.mixings or self.has_external_sensors:
                group.create_task(self.budgets.run(alive), name="mixing budgets")
            if drawn:
                ending = self._end_images(drawn, tuple(sorted(set(topics))))
                group.create_task(ending, name="end of images")

    async def _end_images(
        self, drawn: Iterable[asyncio.Task[None]], topics: tuple[str, ...]
    ) -> None:
        """End the tasks of drawn images when no autonomy flies any more.

        That is at the landing: at `done` the other vehicle's autonomy may still fly.
        """
        await self.run_state.reaching("land")
        await asyncio.sleep(_TAIL_S if self.run_state.reached("done") else _EARLY_TAIL_S)
        await stop_tasks(*drawn)
        self.images_ended(topics)

    async def _sense(self, source: PerceivedSensor) -> None:
        try:
            await source.run()
        except VehicleError as error:
            if not self.run_state.reached("done"):
                self.run_state.decide("ERROR", f"{source.vehicle} {source.sensor}: {error}")

    async def _mix(self, mixing: MixingLoop) -> None:
        try:
            await mixing.run()
        except StepError as error:
            self.run_state.decide("ERROR", str(error), source="mixing")
