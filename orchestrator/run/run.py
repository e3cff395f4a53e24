"""Fly one run: from starting the pair to its result."""

import asyncio
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

from orchestrator.clock import run_on
from orchestrator.operator import Inbox
from orchestrator.outside.outside import Outside
from orchestrator.progress import Report
from orchestrator.recording.run_recorder import RunRecorder
from orchestrator.results import RunResult
from orchestrator.run.aboard import Aboard
from orchestrator.run.anchoring import prove_and_anchor
from orchestrator.run.answers import AutonomyFault
from orchestrator.run.arranging import Watchers, build_perception
from orchestrator.run.commanding import Commanding, commanding_of
from orchestrator.run.course import Course, FlightError, Stage
from orchestrator.run.flight import fly_together
from orchestrator.run.goal import GoalFlight
from orchestrator.run.grounding import bring_down, see_at_rest
from orchestrator.run.holding import Holding
from orchestrator.run.judging import Bench
from orchestrator.run.last_words import last_words
from orchestrator.run.opening import Pair, open_pair
from orchestrator.run.oracles import build_judge
from orchestrator.run.outcome import outside_result, result_of
from orchestrator.run.perceiving import Perception
from orchestrator.run.pilots import AnyPilot, open_pilots
from orchestrator.run.preflight import Preflight
from orchestrator.run.recorder import recorder_of
from orchestrator.run.setup import RunSetup
from orchestrator.run.station import Station
from orchestrator.run.synchronisation import Synchronisation
from orchestrator.run.telling import Telling
from orchestrator.run.warming import warm_up
from orchestrator.run.watchdog import Watchdog
from recipes.working import StepError
from safety.guard.events import GuardEvent, decisive
from safety.judge import COLLISION_ALWAYS
from safety.results import Flag
from safety.tape import WorldEvent
from vehicles.errors import VehicleError
from vehicles.links.base import LinkError
from vehicles.readings import Reading
from worlds.motion import MOMENTS

Disturb = Callable[[Pair, Course], None]
"""Is handed the pair once it is there, to make trouble at times of its own: kill, mute, break."""


def fly(
    setup: RunSetup, report: Report, inbox: Inbox, *, disturb: Disturb | None = None
) -> RunResult:
    """Fly one run on its clock and return its result; its streams are in its folder then.

    disturb: for runs that are to show what a fault leads to.
    """
    warm_up(setup)
    return run_on(setup.clock, _fly(setup, report, inbox, disturb))


@dataclass(slots=True, kw_only=True)
class _Run:
    """The parts of a run that its tasks share."""

    setup: RunSetup
    course: Course
    pair: Pair
    bench: Bench
    outside: Outside
    perception: Perception
    recorder: RunRecorder
    goal: GoalFlight
    sync: Synchronisation
    holding: Holding
    telling: Telling
    aboard: Aboard
    watchdog: Watchdog
    commanding: Commanding
    preflight: Preflight


@dataclass(slots=True, kw_only=True)
class _Ground:
    """What stands before the vehicles do, and when they are gone. perception: once there is one."""

    setup: RunSetup
    course: Course
    events: dict[str, float]
    bench: Bench
    outside: Outside
    recorder: RunRecorder
    sync: Synchronisation
    telling: Telling
    preflight: Preflight
    perception: Perception | None = None


async def _fly(setup: RunSetup, report: Report, inbox: Inbox, disturb: Disturb | None) -> RunResult:
    began_s = time.monotonic()
    loop = asyncio.get_running_loop()
    course = Course(time=loop.time)
    loop.set_exception_handler(lambda _, context: _unhandled(course, context))
    events: dict[str, float] = {}
    judge = build_judge(setup, events)
    with ExitStack() as streams:
        kinds = {use.name: use.kind for use in (*setup.campaign.oracles, COLLISION_ALWAYS)}
        recorder = streams.enter_context(recorder_of(setup, course, kinds))
        course.on_stage(recorder.stage)
        course.on_decisive(recorder.decisive)
        telling = Telling(plan=setup.order.plan, report=report, course=course, kinds=kinds)
        outside = Outside(setup=setup, events=events)
        bench = Bench(
            judge=judge,
            course=course,
            kinds=kinds,
            watch=(recorder.flag, telling.flag, partial(_contact, outside, kinds)),
            tape=recorder.judged,
        )
        ground = _Ground(
            setup=setup,
            course=course,
            events=events,
            bench=bench,
            outside=outside,
            recorder=recorder,
            sync=Synchronisation(setup=setup.campaign.sync, course=course),
            telling=telling,
            preflight=Preflight(setup=setup),
        )
        try:
            await _fly_pair(ground, inbox, disturb)
        except AutonomyFault as fault:
            course.decide("FAIL", str(fault), source="autonomy", trace=fault.trace)
        except (VehicleError, LinkError, StepError) as error:
            course.decide("ERROR", str(error))
        end_s = course.enter("end")
    return result_of(
        setup=setup,
        course=course,
        judge=judge,
        sync=ground.sync.result(),
        mixings=() if ground.perception is None else ground.perception.mixings,
        collisions=tuple(recorder.collisions),
        outside=outside_result(outside, ground.perception),
        artifacts=recorder.artifacts,
        preflight=ground.preflight.items,
        fence_changes=tuple(bench.fence_changes),
        end_s=end_s,
        wall_s=time.monotonic() - began_s,
    )


