"""Runs the tasks of a run while its vehicles fly, and lands everything at its end."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from wil_campaign.foundation.tasks import (
    SuppressedErrors,
    finish_in_task,
    open_task_group,
    stop_tasks,
)
from wil_campaign.orchestrator.run.flight.run_parts import FlightParts
from wil_campaign.orchestrator.run.perception.autonomy_calls import AutonomyFault
from wil_campaign.orchestrator.run.stages.pair_flight import fly_together
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.state.run_state import FlightError, RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.recipes.working import StepError
from wil_campaign.safety.guard.core.commands import BringDown
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import GuardEvent, decisive_guard_event
from wil_campaign.vehicles.driver.vehicle_state import StatusText
from wil_campaign.vehicles.errors import VehicleError

_LISTENER = SuppressedErrors("a listener to the guard's events", later=True)
_LANDINGS = 3
"""How often a landing is started when an internal exception interrupts it."""
EXPECTED = (VehicleError, FlightError, StepError, AutonomyFault)
"""Exceptions that are findings about a run, not bugs: the awaiting code decides the verdict."""
Start = Callable[[], Coroutine[Any, Any, object]]


async def conduct_flight(run: FlightParts) -> None:
    """Fly the run; whatever happens, everything has landed before this returns."""
    for context in run.pair.contexts:
        run.oracle_runner.attach(context)
        _record_events(run, context)
    for context in run.pair.actors:
        _record_events(run, context)
    run.feeds.attach(run.pair.contexts, run.oracle_runner, run.perception)
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
    async with open_task_group() as tasks:
        background = [
            tasks.create_task(_run_until_end(run_state, name, begin), name=name)
            for name, begin in background_jobs
        ]
        flight = tasks.create_task(_flight(run), name="flight")
        over = tasks.create_task(run_state.over.wait(), name="over")
        try:
            await asyncio.wait([flight, over, *background], return_when=asyncio.FIRST_COMPLETED)
        finally:
            await finish_in_task(_finish(run, flight), name="landing")
            await stop_tasks(over, *background)


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
    await _run_end_step(run_state, "ending the flight", lambda: stop_tasks(flight))
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
    down = verify_landed if run.run_state.reached("landed") else bring_vehicles_down
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
    async with open_task_group() as tasks:
        flying = [
            tasks.create_task(actor.fly(), name=f"actor {actor.name}") for actor in run.actors
        ]
        await _fly_pair_stages(run)
        await stop_tasks(*flying)


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
        check_again=run.before_arming.check_again,
        barrier=run.sync.check_takeoff,
        goal=run.goal.fly,
        others_landed=[actor.landed.wait for actor in run.actors],
        arm=setup.order.arm,
    )


def _receive_guard_event(run: FlightParts, event: GuardEvent) -> None:
    """Record a guard event in the run, and decide the run by it if it is decisive.

    A listener that raises keeps it from neither the others nor the run.
    """
    for listener in (
        run.recorder.guard_event,
        run.operator_hold.receive,
        run.reporter.guard,
        run.feeds.guard,
    ):
        with _LISTENER:
            listener(event)
    if event.kind == "alone":
        _drop_out(run, event)
    settled = decisive_guard_event(event)
    if event.kind == "silence" and (held := run.goal.holding_autonomy()) is not None:
        name, how = held
        text = f"the autonomy of {name} {how}"
        run.run_state.decide("FAIL", text, t_s=event.t_s, source=f"autonomy/{name}")
    elif settled is not None:
        text = settled.text + _last_texts(run, event)
        run.run_state.decide(settled.kind, text, t_s=settled.t_s, source=settled.source)


def _last_texts(run: FlightParts, event: GuardEvent) -> str:
    armed_s = run.run_state.entered_s.get("arm")
    return last_statustext(run.pair, event, armed_s=armed_s)


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
        run.feeds.tick()

    await run.recorder.follow(run.pair.contexts, run.run_state, alive)


async def _follow(run: FlightParts) -> None:
    """Report the run's progress until cancelled."""
    await run.reporter.follow(
        run.pair.contexts,
        lambda: run.perception.statistics,
        run.oracle_runner.clearance_m,
    )


