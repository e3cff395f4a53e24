"""Runs the tasks of a run while its vehicles fly, and lands everything at its end."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from wil_campaign.foundation.tasks import finish, stop, together
from wil_campaign.orchestrator.run.flight.run_parts import FlightParts
from wil_campaign.orchestrator.run.perception.autonomy_calls import AutonomyFault
from wil_campaign.orchestrator.run.perception.autonomy_runner import AutonomyRunner
from wil_campaign.orchestrator.run.stages.landing import (
    bring_down,
    confirmed_at_rest,
    verify_landed,
)
from wil_campaign.orchestrator.run.stages.pair_flight import fly_together
from wil_campaign.orchestrator.run.vehicles.last_statustext import last_statustext
from wil_campaign.orchestrator.state.run_state import FlightError, RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.recipes.working import StepError
from wil_campaign.safety.guard.core.events import GuardEvent, decisive
from wil_campaign.vehicles.errors import VehicleError

_LANDINGS = 3
"""How often a landing is started when an internal exception interrupts it."""
EXPECTED = (VehicleError, FlightError, StepError, AutonomyFault)
"""Exceptions that are findings about a run, not bugs: the awaiting code decides the verdict."""
Start = Callable[[], Coroutine[Any, Any, object]]


async def conduct(run: FlightParts) -> None:
    """Fly the run; whatever happens, everything has landed before this returns."""
    for context in run.pair.contexts:
        run.oracle_runner.attach(context)
        _record_events(run, context)
    for context in run.pair.actors:
        _record_events(run, context)
    run.feed.attach(run.pair.contexts, run.oracle_runner, run.perception)
    run.pair.guard.on_event(lambda event: _receive_guard_event(run, event))
    # Autopilots set their local origin anew at arming.
    run.run_state.on_stage(lambda stage, _: run.pair.send_anchors() if stage == "takeoff" else None)
    run_state, watchdog = run.run_state, run.watchdog
    background_jobs: tuple[tuple[str, Start], ...] = (
        ("judging", lambda: run.oracle_runner.run(watchdog.watch("judging"))),
        ("operator", lambda: run.operator_handler.run(watchdog.watch("operator"))),
        ("fences", run.operator_handler.fence_changes.run),
        ("progress", lambda: _follow(run)),
        ("trajectory", lambda: _record(run)),
        ("perception", lambda: run.perception.run(watchdog.watch("mixing budgets"))),
        ("external I/O", lambda: run.external_io.run(run_state)),
        ("watchdog", watchdog.run),
    )
    if (twin := run.twin) is not None and run.setup.companion is not None:
        sign = watchdog.watch("twin distance")
        background_jobs += (("twin distance", lambda: twin.run(run.pair.contexts, sign)),)
    if run.lateness is not None:
        background_jobs += (("lateness", run.lateness.run),)
    async with together() as tasks:
        background = [
            tasks.create_task(_run_until_end(run_state, name, begin), name=name)
            for name, begin in background_jobs
        ]
        flight = tasks.create_task(_flight(run), name="flight")
        over = tasks.create_task(run_state.over.wait(), name="over")
        try:
            await asyncio.wait([flight, over, *background], return_when=asyncio.FIRST_COMPLETED)
        finally:
            await finish(_finish(run, flight), name="landing")
            await stop(over, *background)


async def _run_until_end(run_state: RunState, name: str, begin: Start) -> None:
    """Run a task until the end of the run; an earlier end decides the run as ERROR.

    It raises nothing: the other tasks of its group have to go through the landing.
    """
    with run_state.recording_faults(name):
        await begin()
        run_state.decide("ERROR", f"{name} ended before the flight did")


async def _finish(run: FlightParts, flight: "asyncio.Task[None]") -> None:
    """End the run's flight; unless it landed by itself, the guard brings all down.

    An internal exception in one step does not keep the later steps from being done.
    """
    run_state = run.run_state
    await _run_end_step(run_state, "ending the flight", lambda: stop(flight))
    for _ in range(_LANDINGS):
        if await _run_end_step(run_state, "landing", lambda: _land(run)):
            break
    if not run_state.decisive:
        await _run_end_step(run_state, "the last signs of life", run.watchdog.last_signs)
    await _run_end_step(run_state, "ending fence changes", run.operator_handler.fence_changes.end)
    await _run_end_step(run_state, "restoring the onboard configuration", lambda: _restore(run))
    if run_state.reached("landed"):
        await _run_end_step(
            run_state, "fetching the vehicles' logs", run.before_arming.configuration.fetch_logs
        )


async def _run_end_step(run_state: RunState, name: str, do: Start) -> bool:
    """Run a step of the run's end; return whether it raised no exception."""
    try:
        with run_state.recording_faults(name):
            await do()
            return True
    except EXPECTED as error:
        run_state.decide("ERROR", str(error))
    return False


