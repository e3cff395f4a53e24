"""The stages of a pair's flight: ready, armed, common takeoff, at height, goal, landed."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import suppress

from wil_campaign.campaigns.setup.case_setup import SyncSetup
from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.foundation.tasks import open_task_group, stop_tasks
from wil_campaign.orchestrator.run.stages.distinct_vehicles import require_distinct_vehicles
from wil_campaign.orchestrator.run.stages.drop_outs import each_remaining_vehicle, each_vehicle
from wil_campaign.orchestrator.run.stages.liftoff_delays import takeoff_staggers_s
from wil_campaign.orchestrator.run.stages.operator_hold import OperatorHold
from wil_campaign.orchestrator.run_results.run_result import NOT_ARMED
from wil_campaign.orchestrator.state.run_state import FlightError, RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.setpoints import PositionSetpoint

_SETTLED_S = 0.5
"""How long a vehicle has to stay at height before it counts as there."""
_DISARMED_S = 1.5
"""A vehicle that reports for so long to be disarmed is: a single heartbeat may be an old one."""
_POLL_S = 0.02
_CLIMB_HZ = 10.0
_SILENT_S = 3.0
"""A dropped-out vehicle that is silent for so long is not awaited."""


CheckAgain = Callable[[tuple[VehicleContext, ...]], Awaitable[None]]
"""Checks vehicles once more that stand; raises what forbids arming."""


async def fly_together(
    contexts: tuple[VehicleContext, ...],
    *,
    run_state: RunState,
    operator_hold: OperatorHold,
    sync: SyncSetup,
    heights_m: Mapping[str, float],
    liftoff_delays_s: Mapping[str, float],
    stagger: Callable[[Mapping[str, float]], None],
    before_arming: Callable[[], Awaitable[None]],
    check_again: CheckAgain,
    barrier: Callable[[], None],
    goal: Callable[[float], Awaitable[None]],
    others_landed: Iterable[Callable[[], Awaitable[object]]] = (),
    arm: bool = True,
) -> None:
    """Fly all vehicles of the pair through the stages up to landed; `goal(t0_s)` flies the goal.

    heights_m: takeoff height above each vehicle's start, by name. liftoff_delays_s: from takeoff
    command to liftoff; a vehicle with a shorter delay gets its command later. stagger: called with
    these waiting times. before_arming: run when all are ready; raises what forbids arming.
    check_again: run before vehicles arm that an operator's hold has kept on the ground since.
    others_landed: waits for other vehicles that have to land. arm: False stops before arming.
    barrier: called when all are at height, before the goal.

    Every stage waits for all vehicles, and for the end of an operator's hold. An error at any stage
    is raised to the caller, which lands everything; it does so too when `run_state.over` is set.
    From the takeoff on, a vehicle that may drop out does so by its errors, and the others continue
    without it.
    """
    run_state.enter("identify")
    await each_vehicle(contexts, lambda context: context.driver.identify(sync.identify_timeout_s))
    require_distinct_vehicles(contexts)
    run_state.enter("ready")
    await each_vehicle(contexts, lambda context: context.driver.ready(sync.ready_timeout_s))
    await before_arming()
    if not arm:
        run_state.decide("ABORTED", NOT_ARMED, source="no-arm")
        return
    run_state.enter("arm")

    async def arm_checked() -> None:
        if operator_hold.count:
            await check_again(contexts)
        await _arm(contexts)

    await operator_hold.through(arm_checked)
    stagger(takeoff_staggers_s(liftoff_delays_s, [context.name for context in contexts]))
    run_state.enter("takeoff")
    delays_s = liftoff_delays_s
    await operator_hold.through(
        lambda: _take_off(contexts, heights_m, sync, run_state, delays_s),
        again=lambda: _resume_takeoff(
            contexts, heights_m, sync, run_state, delays_s, check_again=check_again
        ),
    )
    run_state.enter("at_height")
    barrier()
    await operator_hold.through(lambda: _guide(contexts, run_state))
    t0_s = run_state.enter("goal")
    await _with_operator_holds(contexts, operator_hold, goal(t0_s), run_state)
    run_state.enter("land")
    await operator_hold.through(lambda: _land(contexts, sync, run_state))
    for landed in others_landed:
        await landed()
    run_state.enter("landed")


async def _arm(contexts: tuple[VehicleContext, ...]) -> None:
    """Arm the pair's vehicles, and wait for their motors. Raises VehicleError.

    A second vehicle with the system id of one may show itself only now.
    """
    await each_vehicle(contexts, lambda context: context.driver.arm())
    if len(contexts) > 1:
        # The vehicle armed first is ahead: a takeoff waits until the motors have spooled up.
        flown_by = [autopilot_named(context.driver.identity.autopilot) for context in contexts]
        await asyncio.sleep(max(autopilot.spool_s for autopilot in flown_by))
    for context in contexts:
        context.driver.require_alone()


async def _take_off(
    contexts: Iterable[VehicleContext],
    heights_m: Mapping[str, float],
    sync: SyncSetup,
    run_state: RunState,
    delays_s: Mapping[str, float],
) -> None:
    """Send the pair's takeoff commands for a common liftoff, and wait until all are at height."""
    await _command_takeoff(contexts, heights_m, run_state, delays_s)
    await each_remaining_vehicle(
        contexts, run_state, lambda one: _at_height(one, heights_m[one.name], sync)
    )