async def _fly_pair(ground: _Ground, inbox: Inbox, disturb: Disturb | None) -> None:
    """Start the vehicles, fly them, and have them down and gone before this returns."""
    setup, outside, course = ground.setup, ground.outside, ground.course
    record = ground.sync.recording(ground.recorder.frame)
    async with (
        outside,
        open_pair(setup, record=record, captures=outside.captures) as pair,
        open_pilots(setup, pair, course) as pilots,
    ):
        run = _run_of(ground, pair, pilots, inbox)
        if disturb is not None:
            disturb(pair, course)
        await _conduct(run)
        ground.bench.last_state(asyncio.get_running_loop().time())


def _run_of(ground: _Ground, pair: Pair, pilots: Mapping[str, AnyPilot], inbox: Inbox) -> _Run:
    """Return the run with all its parts tied to the vehicles."""
    setup, course, recorder, sync = ground.setup, ground.course, ground.recorder, ground.sync
    telling, bench = ground.telling, ground.bench
    subject = next(one for one in pair.stations if one.name == setup.subject)
    course.last_note = lambda: subject.note
    ground.outside.attach(pair.stations)
    ground.perception = perception = build_perception(
        setup,
        pair=pair,
        pilots=pilots,
        outside=ground.outside,
        course=course,
        events=ground.events,
        watchers=_watchers(recorder, ground.outside),
    )
    goal = GoalFlight(
        pilots=perception.pilots,
        subject=setup.subject,
        course=course,
        events=ground.events,
        started=sync.goal_given,
        within_s=setup.campaign.sync.goal_timeout_s,
        notify=partial(_world_event, recorder, pair),
    )
    course.on_stage(partial(_moment, ground.events, goal.notify))
    sync.attach(pair.stations)
    pair.go_dark(setup.campaign.links, course)
    aboard = Aboard(setup=setup, stations=pair.stations, course=course, note=recorder.note)
    return _Run(
        setup=setup,
        course=course,
        pair=pair,
        bench=bench,
        outside=ground.outside,
        perception=perception,
        recorder=recorder,
        goal=goal,
        sync=sync,
        holding=Holding(course=course),
        telling=telling,
        aboard=aboard,
        watchdog=Watchdog.of(course, setup.campaign.sync, pace=setup.pace),
        commanding=commanding_of(
            setup, pair, bench, telling=telling, recorder=recorder, inbox=inbox, aboard=aboard
        ),
        preflight=ground.preflight,
    )


def _world_event(recorder: RunRecorder, pair: Pair, name: str, t_s: float) -> None:
    recorder.judged(WorldEvent(t_s, name))
    pair.notify(name, t_s)


def _moment(
    events: dict[str, float], notify: Callable[[str, float], None], stage: Stage, t_s: float
) -> None:
    """Let motions of the world know of a stage; of t0 they learn from the goal's flight."""
    if stage in MOMENTS and stage != "goal":
        events[stage] = t_s
        notify(stage, t_s)


