"""The flight of a pair: both ready, both armed, one takeoff, both at height, one goal, landing."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping

from campaigns.setup import SyncSetup
from orchestrator.run.course import Course
from orchestrator.run.station import Station
from vehicles.autopilots.registry import autopilot_named
from vehicles.errors import VehicleError

_SETTLED_S = 0.5
"""How long a vehicle has to be at height before it counts: not merely passing through."""
_POLL_S = 0.02


class FlightError(Exception):
    """A stage that could not be completed; says which vehicle and why."""


async def fly_together(
    stations: tuple[Station, ...],
    *,
    course: Course,
    sync: SyncSetup,
    heights_m: Mapping[str, float],
    barrier: Callable[[], None],
    goal: Callable[[float], Awaitable[None]],
) -> None:
    """Take all stations through the stages up to landed; `goal(t0_s)` flies the goal.

    heights_m: to which height above its start each takes off, by name. barrier: called
    when all are at height, before the goal.

    Every barrier waits for all. An error at any stage is raised to the caller, who brings
    everything down; so does `course.over` when it is set before the goal is given.
    """
    course.enter("identify")
    await _each(stations, lambda station: station.driver.identify(sync.ready_timeout_s))
    course.enter("ready")
    await _each(stations, lambda station: station.driver.ready(sync.ready_timeout_s))
    course.enter("arm")
    await _each(stations, lambda station: station.driver.arm())
    if len(stations) > 1:
        # Who was armed first is ahead by as much: motors that are not up make a takeoff wait.
        flown_by = [autopilot_named(station.driver.identity.autopilot) for station in stations]
        await asyncio.sleep(max(autopilot.spool_s for autopilot in flown_by))
    course.enter("takeoff")
    acknowledged = [station.driver.begin_takeoff(heights_m[station.name]) for station in stations]
    await asyncio.gather(*acknowledged)
    await _each(stations, lambda station: _at_height(station, heights_m[station.name], sync))
    course.enter("at_height")
    barrier()
    await _each(stations, lambda station: station.driver.enter_guided())
    t0_s = course.enter("goal")
    await goal(t0_s)
    course.enter("land")
    await _each(stations, lambda station: station.driver.land())
    await _each(stations, lambda station: station.driver.disarmed(sync.landing_timeout_s))
    course.enter("landed")


async def _each(stations: Iterable[Station], do: Callable[[Station], Awaitable[object]]) -> None:
    """Do a thing with all stations at once; the first error cancels the others' waiting."""

    async def one(station: Station) -> None:
        await do(station)

    try:
        async with asyncio.TaskGroup() as group:
            for station in stations:
                group.create_task(one(station), name=f"{station.name} stage")
    except* (VehicleError, FlightError) as errors:
        raise errors.exceptions[0] from None


async def _at_height(station: Station, altitude_m: float, sync: SyncSetup) -> None:
    """Wait until the vehicle has been within tolerance of the height for a moment."""
    loop = asyncio.get_running_loop()
    since_s: float | None = None
    try:
        async with asyncio.timeout(sync.takeoff_timeout_s):
            while since_s is None or loop.time() - since_s < _SETTLED_S:
                height_m = station.height_m()
                near = (
                    height_m is not None and abs(height_m - altitude_m) <= sync.takeoff_tolerance_m
                )
                since_s = (since_s or loop.time()) if near else None
                await asyncio.sleep(_POLL_S)
    except TimeoutError:
        height_m = station.height_m()
        where = "unknown" if height_m is None else f"{height_m:.2f} m"
        raise FlightError(
            f"{station.name}: not at {altitude_m:g} m within {sync.takeoff_timeout_s:g} s of the "
            f"takeoff command; its height is {where}"
        ) from None