async def _land(run: FlightParts) -> None:
    """Bring the run's vehicles down, or check that they are."""
    down = verify_landed if run.run_state.reached("landed") else bring_down
    await down(run.pair, run.run_state)


async def _restore(run: FlightParts) -> None:
    """Restore the onboard configuration of the run's vehicles, of none that may be in the air."""
    await run.before_arming.restore(at_rest=await confirmed_at_rest(run.pair))


def _record_events(run: FlightParts, context: VehicleContext) -> None:
    context.driver.on_event(lambda event: run.recorder.vehicle_event(context.name, event))


async def _flight(run: FlightParts) -> None:
    """Fly the run's stages; an error decides the run and is not raised."""
    with run.run_state.recording_faults("flight"):
        try:
            await _fly_stages(run)
        except (VehicleError, FlightError) as error:
            run.run_state.decide("ERROR", str(error))


async def _fly_stages(run: FlightParts) -> None:
    """Fly the run's stages with the pair, and its actors meanwhile."""
    async with together() as tasks:
        flying = [
            tasks.create_task(actor.fly(), name=f"actor {actor.name}") for actor in run.actors
        ]
        await _fly_pair_stages(run)
        await stop(*flying)


async def _fly_pair_stages(run: FlightParts) -> None:
    setup = run.setup
    await fly_together(
        run.pair.contexts,
        run_state=run.run_state,
        operator_hold=run.operator_hold,
        sync=setup.case.sync,
        heights_m={vehicle.name: setup.height_m(vehicle) for vehicle in setup.vehicles},
        liftoff_delays_s=setup.liftoff_delays_s,
        stagger=run.sync.stagger,
        before_arming=run.before_arming.apply,
        barrier=run.sync.check_takeoff,
        goal=run.goal.fly,
        others_landed=[actor.landed.wait for actor in run.actors],
        arm=setup.order.arm,
    )


def _receive_guard_event(run: FlightParts, event: GuardEvent) -> None:
    """Record a guard event in the run, and decide the run by it if it is decisive."""
    run.recorder.guard_event(event)
    run.operator_hold.receive(event)
    run.reporter.guard(event)
    run.feed.guard(event)
    if event.kind == "alone":
        _drop_out(run, event)
    settled = decisive(event)
    if event.kind == "silence" and (autonomy := _holding_autonomy(run)) is not None:
        name, text = autonomy
        run.run_state.decide("FAIL", text, t_s=event.t_s, source=f"autonomy/{name}")
    elif settled is not None:
        text = settled.text + _last_texts(run, event)
        run.run_state.decide(settled.kind, text, t_s=settled.t_s, source=settled.source)


def _last_texts(run: FlightParts, event: GuardEvent) -> str:
    armed_s = run.run_state.entered_s.get("arm")
    return last_statustext(run.pair, event, armed_s=armed_s)


def _holding_autonomy(run: FlightParts) -> tuple[str, str] | None:
    """Return the vehicle whose autonomy has kept the loop from running, and how; None for none."""
    for name, runner in run.goal.runners.items():
        if isinstance(runner, AutonomyRunner) and (held := runner.held_up()):
            return name, f"the autonomy of {name} {held}"
    return None


def _drop_out(run: FlightParts, event: GuardEvent) -> None:
    """Handle that the guard lands one vehicle alone: it drops out, or the run is an ERROR.

    Before the takeoff no flight can continue, and without its actor a run proves nothing.
    """
    text = event.text + _last_texts(run, event)
    is_actor = any(actor.name == event.vehicle for actor in run.actors)
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
        run.oracle_runner.clearance_m,
    )
