"""Perception of a run: the vehicles' sensors, mixed by the recipe and delivered to runners."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from orchestrator.run.perception.mixing_budget import MixingBudgetWatch
from orchestrator.run.perception.mixing_loop import MixingLoop
from orchestrator.run.perception.mixing_statistics import MixingStatistics
from orchestrator.run.perception.runner_factory import AnyRunner
from orchestrator.state.mixtures import MixedFrame
from orchestrator.state.run_state import RunState
from recipes.working import StepError
from vehicles.errors import VehicleError
from vehicles.faults import FaultySignal
from vehicles.readings import Reading
from vehicles.sensors.sensor_streams import Stream

Take = Callable[[Reading], None]


@dataclass(slots=True)
class SensorSource:
    """A vehicle's sensor, and the consumers of its readings.

    vehicle, sensor: names. fault: injected into its readings; None for no fault.
    """

    vehicle: str
    sensor: str
    stream: Stream
    takers: list[Take] = field(default_factory=list)
    fault: FaultySignal[Reading] | None = None

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
    has_external_sensors: whether a sensor's readings come from an external source.
    """

    runners: Mapping[str, AnyRunner]
    run_state: RunState
    budgets: MixingBudgetWatch
    has_external_sensors: bool = False
    sources: list[SensorSource] = field(default_factory=list)
    listeners: list[Callable[[MixedFrame], None]] = field(default_factory=list)

    @property
    def mixings(self) -> tuple[MixingLoop, ...]:
        """Return perception's mixing loops, in the order of the recipe."""
        return tuple(self.budgets.loops)

    @property
    def bound_to_twin(self) -> tuple[str, ...]:
        """Return the mixings whose twin readings are taken from the twin's own pose."""
        return tuple(one.name for one in self.mixings if one.mixer.pose_request is None)

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

        alive: called several times a second while budgets are watched.
        """
        await self.run_state.reaching("takeoff")
        async with asyncio.TaskGroup() as group:
            group.create_task(self.run_state.reaching("end"), name="perception without sensors")
            for source in self.sources:
                group.create_task(
                    self._sense(source), name=f"{source.vehicle} {source.sensor} sensor"
                )
            for mixing in self.mixings:
                group.create_task(self._mix(mixing), name=f"mixing {mixing.name}")
            if self.mixings or self.has_external_sensors:
                group.create_task(self.budgets.run(alive), name="mixing budgets")

    async def _sense(self, source: SensorSource) -> None:
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
