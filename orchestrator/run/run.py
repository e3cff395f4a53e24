"""Fly one run: from starting the pair to its result."""

import asyncio
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

from orchestrator.clock import run_on
from orchestrator.faults import fault_log
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
from orchestrator.run.outcome import broken_result, outside_result, result_of
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
from safety.judge import COLLISION_ALWAYS, Judge
from safety.results import Flag
from safety.tape import WorldEvent
from vehicles.errors import VehicleError
from vehicles.links.base import LinkError
from vehicles.readings import Reading
from vehicles.tasks import FAULTS, TaskAccount, asked_to_end, finish, stop, together
from worlds.motion import MOMENTS

_LANDINGS = 3
"""How often a landing is begun in which an exception of ours comes up."""
EXPECTED = (VehicleError, FlightError, StepError, AutonomyFault)
"""What a run knows of: who awaits a task that ends by one of these decides what it means."""

Start = Callable[[], Coroutine[Any, Any, object]]
Disturb = Callable[[Pair, Course], None]
"""Is handed the pair once it is there, to make trouble at times of its own: kill, mute, break."""


def fly(
    setup: RunSetup, report: Report, inbox: Inbox, *, disturb: Disturb | None = None
) -> RunResult:
    """Fly one run on its clock and return its result; its streams are in its folder then.

    disturb: for runs that are to show what a fault leads to.
    """
    warm_up(setup)
    flown = Flown(setup)
    try:
        run_on(setup.clock, flown.fly(report, inbox, disturb))
    except FAULTS as error:
        if flown.course is None:
            raise
        flown.course.fault(error, "the run's loop")
    return flown.result()


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
    judge: Judge
    bench: Bench
    outside: Outside
    recorder: RunRecorder
    sync: Synchronisation
    telling: Telling
    preflight: Preflight
    perception: Perception | None = None


class Flown:
    """One run from its begin to its result, also where an exception of ours cut it short."""

    def __init__(self, setup: RunSetup) -> None:
        self._setup = setup
        self._began_s = time.monotonic()
        self._ground: _Ground | None = None
        self._end_s = 0.0
        self.course: Course | None = None

    async def fly(self, report: Report, inbox: Inbox, disturb: Disturb | None) -> None:
        """Fly; what is raised meanwhile, and a task that does not end as asked, is decisive."""
        setup, loop = self._setup, asyncio.get_running_loop()
        course = Course(time=loop.time, log_fault=fault_log(setup.order.folder / "log.jsonl"))
        self.course = course
        loop.set_exception_handler(partial(_unhandled, course))
        account = TaskAccount(fault=course.fault, expected=EXPECTED)
        with account.of(loop), course.taking("the run"):
            await self._fly(course, report, inbox, disturb)
        self._end_s = loop.time()

    async def _fly(
        self, course: Course, report: Report, inbox: Inbox, disturb: Disturb | None
    ) -> None:
        setup = self._setup
        with ExitStack() as streams:
            ground = self._ground = _ground_of(setup, course, report, streams)
            try:
                await _fly_pair(ground, inbox, disturb)
            except AutonomyFault as fault:
                course.decide("FAIL", str(fault), source="autonomy", trace=fault.trace)
            except (VehicleError, LinkError, StepError) as error:
                course.decide("ERROR", str(error))
            except FAULTS as error:
                if asked_to_end(error):
                    raise
                # Taken here, for the streams are open still.
                course.fault(error, "the run")
            course.enter("end")

    def result(self) -> RunResult:
        """Return what the run came to, its loop being closed."""
        course, ground = self.course, self._ground
        if course is None:
            raise RuntimeError("the run has not begun")
        wall_s = time.monotonic() - self._began_s
        end_s = course.entered_s.get("end", self._end_s)
        if ground is not None:
            with course.taking("the result"):
                return result_of(
                    setup=self._setup,
                    course=course,
                    judge=ground.judge,
                    sync=ground.sync.result(),
                    mixings=() if ground.perception is None else ground.perception.mixings,
                    collisions=tuple(ground.recorder.collisions),
                    outside=outside_result(ground.outside, ground.perception),
                    artifacts=ground.recorder.artifacts,
                    preflight=ground.preflight.items,
                    fence_changes=tuple(ground.bench.fence_changes),
                    end_s=end_s,
                    wall_s=wall_s,
                )
        return broken_result(self._setup, course, end_s=end_s, wall_s=wall_s)