_ALL_DOWN_S = 60.0
"""How long the guard may take to land all, with its own retries and escalation."""
_AGREED_S = 3.0
"""Three heartbeats: the guard has so long to confirm what the driver reported."""


async def bring_vehicles_down(pair: VehiclePair, run_state: RunState) -> None:
    """Have the guard land every vehicle that is in the air or armed, and wait for it."""
    guard = pair.guard
    first = run_state.decisive[0].text if run_state.decisive else "the flight was not completed"
    if run_state.reached("arm"):
        run_state.enter("land")
    guard.send(BringDown(first))
    if not await guard.all_down(_ALL_DOWN_S):
        still = ", ".join(f"{name} ({phase.value})" for name, phase in guard.phases.items())
        run_state.decide("ERROR", f"not down {_ALL_DOWN_S:g} s after the guard took over: {still}")
        return
    if run_state.reached("takeoff") and not any(
        context.driver.state.armed for context in pair.contexts
    ):
        run_state.enter("landed")


async def verify_landed(pair: VehiclePair, run_state: RunState) -> None:
    """Check with the guard that all vehicles have landed; else have it land them.

    A heartbeat that was replayed, or comes from another vehicle with the same system ID, may report
    an armed vehicle as disarmed: it must not be left alone in the air.
    """
    if await pair.guard.at_rest(_AGREED_S):
        return
    text = f"the guard did not confirm within {_AGREED_S:g} s that all vehicles are disarmed"
    run_state.decide("ERROR", text)
    await bring_vehicles_down(pair, run_state)


async def confirmed_at_rest(pair: VehiclePair) -> frozenset[str]:
    """Return the vehicles of a run that the guard confirms to be disarmed."""
    if await pair.guard.at_rest(_AGREED_S):
        return frozenset(pair.guard.phases)
    return frozenset(
        name for name, phase in pair.guard.phases.items() if phase is ContingencyPhase.DOWN
    )


_LAST_TEXTS = 4
_FRESH_S = 2.0
"""An older text may have another cause: its age is shown, or it is left out."""
_WARNING = 4
"""MAV_SEVERITY_WARNING: a graver text may explain an end long after it, a lesser one may not."""


def last_statustext(pair: VehiclePair, event: GuardEvent, *, armed_s: float | None) -> str:
    """Return the last texts of the vehicle of a guard event: lost, failsafe, landed alone.

    armed_s: when the vehicles were to arm; texts of the preflight ended no flight. What only tells
    of the flight's course, as "Takeoff detected", is left out unless it was among the last things
    that the vehicle sent.
    """
    context = next(
        (one for one in (*pair.contexts, *pair.actors) if one.name == event.vehicle), None
    )
    if context is None or event.kind not in {"lost", "failsafe", "alone"}:
        return ""
    state = context.driver.state
    received_s = (
        event.t_s if state.last_received_s is None else min(event.t_s, state.last_received_s)
    )
    recent = [
        statustext
        for statustext in state.texts
        if (armed_s is None or statustext.t_s >= armed_s)
        and (statustext.severity <= _WARNING or received_s - statustext.t_s < _FRESH_S)
    ]
    texts = [_with_age(statustext, event.t_s) for statustext in recent[-_LAST_TEXTS:]]
    return f"; its last STATUSTEXT: {' | '.join(texts)}" if texts else ""


def _with_age(statustext: StatusText, t_s: float) -> str:
    """Return a text; with its age if it was sent long before the event."""
    since_s = t_s - statustext.t_s
    text = statustext.text.strip()
    return f"{text} ({since_s:.0f} s before)" if since_s >= _FRESH_S else text
