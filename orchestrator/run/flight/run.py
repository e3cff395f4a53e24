"""Fly one run: from starting the pair to its result."""

import asyncio
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

from orchestrator.external.external_io import ExternalIo
from orchestrator.model.clock import run_on
from orchestrator.model.faults import fault_log
from orchestrator.model.operator_command import Inbox
from orchestrator.model.progress import Report
from orchestrator.model.results import Loss, RunResult
from orchestrator.recording.run_recorder import RunRecorder
from orchestrator.run.flight.anchor_capture import prove_and_anchor
from orchestrator.run.flight.goal_flight import GoalFlight
from orchestrator.run.flight.landing import bring_down, see_at_rest
from orchestrator.run.flight.operator_handler import OperatorHandler, operator_handler_of
from orchestrator.run.flight.operator_hold import OperatorHold
from orchestrator.run.flight.oracle_runner import OracleRunner
from orchestrator.run.flight.pair_flight import fly_together
from orchestrator.run.flight.progress_reporter import ProgressReporter
from orchestrator.run.flight.recorder_factory import recorder_of
from orchestrator.run.flight.run_feed import RunFeed
from orchestrator.run.flight.run_oracles import build_judge
from orchestrator.run.flight.run_outcome import broken_result, external_result, result_of
from orchestrator.run.flight.synchronisation import Synchronisation
from orchestrator.run.flight.twin_monitor import TwinMonitor
from orchestrator.run.flight.watchdog import Watchdog
from orchestrator.run.perception.autonomy_calls import AutonomyFault
from orchestrator.run.perception.perception import Perception
from orchestrator.run.perception.perception_builder import PerceptionWatchers, build_perception
from orchestrator.run.perception.runner_factory import AnyRunner, open_runners
from orchestrator.run.perception.warm_up import warm_up
from orchestrator.run.vehicles.last_statustext import last_statustext
from orchestrator.run.vehicles.onboard_configuration import OnboardConfiguration
from orchestrator.run.vehicles.pair import Pair, open_pair
from orchestrator.run.vehicles.preflight_checks import Preflight
from orchestrator.state.mixtures import PreviewImages
from orchestrator.state.run_setup import RunSetup
from orchestrator.state.run_state import FlightError, RunState, Stage
from orchestrator.state.signal_faults import SignalFaults
from orchestrator.state.vehicle_context import VehicleContext
from recipes.working import StepError
from safety.evaluation.judge import COLLISION_ALWAYS, Judge
from safety.evaluation.judge_log import WorldEvent
from safety.guard.core.events import GuardEvent, decisive
from safety.model.oracle_results import Flag
from vehicles.errors import VehicleError
from vehicles.links.link import LinkError
from vehicles.readings import Reading
from vehicles.tasks import FAULTS, TaskAccount, asked_to_end, finish, stop, together
from worlds.scene.motion import MOMENTS

_LANDINGS = 3
"""How often a landing is begun in which an exception of ours comes up."""
EXPECTED = (VehicleError, FlightError, StepError, AutonomyFault)
"""What a run knows of: who awaits a task that ends by one of these decides what it means."""

Start = Callable[[], Coroutine[Any, Any, object]]
Disturb = Callable[[Pair, RunState], None]
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
        if flown.run_state is None:
            raise
        flown.run_state.fault(error, "the run's loop")
    return flown.result()


@dataclass(slots=True, kw_only=True)
class _Run:
    """The parts of a run that its tasks share."""

    setup: RunSetup
    run_state: RunState
    pair: Pair
    bench: OracleRunner
    outside: ExternalIo
    perception: Perception
    recorder: RunRecorder
    goal: GoalFlight
    sync: Synchronisation
    twin: TwinMonitor | None
    holding: OperatorHold
    reporter: ProgressReporter
    aboard: OnboardConfiguration
    watchdog: Watchdog
    commanding: OperatorHandler
    preflight: Preflight
    feed: RunFeed


@dataclass(slots=True, kw_only=True)
class _Ground:
    """The parts of a run that exist before and after its vehicles. perception: once built."""

    setup: RunSetup
    run_state: RunState
    events: dict[str, float]
    judge: Judge
    bench: OracleRunner
    outside: ExternalIo
    recorder: RunRecorder
    sync: Synchronisation
    twin: TwinMonitor | None
    reporter: ProgressReporter
    preflight: Preflight
    feed: RunFeed
    perception: Perception | None = None


