"""The flight of a pair: both ready, both armed, one takeoff, both at height, one goal, landing."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import suppress

from campaigns.setup.case_setup import SyncSetup
from orchestrator.model.liftoff_delays import staggers_s
from orchestrator.model.results import NOT_ARMED
from orchestrator.run.stages.distinct_vehicles import require_distinct
from orchestrator.run.stages.drop_outs import each, each_left
from orchestrator.run.stages.operator_hold import OperatorHold
from orchestrator.state.run_state import FlightError, RunState
from orchestrator.state.vehicle_context import VehicleContext
from vehicles.autopilots.registry import autopilot_named
from vehicles.cameras.rendered_cameras import sleep_until
from vehicles.errors import VehicleError
from vehicles.setpoints import PositionSetpoint
from vehicles.tasks import stop, together

_SETTLED_S = 0.5
"""How long a vehicle has to be at height before it counts: not merely passing through."""
_POLL_S = 0.02
_CLIMB_HZ = 10.0
_SILENT_S = 3.0
"""A vehicle that dropped out and is silent for so long is not waited for."""


async def fly_together(
    contexts: tuple[VehicleContext, ...],
    *,
    run_state: RunState,
    holding: OperatorHold,
    sync: SyncSetup,
    heights_m: Mapping[str, float],
    liftoff_delays_s: Mapping[str, float],
    stagger: Callable[[Mapping[str, float]], None],
    before_arming: Callable[[], Awaitable[None]],
    barrier: Callable[[], None],
    goal: Callable[[float], Awaitable[None]],
    others_landed: Iterable[Callable[[], Awaitable[object]]] = (),
    arm: bool = True,
) -> None:
    """Fly all vehicles of the pair through the stages up to landed; `goal(t0_s)` flies the goal.

    heights_m: to which height above its start each takes off, by name. liftoff_delays_s: how long
    each takes from its command to its liftoff; whose is shorter gets its command later. stagger: is
    told by how much. before_arming: what is done when all are ready; it raises what speaks against
    arming. others_landed: what else has to be down before all have landed. arm: False stops there.
    barrier: called when all are at height, before the goal.

    Every barrier waits for all, and for an operator who holds. An error at any stage is raised to
    the caller, who brings everything down; so does `run_state.over` when it is set before the goal
    is given. From the takeoff on a vehicle that may drop out does so by its errors, and the others
    fly on without it.
    """
    run_state.enter("identify")
    await each(contexts, lambda context: context.driver.identify(sync.identify_timeout_s))
    require_distinct(contexts)
    run_state.enter("ready")
    await each(contexts, lambda context: context.driver.ready(sync.ready_timeout_s))
    await before_arming()
    if not arm:
        run_state.decide("ABORTED", NOT_ARMED, source="no-arm")
        return
    run_state.enter("arm")
    await holding.through(lambda: _arm(contexts))
    stagger(staggers_s(liftoff_delays_s, [context.name for context in contexts]))
    run_state.enter("takeoff")
    delays_s = liftoff_delays_s
    await holding.through(
        lambda: _take_off(contexts, heights_m, sync, run_state, delays_s),
        again=lambda: _go_on_taking_off(contexts, heights_m, sync, run_state, delays_s),
    )
    run_state.enter("at_height")
    barrier()
    await holding.through(lambda: _guide(contexts, run_state))
    t0_s = run_state.enter("goal")
    await _with_operator_holds(contexts, holding, goal(t0_s), run_state)
    run_state.enter("land")
    await holding.through(lambda: _land(contexts, sync, run_state))
    for landed in others_landed:
        await landed()
    run_state.enter("landed")


async def _arm(contexts: tuple[VehicleContext, ...]) -> None:
    """Arm the pair's vehicles, and wait for their motors."""
    await each(contexts, lambda context: context.driver.arm())
    if len(contexts) > 1:
        # Who was armed first is ahead by as much: motors that are not up make a takeoff wait.
        flown_by = [autopilot_named(context.driver.identity.autopilot) for context in contexts]
        await asyncio.sleep(max(autopilot.spool_s for autopilot in flown_by))


async def _take_off(
    contexts: Iterable[VehicleContext],
    heights_m: Mapping[str, float],
    sync: SyncSetup,
    run_state: RunState,
    delays_s: Mapping[str, float],
) -> None:
    """Send the pair's takeoff commands, so that all lift together, and wait until they are up."""
    await _command_takeoff(contexts, heights_m, run_state, delays_s)
    await each_left(contexts, run_state, lambda one: _at_height(one, heights_m[one.name], sync))


async def _go_on_taking_off(
    contexts: Iterable[VehicleContext],
    heights_m: Mapping[str, float],
    sync: SyncSetup,
    run_state: RunState,
    delays_s: Mapping[str, float],
) -> None:
    """Continue the pair's takeoff after a hold: again from the ground, climbing in the air."""
    grounded = [one for one in contexts if one.driver.state.landed in {"on_ground", "unknown"}]
    await each_left(grounded, run_state, lambda one: one.driver.arm())
    await _command_takeoff(grounded, heights_m, run_state, delays_s)

    async def go_up(context: VehicleContext) -> None:
        up = _at_height if context in grounded else _climb
        await up(context, heights_m[context.name], sync)

    await each_left(contexts, run_state, go_up)


