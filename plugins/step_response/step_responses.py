"""Flies step responses with an attached simulator under a guard, and compares the figures."""

import asyncio
import signal
import time
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.foundation.processes.interrupts import signals_call
from wil_campaign.foundation.tasks import finish_in_task, start_task, stop_tasks
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import AttachedVehicle
from wil_campaign.plugins.step_response.comparison import FigureRow, compare_figures, load_ranges
from wil_campaign.plugins.step_response.event_order import EventTrace, OrderRow, order_rows
from wil_campaign.plugins.step_response.figures import figures_of
from wil_campaign.plugins.step_response.flight import StepFlight
from wil_campaign.plugins.step_response.segments import Series
from wil_campaign.safety.guard.core.commands import BringDown
from wil_campaign.safety.guard.core.events import (
    GuardedVehicle,
    GuardEvent,
    GuardSettings,
    brings_down,
)
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.safety.guard.process.guard_config import GuardConfig, GuardedVehicleConfig
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.worlds.frames import norm, subtract

_NAME = "vehicle"
_IDENTIFY_S = 10.0
_AT_REST_S = 3.0
_ALL_DOWN_S = 60.0
_SILENT_S = 1.0
"""How long this process may be silent until the guard lands, as in runs."""

_LATEST, _SAME_TIME_S = 25, 0.02
"""Estimates of half a second, at 50 Hz; at 1.5 m/s a vehicle flies 3 cm within that time."""

Progress = Callable[[str], None]


class NotDownError(VehicleError):
    """The vehicle did not report landed and disarmed at the end."""


class OperatorAbortError(VehicleError):
    """An operator aborted the flight by a command."""


@dataclass(frozen=True, slots=True)
class FlownStepResponses:
    """The result of flown step responses: figures and event orders against the firmware's.

    estimate_off_m: the largest distance of its estimate from its simulator's ground truth; None
    where it sent none.
    """

    figures: tuple[FigureRow, ...]
    orders: tuple[OrderRow, ...]
    estimate_off_m: float | None = None

    @property
    def beyond(self) -> int:
        """Return how many figures and orders differ from the firmware's."""
        orders = sum(order.beyond for order in self.orders)
        return sum(figure.beyond for figure in self.figures) + orders

    @property
    def total(self) -> int:
        """Return how many figures and orders there are."""
        return len(self.figures) + len(self.orders)


class EstimateError:
    """How far a vehicle's estimate is from its simulator's ground truth, both from one start.

    most_m: the largest distance so far; None before both have arrived.
    """

    def __init__(self) -> None:
        self.most_m: float | None = None
        self._estimates: deque[EstimateSample] = deque(maxlen=_LATEST)

    def estimate(self, sample: EstimateSample) -> None:
        """Take an estimate of the vehicle."""
        self._estimates.append(sample)

    def truth(self, sample: EstimateSample) -> None:
        """Compare a ground truth with the estimate of its time."""
        near = min(self._estimates, key=lambda one: abs(one.t_s - sample.t_s), default=None)
        if near is None or abs(near.t_s - sample.t_s) > _SAME_TIME_S:
            return
        off_m = norm(subtract(near.pose.position_ned_m, sample.pose.position_ned_m))
        self.most_m = off_m if self.most_m is None else max(self.most_m, off_m)


def fly_step_responses(
    vehicle: AttachedVehicle, address: LinkAddress, *, folder: Path, progress: Progress
) -> FlownStepResponses:
    """Fly the step responses in real time; the vehicle is landed when this returns or raises.

    folder: where the guard writes its log. Raises VehicleError; KeyboardInterrupt after
    SIGINT, SIGTERM or SIGHUP.
    """
    try:
        return asyncio.run(_fly(vehicle, address, folder, progress))
    except asyncio.CancelledError:
        raise KeyboardInterrupt from None


async def _fly(
    vehicle: AttachedVehicle, address: LinkAddress, folder: Path, progress: Progress
) -> FlownStepResponses:
    autopilot = autopilot_named(vehicle.identity.autopilot)
    target = MavlinkTarget(vehicle.identity.system_id, vehicle.identity.component_id)
    guard = _guard(autopilot, target, address, folder)
    link = TappedLink(guard.link(_NAME))
    trace = EventTrace(autopilot=autopilot, target=target)
    link.tap(trace.receive)
    driver = Driver(name=_NAME, link=link, autopilot=autopilot.name, system_id=target.system)
    error = EstimateError()
    driver.on_truth(error.truth)
    driver.on_estimate(error.estimate)
    with _interrupts_cancel():
        async with guard, driver:
            await driver.identify(_IDENTIFY_S)
            flight = StepFlight(driver, progress=progress)
            try:
                flown = await _fly_until_takeover(flight, guard)
            except BaseException as failure:
                progress("bring down")
                await finish_in_task(
                    _bring_down(guard, str(failure) or "interrupted"), name="landing"
                )
                raise
            if not await guard.at_rest(_AT_REST_S):
                why = f"{_NAME} reported disarmed, then armed again"
                await finish_in_task(_bring_down(guard, why), name="landing")
    rows = compare_figures(load_ranges(autopilot.name), figures_of(flown))
    orders = tuple(order_rows(trace.events, autopilot.name))
    return FlownStepResponses(tuple(rows), orders, error.most_m)


def _guard(
    autopilot: Autopilot, target: MavlinkTarget, address: LinkAddress, folder: Path
) -> RemoteGuard:
    """Return a guard in a separate process, which also lands if this process dies."""
    vehicle = GuardedVehicle(autopilot=autopilot, target=target, attached=True)
    return RemoteGuard(
        guard_config=GuardConfig(
            run="doctor",
            folder=str(folder.absolute()),
            epoch_s=time.time() - asyncio.get_running_loop().time(),
            vehicles={_NAME: GuardedVehicleConfig(vehicle=vehicle, link=str(address))},
            settings=GuardSettings(orchestrator_silent_s=_SILENT_S),
        )
    )


async def _fly_until_takeover(flight: StepFlight, guard: RemoteGuard) -> Series:
    """Fly until the guard takes over. Raises VehicleError with the guard's reason."""
    task = start_task(flight.fly(), name="step responses")
    causes: list[GuardEvent] = []

    def stop_flight(event: GuardEvent) -> None:
        if brings_down(event):
            causes.append(event)
            task.cancel()

    guard.on_event(stop_flight)
    try:
        await asyncio.wait([task])
    finally:
        if not task.done():
            await stop_tasks(task)
    if causes:
        kind = OperatorAbortError if causes[0].kind == "abort" else VehicleError
        raise kind(f"the guard lands {_NAME}: {causes[0].text}")
    return task.result()


async def _bring_down(guard: Guard, reason: str) -> None:
    """Have the guard land and disarm the vehicle. Raises NotDownError."""
    guard.send(BringDown(reason))
    if not await guard.all_down(_ALL_DOWN_S):
        raise NotDownError(
            f"{reason}; {_NAME} did not report landed and disarmed within {_ALL_DOWN_S:g} s after "
            "the guard took over; check the simulator"
        )


def _interrupts_cancel() -> AbstractContextManager[None]:
    """Cancel the current task on SIGINT, SIGTERM and SIGHUP, however often."""
    task = asyncio.current_task()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    return signals_call(dict.fromkeys(numbers, task.cancel) if task is not None else {})