async def _conduct(run: _Run) -> None:
    """Fly, and whatever comes, have everything down before this returns."""
    for station in run.pair.stations:
        run.bench.attach(station)
        _record_events(run, station)
    run.pair.guard.on_event(lambda event: _guard_event(run, event))
    # They are taken anew at arming.
    run.course.on_stage(lambda stage, _: run.pair.tell_anchors() if stage == "takeoff" else None)
    background = [
        asyncio.create_task(coroutine, name=name)
        for name, coroutine in (
            ("judging", run.bench.run(run.watchdog.watch("judging"))),
            ("operator", run.commanding.run(run.watchdog.watch("operator"))),
            ("fences", run.commanding.fencing.run()),
            ("progress", _follow(run)),
            ("trajectory", _record(run)),
            ("perception", run.perception.run(run.watchdog.watch("mixing budgets"))),
            ("outside", run.outside.run(run.course)),
            ("watchdog", run.watchdog.run()),
        )
    ]
    flight = asyncio.create_task(_flight(run), name="flight")
    over = asyncio.create_task(run.course.over.wait(), name="over")
    try:
        await asyncio.wait([flight, over, *background], return_when=asyncio.FIRST_COMPLETED)
        _end_of_background(run, background)
    finally:
        await asyncio.shield(asyncio.ensure_future(_finish(run, flight)))
        for task in (over, *background):
            await _stop(task)


async def _finish(run: _Run, flight: "asyncio.Task[None]") -> None:
    """End the flight; unless it landed by itself, have the guard bring all down."""
    await _stop(flight)
    if run.course.reached("landed"):
        await see_at_rest(run.pair, run.course)
    else:
        await bring_down(run.pair, run.course)
    if not run.course.decisive:
        await run.watchdog.last_signs()
    await run.commanding.fencing.end()
    await run.aboard.take_back()
    if run.course.reached("landed"):
        await run.aboard.fetch_logs()


def _end_of_background(run: _Run, background: list["asyncio.Task[None]"]) -> None:
    """Take what ended a task that should go on until the end: an error of ours."""
    for task in background:
        if not task.done() or task.cancelled():
            continue
        error = task.exception()
        if error is None:
            run.course.decide("ERROR", f"{task.get_name()} ended before the flight did")
            continue
        cause = _innermost(error)
        run.recorder.note("error", trace="".join(traceback.format_exception(error)))
        run.course.decide("ERROR", f"{task.get_name()}: {type(cause).__name__}: {cause}")


def _unhandled(course: Course, context: dict[str, Any]) -> None:
    """Take an error in a callback of the loop: physics gone wrong, a recording that broke off."""
    error = context.get("exception")
    said = context.get("message", "") if error is None else f"{type(error).__name__}: {error}"
    course.decide("ERROR", f"in flight: {said}")


def _innermost(error: BaseException) -> BaseException:
    """Return the first error that is no group of errors."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


def _watchers(recorder: RunRecorder, outside: Outside) -> Watchers:
    def reading(one: Reading) -> None:
        recorder.reading(one)
        outside.untouched(one)

    return Watchers(
        reading=reading,
        frame=recorder.mixture,
        perceived=outside.perceived,
        shown=recorder.shown,
    )


def _contact(outside: Outside, kinds: Mapping[str, str], flag: Flag) -> None:
    if kinds.get(flag.oracle) == "collision":
        outside.contact(flag)


def _record_events(run: _Run, station: Station) -> None:
    station.driver.on_event(lambda event: run.recorder.vehicle_event(station.name, event))


async def _flight(run: _Run) -> None:
    """Fly the stages; what goes wrong is decisive."""
    setup = run.setup
    try:
        await fly_together(
            run.pair.stations,
            course=run.course,
            holding=run.holding,
            sync=setup.campaign.sync,
            heights_m={one.name: setup.height_m(one) for one in setup.vehicles},
            before_arming=partial(
                prove_and_anchor, setup, run.pair.stations, run.outside, run.aboard
            ),
            barrier=run.sync.check_takeoff,
            goal=run.goal.fly,
            prepare=run.aboard.put,
            preflight=partial(run.preflight.check, note=run.recorder.note),
            arm=setup.order.arm,
        )
    except (VehicleError, FlightError) as error:
        run.course.decide("ERROR", str(error))


def _guard_event(run: _Run, event: GuardEvent) -> None:
    run.recorder.guard_event(event)
    run.holding.take(event)
    run.telling.guard(event)
    settled = decisive(event)
    if settled is not None:
        text = settled.text + last_words(run.pair, event)
        run.course.decide(settled.kind, text, t_s=settled.t_s, source=settled.source)


async def _record(run: _Run) -> None:
    """Record where all are until cancelled."""
    await run.recorder.follow(run.pair.stations, run.course, run.watchdog.watch("trajectory"))


async def _follow(run: _Run) -> None:
    """Report progress until cancelled."""
    await run.telling.follow(
        run.pair.stations,
        lambda: run.perception.statistics,
        run.bench.clearance_m,
    )


async def _stop(task: "asyncio.Task[Any]") -> None:
    """Cancel a task and wait until it has ended."""
    task.cancel()
    await asyncio.wait([task])