class Flown:
    """One run from its begin to its result, also when an exception of ours ends it."""

    def __init__(self, setup: RunSetup) -> None:
        self._setup = setup
        self._began_s = time.monotonic()
        self._ground: _Ground | None = None
        self._end_s = 0.0
        self.run_state: RunState | None = None

    async def fly(self, report: Report, inbox: Inbox, disturb: Disturb | None) -> None:
        """Fly the run; exceptions, and tasks that do not end as asked, are decisive."""
        setup, loop = self._setup, asyncio.get_running_loop()
        run_state = RunState(time=loop.time, log_fault=fault_log(setup.order.folder / "log.jsonl"))
        self.run_state = run_state
        loop.set_exception_handler(partial(_report_unhandled, run_state))
        account = TaskAccount(fault=run_state.fault, expected=EXPECTED)
        with account.of(loop), run_state.taking("the run"):
            await self._fly(run_state, report, inbox, disturb)
        self._end_s = loop.time()

    async def _fly(
        self, run_state: RunState, report: Report, inbox: Inbox, disturb: Disturb | None
    ) -> None:
        """Open the run's streams and fly its vehicles."""
        setup = self._setup
        with ExitStack() as streams:
            ground = self._ground = _ground_of(setup, run_state, report, streams)
            try:
                await _fly_pair(ground, inbox, disturb)
            except AutonomyFault as fault:
                run_state.decide(fault.kind, str(fault), source="autonomy", trace=fault.trace)
            except (VehicleError, LinkError, StepError) as error:
                run_state.decide("ERROR", str(error))
            except FAULTS as error:
                if asked_to_end(error):
                    raise
                # Taken here, for the streams are open still.
                run_state.fault(error, "the run")
            run_state.enter("end")

    def result(self) -> RunResult:
        """Return the run's result, its loop being closed."""
        run_state, ground = self.run_state, self._ground
        if run_state is None:
            raise RuntimeError("the run has not begun")
        wall_s = time.monotonic() - self._began_s
        end_s = run_state.entered_s.get("end", self._end_s)
        if ground is not None:
            with run_state.taking("the result"):
                return result_of(
                    setup=self._setup,
                    run_state=run_state,
                    judge=ground.judge,
                    sync=ground.sync.result(),
                    mixings=() if ground.perception is None else ground.perception.mixings,
                    collisions=tuple(ground.recorder.collisions),
                    outside=external_result(ground.outside, ground.perception),
                    artifacts=ground.recorder.artifacts,
                    preflight=ground.preflight.items,
                    fence_changes=tuple(ground.bench.fence_changes),
                    twin=None if ground.twin is None else ground.twin.result(),
                    losses=tuple(
                        Loss(one.topic, one.offered, one.lost) for one in ground.recorder.losses
                    ),
                    end_s=end_s,
                    wall_s=wall_s,
                )
        return broken_result(self._setup, run_state, end_s=end_s, wall_s=wall_s)


def _ground_of(setup: RunSetup, run_state: RunState, report: Report, streams: ExitStack) -> _Ground:
    """Return the run's parts that exist before its vehicles, streams open."""
    events: dict[str, float] = {}
    judge = build_judge(setup, events)
    kinds = {use.name: use.kind for use in (*setup.campaign.oracles, COLLISION_ALWAYS)}
    recorder = streams.enter_context(recorder_of(setup, run_state, kinds))
    run_state.on_stage(recorder.stage)
    run_state.on_decisive(recorder.decisive)
    reporter = ProgressReporter(
        plan=setup.order.plan, report=report, run_state=run_state, kinds=kinds
    )
    feed = streams.enter_context(
        RunFeed(
            setup=setup,
            run_state=run_state,
            events=events,
            epoch_ns=recorder.epoch_ns,
            note=lambda text: recorder.note("live feed", fault=text),
        )
    )
    outside = ExternalIo(setup=setup, events=events)
    bench = OracleRunner(
        judge=judge,
        run_state=run_state,
        kinds=kinds,
        watch=(recorder.flag, reporter.flag, feed.flag, partial(_contact, outside, kinds)),
        tape=recorder.judged,
    )
    return _Ground(
        setup=setup,
        run_state=run_state,
        events=events,
        judge=judge,
        bench=bench,
        outside=outside,
        recorder=recorder,
        sync=Synchronisation(setup=setup.campaign.sync, run_state=run_state),
        twin=_twin_monitor(setup, run_state),
        reporter=reporter,
        preflight=Preflight(setup=setup),
        feed=feed,
    )


