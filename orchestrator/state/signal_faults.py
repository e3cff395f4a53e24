"""Injects the signal faults of a campaign: a signal stops, or repeats its last value."""

import asyncio
from collections.abc import Callable, Sequence
from typing import TypeVar, cast

from wil_campaign.campaigns.values.signal_faults import SignalFault
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.safety.model.verdict import NEVER_BEGAN
from wil_campaign.vehicles.cameras.rendered_cameras import NoImageError
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.faults import FaultKind, FaultySignal, Restamp
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.sensors.sensor_streams import SensesOnDemand
from wil_campaign.worlds.frames import Pose

T = TypeVar("T")


class FaultyOnDemand:
    """An on-demand sensor with faults injected into its readings."""

    def __init__(self, sensor: SensesOnDemand, fault: FaultySignal[Reading]) -> None:
        self._sensor = sensor
        self._fault = fault

    async def ask(
        self, body: Pose, t_s: float, *, want_depth: bool = False, want_ids: bool = False
    ) -> Reading:
        """Return the reading at a body's pose. Raises NoImageError while the sensor has stopped."""
        reading = await self._sensor.ask(body, t_s, want_depth=want_depth, want_ids=want_ids)
        passed = self._fault.passed(reading)
        if passed is None:
            raise NoImageError(
                f"{reading.sensor or 'the sensor'} of the twin has stopped (injected by faults)"
            )
        return passed


def restamp_estimate(last: EstimateSample, new: EstimateSample) -> EstimateSample:
    """Return an estimate with the times of another."""
    return new._replace(pose=last.pose, velocity_ned_m_s=last.velocity_ned_m_s)


class SignalFaults:
    """The injected faults of one run. note: called with a text when one begins or ends.

    A run that ends before one of them has begun, and is decided by nothing else, is INVALID.
    """

    def __init__(
        self,
        faults: Sequence[SignalFault],
        *,
        run_state: RunState,
        note: Callable[[str], None],
    ) -> None:
        self._faults = tuple(faults)
        self._run_state = run_state
        self._note = note
        self._signals: dict[tuple[str, str | None], FaultySignal[object]] = {}
        self._begun: set[Stage] = set()
        self._injected: set[SignalFault] = set()
        run_state.on_stage(self._begin_stage)

    def signal(
        self, vehicle: str, sensor: str | None, restamp: Restamp[T]
    ) -> FaultySignal[T] | None:
        """Return the fault injection of a signal; None for a signal without faults."""
        key = (vehicle, sensor)
        if not any((fault.vehicle, fault.sensor) == key for fault in self._faults):
            return None
        signal = self._signals.setdefault(key, FaultySignal(cast("Restamp[object]", restamp)))
        return cast("FaultySignal[T]", signal)

    def _begin_stage(self, stage: Stage, _: float) -> None:
        if stage == "end":
            self._require_all()
        if stage in self._begun:
            return
        self._begun.add(stage)
        loop = asyncio.get_running_loop()
        for fault in self._faults:
            signal = self._signals.get((fault.vehicle, fault.sensor))
            if fault.stage != stage or signal is None:
                continue
            loop.call_later(fault.after_s, self._set_fault, fault, signal, fault.kind)
            if fault.for_s is not None:
                loop.call_later(fault.after_s + fault.for_s, self._set_fault, fault, signal, None)

    def _require_all(self) -> None:
        """Decide the run as INVALID where a fault never began: a PASS would claim that it did."""
        never = next((fault for fault in self._faults if fault not in self._injected), None)
        if never is not None and not self._run_state.decisive:
            reason = f"an injected fault never began: {never}"
            self._run_state.decide("INVALID", reason, source=NEVER_BEGAN, ends_flight=False)

    def _set_fault(
        self, fault: SignalFault, signal: FaultySignal[object], kind: FaultKind | None
    ) -> None:
        signal.fault = kind
        self._injected.add(fault)
        self._note(f"{'ended' if kind is None else 'begun'}: {fault}")