async def _command_takeoff(
    contexts: Iterable[VehicleContext],
    heights_m: Mapping[str, float],
    run_state: RunState,
    delays_s: Mapping[str, float],
) -> None:
    """Send the slowest vehicle's takeoff command at once, in one turn; the others' later."""
    left = [one for one in contexts if one.name not in run_state.dropped_out]
    waits_s = staggers_s(delays_s, [one.name for one in left])
    at_once = [one for one in left if waits_s[one.name] == 0.0]
    acknowledged = {one.name: one.driver.begin_takeoff(heights_m[one.name]) for one in at_once}

    async def command(context: VehicleContext) -> None:
        if context.name not in acknowledged:
            await asyncio.sleep(waits_s[context.name])
            acknowledged[context.name] = context.driver.begin_takeoff(heights_m[context.name])
        await acknowledged[context.name]

    await each_left(left, run_state, command)


async def _climb(context: VehicleContext, height_m: float, sync: SyncSetup) -> None:
    """Fly a vehicle of the pair to a height by setpoints: no autopilot takes off twice."""
    await context.driver.enter_guided()
    north_m, east_m, down_m = context.start.position_ned_m
    place = PositionSetpoint((north_m, east_m, down_m - height_m), context.start.yaw_rad)
    async with together() as tasks:
        there = tasks.create_task(
            _at_height(context, height_m, sync), name=f"{context.name} at height"
        )
        while not there.done():
            context.driver.send(place)
            await asyncio.wait([there], timeout=1.0 / _CLIMB_HZ)
    # The other one may not be up yet: without setpoints PX4 falls into its failsafe meanwhile.
    context.driver.keep_still()


async def _guide(contexts: Iterable[VehicleContext], run_state: RunState) -> None:
    """Bring the pair into the mode that follows setpoints."""
    await each_left(contexts, run_state, lambda context: context.driver.enter_guided())


async def _land(contexts: tuple[VehicleContext, ...], sync: SyncSetup, run_state: RunState) -> None:
    """Land the pair and wait until both are disarmed."""
    async with together() as tasks:
        for context in (one for one in contexts if one.name in run_state.dropped_out):
            tasks.create_task(_land_dropped_out(context), name=f"{context.name} is landed")
        await each_left(contexts, run_state, lambda context: context.driver.land())
        await each_left(
            contexts, run_state, lambda context: context.driver.disarmed(sync.landing_timeout_s)
        )
        await _grounded([one for one in contexts if one.name in run_state.dropped_out], sync)


async def _land_dropped_out(context: VehicleContext) -> None:
    """Land a vehicle that dropped out and may hover still; the guard may be landing it already."""
    with suppress(VehicleError):
        await context.driver.land()


async def _grounded(dropped_out: Iterable[VehicleContext], sync: SyncSetup) -> None:
    """Wait until dropped-out vehicles are disarmed, as long as they are received."""
    loop = asyncio.get_running_loop()

    def is_coming_down(context: VehicleContext) -> bool:
        state = context.driver.state
        heard_s = state.last_received_s
        return state.armed and heard_s is not None and loop.time() - heard_s < _SILENT_S

    until_s = loop.time() + sync.landing_timeout_s
    while loop.time() < until_s and any(map(is_coming_down, dropped_out)):
        await sleep_until(loop.time() + _POLL_S)


async def _with_operator_holds(
    contexts: Iterable[VehicleContext],
    holding: OperatorHold,
    goal: Awaitable[None],
    run_state: RunState,
) -> None:
    """Fly the pair's goal; after each operator hold return to the guided mode."""

    async def guide_again() -> None:
        while True:
            count = holding.count
            await holding.resumed(after=count)
            await holding.through(lambda: _guide(contexts, run_state))

    async with together() as tasks:
        guiding = tasks.create_task(guide_again(), name="guided after a hold")
        await goal
        await stop(guiding)


async def _at_height(context: VehicleContext, altitude_m: float, sync: SyncSetup) -> None:
    """Wait until a vehicle of the pair has been near the height for a moment."""
    loop = asyncio.get_running_loop()
    since_s: float | None = None
    try:
        async with asyncio.timeout(sync.takeoff_timeout_s):
            while since_s is None or loop.time() - since_s < _SETTLED_S:
                height_m = context.height_m()
                near = (
                    height_m is not None and abs(height_m - altitude_m) <= sync.takeoff_tolerance_m
                )
                since_s = (since_s or loop.time()) if near else None
                await asyncio.sleep(_POLL_S)
    except TimeoutError:
        height_m = context.height_m()
        where = "unknown" if height_m is None else f"{height_m:.2f} m"
        raise FlightError(
            f"{context.name}: not at {altitude_m:g} m within {sync.takeoff_timeout_s:g} s of the "
            f"takeoff command; its height is {where}"
        ) from None