def _twin_monitor(setup: RunSetup, run_state: RunState) -> TwinMonitor | None:
    """Return what watches the twin beside the judged vehicle; None where there is none."""
    if setup.mode != "wil":
        return None
    return TwinMonitor(
        coupling=setup.vehicle("twin").coupling,
        limit_m=setup.campaign.sync.max_twin_distance_m,
        run_state=run_state,
    )


async def _fly_pair(ground: _Ground, inbox: Inbox, disturb: Disturb | None) -> None:
    """Start the vehicles, fly them, and have them down and gone before this returns."""
    async with ground.outside as outside:
        if outside.disagreements:
            # What is mixed in would not be what is judged: nothing has to be flown to know that.
            text = "; ".join(outside.disagreements)
            ground.run_state.decide("INVALID", text, source="simulator")
            return
        await _fly_in_world(ground, inbox, disturb)


async def _fly_in_world(ground: _Ground, inbox: Inbox, disturb: Disturb | None) -> None:
    """Start the run's vehicles, fly them, and end them before this returns."""
    setup, outside, run_state = ground.setup, ground.outside, ground.run_state
    record = ground.sync.recording(ground.recorder.frame)
    async with (
        open_pair(setup, record=record, captures=outside.captures) as pair,
        open_runners(setup, pair, run_state) as runners,
    ):
        run = _run_of(ground, pair, runners, inbox)
        if disturb is not None:
            disturb(pair, run_state)
        await _conduct(run)
        ground.bench.last_state(asyncio.get_running_loop().time())


def _run_of(ground: _Ground, pair: Pair, runners: Mapping[str, AnyRunner], inbox: Inbox) -> _Run:
    """Return the run with all its parts connected to the vehicles."""
    setup, run_state, recorder, sync = ground.setup, ground.run_state, ground.recorder, ground.sync
    reporter, bench = ground.reporter, ground.bench
    subject = next(one for one in pair.contexts if one.name == setup.subject)
    run_state.last_note = lambda: subject.note
    ground.outside.attach(pair.contexts)
    faults = SignalFaults(
        setup.campaign.faults,
        run_state=run_state,
        note=lambda text: recorder.note("fault injected", fault=text),
    )
    for context in pair.contexts:
        context.inject(faults)
    ground.perception = perception = build_perception(
        setup,
        pair=pair,
        runners=runners,
        outside=ground.outside,
        run_state=run_state,
        events=ground.events,
        watchers=_watchers(recorder, ground.outside, ground.feed),
        faults=faults,
    )
    goal = GoalFlight(
        runners=perception.runners,
        subject=setup.subject,
        run_state=run_state,
        events=ground.events,
        started=sync.goal_given,
        within_s=setup.campaign.sync.goal_timeout_s,
        companion=setup.companion,
        notify=partial(_world_event, recorder, pair),
    )
    run_state.on_stage(partial(_moment, ground.events, goal.notify))
    sync.attach(pair.contexts)
    if ground.twin is not None and setup.companion is not None:
        ground.twin.attach(setup.companion, needed_by=perception.bound_to_twin)
    pair.begin_outage(setup.campaign.links, run_state)
    aboard = OnboardConfiguration(
        setup=setup, contexts=pair.contexts, run_state=run_state, note=recorder.note
    )
    return _Run(
        setup=setup,
        run_state=run_state,
        pair=pair,
        bench=bench,
        outside=ground.outside,
        perception=perception,
        recorder=recorder,
        goal=goal,
        sync=sync,
        twin=ground.twin,
        holding=OperatorHold(run_state=run_state),
        reporter=reporter,
        aboard=aboard,
        watchdog=Watchdog.of(run_state, setup.campaign.sync, pace=setup.pace),
        commanding=operator_handler_of(
            setup, pair, bench, reporter=reporter, recorder=recorder, inbox=inbox, aboard=aboard
        ),
        preflight=ground.preflight,
        feed=ground.feed,
    )


def _world_event(recorder: RunRecorder, pair: Pair, name: str, t_s: float) -> None:
    """Record an event of the world in the run, and pass it to the vehicles."""
    recorder.judged(WorldEvent(t_s, name))
    pair.notify(name, t_s)