async def _resume_takeoff(
    contexts: Iterable[VehicleContext],
    heights_m: Mapping[str, float],
    sync: SyncSetup,
    run_state: RunState,
    delays_s: Mapping[str, float],
    *,
    check_again: CheckAgain,
) -> None:
    """Continue the takeoff after a hold: take off again from the ground, climb in the air."""
    grounded = [one for one in contexts if one.driver.state.landed in {"on_ground", "unknown"}]
    if standing := [one for one in grounded if one.name not in run_state.dropped_out]:
        await check_again(tuple(standing))
    await each_remaining_vehicle(grounded, run_state, lambda one: one.driver.arm())
    await _command_takeoff(grounded, heights_m, run_state, delays_s)

    async def go_up(context: VehicleContext) -> None:
        up = _at_height if context in grounded else _climb
        await up(context, heights_m[context.name], sync)

    await each_remaining_vehicle(contexts, run_state, go_up)


async def _command_takeoff(
    contexts: Iterable[VehicleContext],
    heights_m: Mapping[str, float],
    run_state: RunState,
    delays_s: Mapping[str, float],
) -> None:
    """Send the takeoff command of the slowest vehicle at once, those of the others later."""
    flying = [one for one in contexts if one.name not in run_state.dropped_out]
    waits_s = takeoff_staggers_s(delays_s, [one.name for one in flying])
    at_once = [one for one in flying if waits_s[one.name] == 0.0]
    acknowledged = {one.name: one.driver.begin_takeoff(heights_m[one.name]) for one in at_once}

    async def command(context: VehicleContext) -> None:
        if context.name not in acknowledged:
            await asyncio.sleep(waits_s[context.name])
            acknowledged[context.name] = context.driver.begin_takeoff(heights_m[context.name])
        await acknowledged[context.name]

    await each_remaining_vehicle(flying, run_state, command)


async def _climb(context: VehicleContext, height_m: float, sync: SyncSetup) -> None:
    """Fly a vehicle to a height by setpoints: no autopilot takes off in the air."""
    await context.driver.enter_guided()
    north_m, east_m, down_m = context.start.position_ned_m
    place = PositionSetpoint((north_m, east_m, down_m - height_m), context.start.yaw_rad)
    async with open_task_group() as tasks:
        climbed = tasks.create_task(
            _at_height(context, height_m, sync), name=f"{context.name} at height"
        )
        while not climbed.done():
            context.driver.send(place)
            await asyncio.wait([climbed], timeout=1.0 / _CLIMB_HZ)
    # The other vehicle may still climb: without setpoints PX4 enters its failsafe meanwhile.
    context.driver.keep_still()