def _ground_of(setup: RunSetup, course: Course, report: Report, streams: ExitStack) -> _Ground:
    """Return what stands before the vehicles do, its streams open."""
    events: dict[str, float] = {}
    judge = build_judge(setup, events)
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
    return _Ground(
        setup=setup,
        course=course,
        events=events,
        judge=judge,
        bench=bench,
        outside=outside,
        recorder=recorder,
        sync=Synchronisation(setup=setup.campaign.sync, course=course),
        telling=telling,
        preflight=Preflight(setup=setup),
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
    course, watchdog = run.course, run.watchdog
    lasting: tuple[tuple[str, Start], ...] = (
        ("judging", lambda: run.bench.run(watchdog.watch("judging"))),
        ("operator", lambda: run.commanding.run(watchdog.watch("operator"))),
        ("fences", run.commanding.fencing.run),
        ("progress", lambda: _follow(run)),
        ("trajectory", lambda: _record(run)),
        ("perception", lambda: run.perception.run(watchdog.watch("mixing budgets"))),
        ("outside", lambda: run.outside.run(course)),
        ("watchdog", watchdog.run),
    )
    async with together() as tasks:
        background = [
            tasks.create_task(_last(course, name, begin), name=name) for name, begin in lasting
        ]
        flight = tasks.create_task(_flight(run), name="flight")
        over = tasks.create_task(course.over.wait(), name="over")
        try:
            await asyncio.wait([flight, over, *background], return_when=asyncio.FIRST_COMPLETED)
        finally:
            await finish(_finish(run, flight), name="landing")
            await stop(over, *background)


async def _last(course: Course, name: str, begin: Start) -> None:
    """Do what goes on until the end of the run; that it ends before is decisive.

    It raises nothing: the others of its group have to see the landing.
    """
    with course.taking(name):
        await begin()
        course.decide("ERROR", f"{name} ended before the flight did")


async def _finish(run: _Run, flight: "asyncio.Task[None]") -> None:
    """End the flight; unless it landed by itself, have the guard bring all down.

    An exception of ours keeps nothing from being done that comes after it.
    """
    course = run.course
    await _step(course, "the end of the flight", lambda: stop(flight))
    for _ in range(_LANDINGS):
        if await _step(course, "landing", lambda: _land(run)):
            break
    if not course.decisive:
        await _step(course, "the last signs of life", run.watchdog.last_signs)
    await _step(course, "the end of fence changes", run.commanding.fencing.end)
    await _step(course, "what is taken back", run.aboard.take_back)
    if course.reached("landed"):
        await _step(course, "the vehicles' logs", run.aboard.fetch_logs)


async def _step(course: Course, name: str, do: Start) -> bool:
    """Do a step of the end of a run; return whether it was done without an exception."""
    try:
        with course.taking(name):
            await do()
            return True
    except EXPECTED as error:
        course.decide("ERROR", str(error))
    return False


async def _land(run: _Run) -> None:
    down = see_at_rest if run.course.reached("landed") else bring_down
    await down(run.pair, run.course)


def _unhandled(course: Course, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Take an error in a callback of the loop: physics gone wrong, a recording that broke off."""
    error = context.get("exception")
    if isinstance(error, BaseException):
        course.fault(error, "in flight")
    else:
        course.decide("ERROR", f"in flight: {context.get('message', '')}")


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
    """Fly the stages; what goes wrong is decisive, and raised by nobody."""
    with run.course.taking("flight"):
        try:
            await _fly_stages(run)
        except (VehicleError, FlightError) as error:
            run.course.decide("ERROR", str(error))


async def _fly_stages(run: _Run) -> None:
    setup = run.setup
    await fly_together(
        run.pair.stations,
        course=run.course,
        holding=run.holding,
        sync=setup.campaign.sync,
        heights_m={one.name: setup.height_m(one) for one in setup.vehicles},
        before_arming=partial(prove_and_anchor, setup, run.pair.stations, run.outside, run.aboard),
        barrier=run.sync.check_takeoff,
        goal=run.goal.fly,
        prepare=run.aboard.put,
        preflight=partial(run.preflight.check, note=run.recorder.note),
        arm=setup.order.arm,
    )


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