def _moment(
    events: dict[str, float], notify: Callable[[str, float], None], stage: Stage, t_s: float
) -> None:
    """Pass a stage of the run to the world's motions; t0 comes from the goal's flight."""
    if stage in MOMENTS and stage != "goal":
        events[stage] = t_s
        notify(stage, t_s)


async def _conduct(run: _Run) -> None:
    """Fly the run, and in any case have everything down before this returns."""
    for context in run.pair.contexts:
        run.bench.attach(context)
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


async def _finish(run: _Run, flight: "asyncio.Task[None]") -> None:
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
    await _step(run_state, "what is taken back", run.aboard.restore)
    if run_state.reached("landed"):
        await _step(run_state, "the vehicles' logs", run.aboard.fetch_logs)


async def _step(run_state: RunState, name: str, do: Start) -> bool:
    """Do a step of the run's end; return whether it raised no exception."""
    try:
        with run_state.taking(name):
            await do()
            return True
    except EXPECTED as error:
        run_state.decide("ERROR", str(error))
    return False


async def _land(run: _Run) -> None:
    """Bring the run's vehicles down, or check that they are."""
    down = see_at_rest if run.run_state.reached("landed") else bring_down
    await down(run.pair, run.run_state)


def _report_unhandled(
    run_state: RunState, _: asyncio.AbstractEventLoop, context: dict[str, Any]
) -> None:
    """Record an exception of a callback in the run's loop: physics, recording."""
    error = context.get("exception")
    if isinstance(error, BaseException):
        run_state.fault(error, "in flight")
    else:
        run_state.decide("ERROR", f"in flight: {context.get('message', '')}")


def _watchers(recorder: RunRecorder, outside: ExternalIo, feed: RunFeed) -> PerceptionWatchers:
    """Return the run's watchers of perception: recorder, external I/O, live feed."""

    def reading(one: Reading) -> None:
        recorder.reading(one)
        outside.untouched(one)

    def shown(images: PreviewImages) -> None:
        recorder.shown(images)
        feed.shown(images)

    return PerceptionWatchers(
        reading=reading,
        frame=recorder.mixture,
        perceived=outside.perceived,
        shown=shown,
    )


def _contact(outside: ExternalIo, kinds: Mapping[str, str], flag: Flag) -> None:
    """Send a collision of the run to external I/O."""
    if kinds.get(flag.oracle) == "collision":
        outside.contact(flag)


def _record_events(run: _Run, context: VehicleContext) -> None:
    """Record a vehicle's events in the run."""
    context.driver.on_event(lambda event: run.recorder.vehicle_event(context.name, event))


async def _flight(run: _Run) -> None:
    """Fly the run's stages; what goes wrong is decisive, not raised."""
    with run.run_state.taking("flight"):
        try:
            await _fly_stages(run)
        except (VehicleError, FlightError) as error:
            run.run_state.decide("ERROR", str(error))


async def _fly_stages(run: _Run) -> None:
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
        before_arming=partial(prove_and_anchor, setup, run.pair.contexts, run.outside, run.aboard),
        barrier=run.sync.check_takeoff,
        goal=run.goal.fly,
        prepare=run.aboard.put,
        preflight=partial(run.preflight.check, note=run.recorder.note),
        arm=setup.order.arm,
    )


def _guard_event(run: _Run, event: GuardEvent) -> None:
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


def _drop_out(run: _Run, event: GuardEvent) -> None:
    """Take that the guard lands a vehicle alone; before the takeoff there is no flight to go on."""
    text = event.text + last_statustext(run.pair, event)
    if run.run_state.reached("takeoff"):
        run.run_state.drop_out(event.vehicle, text)
    else:
        source = f"guard.{event.kind}/{event.vehicle}"
        run.run_state.decide("ERROR", text, t_s=event.t_s, source=source)


async def _record(run: _Run) -> None:
    """Record the run's trajectories until cancelled."""
    sign = run.watchdog.watch("trajectory")

    def alive() -> None:
        sign()
        run.feed.tick()

    await run.recorder.follow(run.pair.contexts, run.run_state, alive)


async def _follow(run: _Run) -> None:
    """Report the run's progress until cancelled."""
    await run.reporter.follow(
        run.pair.contexts,
        lambda: run.perception.statistics,
        run.bench.clearance_m,
    )
