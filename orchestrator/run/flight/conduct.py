"""Conducts a run with its vehicles there: all its tasks, its flight, and everything down."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from orchestrator.run.flight.run_parts import FlightParts
from orchestrator.run.perception.autonomy_calls import AutonomyFault
from orchestrator.run.stages.landing import bring_down, see_at_rest
from orchestrator.run.stages.pair_flight import fly_together
from orchestrator.run.vehicles.last_statustext import last_statustext
from orchestrator.state.run_state import FlightError, RunState
from orchestrator.state.vehicle_context import VehicleContext
from recipes.working import StepError
from safety.guard.core.events import GuardEvent, decisive
from vehicles.errors import VehicleError
from vehicles.tasks import finish, stop, together

_LANDINGS = 3
"""How often a landing is begun in which an exception of ours comes up."""
EXPECTED = (VehicleError, FlightError, StepError, AutonomyFault)
"""What a run knows of: who awaits a task that ends by one of these decides what it means."""
Start = Callable[[], Coroutine[Any, Any, object]]


async def conduct(run: FlightParts) -> None:
    """Fly the run, and in any case have everything down before this returns."""
    for context in run.pair.contexts:
        run.bench.attach(context)
        _record_events(run, context)
    for context in run.pair.actors:
        _record_events(run, context)
    run.feed.attach(run.pair.contexts, run.bench, run.perception)
    run.pair.guard.on_event(lambda event: _guard_event(run, event))
    # They are taken anew at arming.
    run.run_state.on_stage(lambda stage, _: run.pair.send_anchors() if stage == "takeoff" else None)
    run_state, watchdog = run.run_state, run.watchdog
    lasting: tuple[tuple[str, Start], ...] = (
        ("judging", lambda: run.bench.run(watchdog.watch("judging"))),
        ("operator", lambda: run.commanding.run(watchdog.watch("operator"))),
        ("fences", run.commanding.fencing.run),
        ("progress", lambda: _follow(run)),
        ("trajectory", lambda: _record(run)),
        ("perception", lambda: run.perception.run(watchdog.watch("mixing budgets"))),
        ("outside", lambda: run.outside.run(run_state)),
        ("watchdog", watchdog.run),
    )
    if (twin := run.twin) is not None and run.setup.companion is not None:
        sign = watchdog.watch("twin distance")
        lasting += (("twin distance", lambda: twin.run(run.pair.contexts, sign)),)
    async with together() as tasks:
        background = [
            tasks.create_task(_last(run_state, name, begin), name=name) for name, begin in lasting
        ]
        flight = tasks.create_task(_flight(run), name="flight")
        over = tasks.create_task(run_state.over.wait(), name="over")
        try:
            await asyncio.wait([flight, over, *background], return_when=asyncio.FIRST_COMPLETED)
        finally:
            await finish(_finish(run, flight), name="landing")
            await stop(over, *background)


async def _last(run_state: RunState, name: str, begin: Start) -> None:
    """Run a task until the end of the run; an earlier end is decisive.

    It raises nothing: the others of its group have to see the landing.
    """
    with run_state.taking(name):
        await begin()
        run_state.decide("ERROR", f"{name} ended before the flight did")


async def _finish(run: FlightParts, flight: "asyncio.Task[None]") -> None:
    """End the run's flight; unless it landed by itself, the guard brings all down.

    An exception of ours keeps nothing from being done that comes after it.
    """
    run_state = run.run_state
    await _step(run_state, "the end of the flight", lambda: stop(flight))
    for _ in range(_LANDINGS):
        if await _step(run_state, "landing", lambda: _land(run)):
            break
    if not run_state.decisive:
        await _step(run_state, "the last signs of life", run.watchdog.last_signs)
    await _step(run_state, "the end of fence changes", run.commanding.fencing.end)
    await _step(run_state, "what is taken back", run.before_arming.restore)
    if run_state.reached("landed"):
        await _step(run_state, "the vehicles' logs", run.before_arming.configuration.fetch_logs)


async def _step(run_state: RunState, name: str, do: Start) -> bool:
    """Do a step of the run's end; return whether it raised no exception."""
    try:
        with run_state.taking(name):
            await do()
            return True
    except EXPECTED as error:
        run_state.decide("ERROR", str(error))
    return False


async def _land(run: FlightParts) -> None:
    """Bring the run's vehicles down, or check that they are."""
    down = see_at_rest if run.run_state.reached("landed") else bring_down
    await down(run.pair, run.run_state)


def _record_events(run: FlightParts, context: VehicleContext) -> None:
    """Record a vehicle's events in the run."""
    context.driver.on_event(lambda event: run.recorder.vehicle_event(context.name, event))


async def _flight(run: FlightParts) -> None:
    """Fly the run's stages; what goes wrong is decisive, not raised."""
    with run.run_state.taking("flight"):
        try:
            await _fly_stages(run)
        except (VehicleError, FlightError) as error:
            run.run_state.decide("ERROR", str(error))


async def _fly_stages(run: FlightParts) -> None:
    """Fly the run's stages with the pair, and its actors meanwhile."""
    async with together() as tasks:
        flying = [tasks.create_task(one.fly(), name=f"actor {one.name}") for one in run.actors]
        await _fly_pair_stages(run)
        await stop(*flying)


async def _fly_pair_stages(run: FlightParts) -> None:
    """Fly the run's stages with the pair."""
    setup = run.setup
    await fly_together(
        run.pair.contexts,
        run_state=run.run_state,
        holding=run.holding,
        sync=setup.campaign.sync,
        heights_m={one.name: setup.height_m(one) for one in setup.vehicles},
        liftoff_delays_s=setup.liftoff_delays_s,
        stagger=run.sync.stagger,
        before_arming=run.before_arming.apply,
        barrier=run.sync.check_takeoff,
        goal=run.goal.fly,
        others_landed=[one.landed.wait for one in run.actors],
        arm=setup.order.arm,
    )


def _guard_event(run: FlightParts, event: GuardEvent) -> None:
    """Record a guard event in the run, and decide the run by it if it is decisive."""
    run.recorder.guard_event(event)
    run.holding.take(event)
    run.reporter.guard(event)
    run.feed.guard(event)
    if event.kind == "alone":
        _drop_out(run, event)
    settled = decisive(event)
    if settled is not None:
        text = settled.text + last_statustext(run.pair, event)
        run.run_state.decide(settled.kind, text, t_s=settled.t_s, source=settled.source)


def _drop_out(run: FlightParts, event: GuardEvent) -> None:
    """Take that the guard lands a vehicle alone.

    Before the takeoff there is no flight to go on, and without its actor a run shows nothing.
    """
    text = event.text + last_statustext(run.pair, event)
    is_actor = any(one.name == event.vehicle for one in run.actors)
    if run.run_state.reached("takeoff") and not is_actor:
        run.run_state.drop_out(event.vehicle, text)
    else:
        source = f"guard.{event.kind}/{event.vehicle}"
        run.run_state.decide("ERROR", text, t_s=event.t_s, source=source)


async def _record(run: FlightParts) -> None:
    """Record the run's trajectories until cancelled."""
    sign = run.watchdog.watch("trajectory")

    def alive() -> None:
        sign()
        run.feed.tick()

    await run.recorder.follow(run.pair.contexts, run.run_state, alive)


async def _follow(run: FlightParts) -> None:
    """Report the run's progress until cancelled."""
    await run.reporter.follow(
        run.pair.contexts,
        lambda: run.perception.statistics,
        run.bench.clearance_m,
    )