async def _guide(contexts: Iterable[VehicleContext], run_state: RunState) -> None:
    """Switch the pair to the mode that follows setpoints (offboard, guided)."""
    await each_remaining_vehicle(contexts, run_state, lambda context: context.driver.enter_guided())


async def _land(contexts: tuple[VehicleContext, ...], sync: SyncSetup, run_state: RunState) -> None:
    """Land the pair and wait until both are disarmed."""
    async with open_task_group() as tasks:
        for context in (one for one in contexts if one.name in run_state.dropped_out):
            tasks.create_task(_land_dropped_out(context), name=f"landing of {context.name}")
        await each_remaining_vehicle(contexts, run_state, lambda context: context.driver.land())
        await each_remaining_vehicle(
            contexts, run_state, lambda context: context.driver.disarmed(sync.landing_timeout_s)
        )
        await _await_disarmed([one for one in contexts if one.name in run_state.dropped_out], sync)


async def _land_dropped_out(context: VehicleContext) -> None:
    """Land a dropped-out vehicle that may still hover; the guard may be landing it already."""
    with suppress(VehicleError):
        await context.driver.land()


async def _await_disarmed(dropped_out: Iterable[VehicleContext], sync: SyncSetup) -> None:
    """Wait until dropped-out vehicles are disarmed, as long as messages arrive from them."""
    loop = asyncio.get_running_loop()

    def is_coming_down(context: VehicleContext) -> bool:
        state = context.driver.state
        received_s = state.last_received_s
        return state.armed and received_s is not None and loop.time() - received_s < _SILENT_S

    until_s = loop.time() + sync.landing_timeout_s
    while loop.time() < until_s and any(map(is_coming_down, dropped_out)):
        await sleep_until(loop.time() + _POLL_S)


async def _with_operator_holds(
    contexts: Iterable[VehicleContext],
    operator_hold: OperatorHold,
    goal: Awaitable[None],
    run_state: RunState,
) -> None:
    """Fly the pair's goal; after each operator hold return to the guided mode."""

    async def guide_again() -> None:
        while True:
            count = operator_hold.count
            await operator_hold.resumed(after=count)
            await operator_hold.through(lambda: _guide(contexts, run_state))

    async with open_task_group() as tasks:
        guiding = tasks.create_task(guide_again(), name="guided after a hold")
        await goal
        await stop_tasks(guiding)


async def _at_height(context: VehicleContext, altitude_m: float, sync: SyncSetup) -> None:
    """Wait until a vehicle of the pair has been near the height for a moment.

    Raises FlightError when it is not in time, and when it disarms.
    """
    loop = asyncio.get_running_loop()
    since_s: float | None = None
    armed_s = loop.time()
    try:
        async with asyncio.timeout(sync.takeoff_timeout_s):
            while since_s is None or loop.time() - since_s < _SETTLED_S:
                height_m = context.height_m()
                near = (
                    height_m is not None and abs(height_m - altitude_m) <= sync.takeoff_tolerance_m
                )
                since_s = (since_s or loop.time()) if near else None
                armed_s = loop.time() if context.driver.state.armed else armed_s
                if loop.time() - armed_s > _DISARMED_S:
                    raise FlightError(_disarmed_text(context, altitude_m))
                await asyncio.sleep(_POLL_S)
    except TimeoutError:
        raise FlightError(
            f"{context.name}: not at {altitude_m:g} m within {sync.takeoff_timeout_s:g} s of the "
            f"takeoff command; its height is {_height_text(context)}"
        ) from None


def _disarmed_text(context: VehicleContext, altitude_m: float) -> str:
    where = f"not at {altitude_m:g} m; its height is {_height_text(context)}"
    texts = context.driver.state.texts
    last_text = f"; its last STATUSTEXT: {texts[-1].text.strip()}" if texts else ""
    return f"{context.name}: it is disarmed, and {where}{last_text}"


def _height_text(context: VehicleContext) -> str:
    height_m = context.height_m()
    return "unknown" if height_m is None else f"{height_m:.2f} m"
