"""Builds the parts of a run: those that exist before its vehicles, and those of the flight.

Builds the recorder of a run by the campaign's recording settings.
"""

import asyncio
import math
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, fields
from functools import partial
from typing import Any

from wil_campaign.hooks import live_views
from wil_campaign.installed_plugins import loaded_additions
from wil_campaign.orchestrator.external.external_io import ExternalIo
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report
from wil_campaign.orchestrator.recording.mcap.mcap_settings import recording_settings
from wil_campaign.orchestrator.recording.recording_facts import facts_of_run
from wil_campaign.orchestrator.recording.run_recorder import RunRecorder
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.orchestrator.run.flight.lateness import MachineLateness, lateness_remedy
from wil_campaign.orchestrator.run.flight.live_feeds import LiveFeeds
from wil_campaign.orchestrator.run.flight.operator_handler import (
    OperatorHandler,
    operator_handler_of,
)
from wil_campaign.orchestrator.run.flight.progress_reporter import RunProgressReporter
from wil_campaign.orchestrator.run.flight.watchdog import Watchdog, stage_patience_s
from wil_campaign.orchestrator.run.judging.oracle_runner import OracleRunner
from wil_campaign.orchestrator.run.judging.run_evidence import pair_gap_s
from wil_campaign.orchestrator.run.judging.run_oracles import build_judge
from wil_campaign.orchestrator.run.perception.perception import Perception
from wil_campaign.orchestrator.run.perception.perception_builder import (
    PerceptionWatchers,
    build_perception,
)
from wil_campaign.orchestrator.run.perception.runner_factory import AnyRunner
from wil_campaign.orchestrator.run.stages.actor_flight import ActorFlight
from wil_campaign.orchestrator.run.stages.before_arming import BeforeArming
from wil_campaign.orchestrator.run.stages.goal_flight import GoalFlight
from wil_campaign.orchestrator.run.stages.operator_hold import OperatorHold
from wil_campaign.orchestrator.run.stages.synchronisation import Synchronisation
from wil_campaign.orchestrator.run.stages.twin_monitor import TwinMonitor
from wil_campaign.orchestrator.run.vehicles.arming_record import ArmingRecord
from wil_campaign.orchestrator.run.vehicles.onboard_configuration import OnboardConfiguration
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run.vehicles.preflight_checks import PreflightChecks
from wil_campaign.orchestrator.state.mixtures import PreviewImages
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.signal_faults import SignalFaults
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.evaluation.judge import COLLISION_ALWAYS, Judge
from wil_campaign.safety.evaluation.judge_log import ActorPose, LoggedWorldEvent
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.readings import Reading
from wil_campaign.worlds.scene.motion import MOMENTS
from wil_campaign.worlds.scene.track import ObjectTrack, RunHistory


def recorder_of(setup: RunSetup, run_state: RunState, kinds: Mapping[str, str]) -> RunRecorder:
    """Return the recorder of a run, not yet opened; its failure decides the run.

    kinds: of the oracles, by name.
    """
    loop = asyncio.get_running_loop()
    epoch_s = VIRTUAL_EPOCH_S if setup.clock == "virtual" else time.time() - loop.time()
    return RunRecorder(
        folder=setup.order.folder,
        time=loop.time,
        epoch_s=epoch_s,
        # Under the wall clock the guard process logs the frames: its log survives a crash here.
        vehicles=tuple(flown.name for flown in setup.guarded if setup.clock == "virtual"),
        collision_oracles=frozenset(name for name, kind in kinds.items() if kind == "collision"),
        clock=setup.clock,
        settings=recording_settings(setup.case.record),
        broken=lambda why: run_state.decide("ERROR", why, source="recording"),
        facts=facts_of_run(setup),
        fault=run_state.fault,
        incomplete=lambda why: run_state.decide(
            "INVALID", why, source="recording", ends_flight=False
        ),
        max_loss=setup.case.record.max_loss,
    )


@dataclass(slots=True, kw_only=True)
class GroundParts:
    """The parts of a run that exist before and after its vehicles.

    perception, actors, contexts: once built; contexts: of the pair and the actors.
    """

    setup: RunSetup
    run_state: RunState
    events: RunHistory
    judge: Judge
    oracle_runner: OracleRunner
    external_io: ExternalIo
    recorder: RunRecorder
    sync: Synchronisation
    twin: TwinMonitor | None
    reporter: RunProgressReporter
    preflight: PreflightChecks
    arming: ArmingRecord
    feeds: LiveFeeds
    perception: Perception | None = None
    actors: tuple[ActorFlight, ...] = ()
    contexts: tuple[VehicleContext, ...] = ()


@dataclass(slots=True, kw_only=True)
class FlightParts(GroundParts):
    """The parts of a run that its tasks share: those before its vehicles, and these."""

    pair: VehiclePair
    perception: Perception
    goal: GoalFlight
    operator_hold: OperatorHold
    before_arming: BeforeArming
    watchdog: Watchdog
    operator_handler: OperatorHandler
    lateness: MachineLateness | None


def ground_parts(
    setup: RunSetup, run_state: RunState, report: Report, streams: ExitStack
) -> GroundParts:
    """Return the run's parts that exist before its vehicles; opens its recordings on `streams`."""
    events = RunHistory({actor.name: ObjectTrack() for actor in setup.actors})
    judge = build_judge(setup, events)
    kinds = {use.name: use.kind for use in (*setup.case.oracles, COLLISION_ALWAYS)}
    recorder = streams.enter_context(recorder_of(setup, run_state, kinds))
    run_state.on_stage(recorder.stage)
    run_state.on_decisive(recorder.decisive)
    reporter = RunProgressReporter(
        plan=setup.order.plan, report=report, run_state=run_state, kinds=kinds
    )
    feeds = streams.enter_context(
        LiveFeeds(
            {
                name: partial(
                    kind,
                    setup=setup,
                    run_state=run_state,
                    events=events,
                    epoch_ns=recorder.epoch_ns,
                )
                for name, kind in loaded_additions(live_views, "feed").items()
            },
            run_state,
            log=lambda text: recorder.note("live feed", fault=text),
        )
    )
    external_io = ExternalIo(
        setup=setup, events=events, note=lambda text: recorder.note("motion capture", text=text)
    )
    oracle_runner = OracleRunner(
        judge=judge,
        run_state=run_state,
        kinds=kinds,
        flag_watchers=(
            recorder.flag,
            reporter.flag,
            feeds.flag,
            partial(_contact, external_io, kinds),
        ),
        log_sample=recorder.judged,
    )
    return GroundParts(
        setup=setup,
        run_state=run_state,
        events=events,
        judge=judge,
        oracle_runner=oracle_runner,
        external_io=external_io,
        recorder=recorder,
        sync=_synchronisation(setup, run_state),
        twin=_twin_monitor(setup, run_state),
        reporter=reporter,
        preflight=PreflightChecks(setup=setup, note=recorder.note),
        arming=ArmingRecord(now=asyncio.get_running_loop().time, note=recorder.note),
        feeds=feeds,
    )


def _synchronisation(setup: RunSetup, run_state: RunState) -> Synchronisation:
    """Return the synchronisation of a run; a clock that a person answers for has no limit."""
    wanted = setup.case.preflight
    limit_s = math.inf if "clock" in wanted.override else wanted.max_clock_error_s
    return Synchronisation(setup=setup.case.sync, run_state=run_state, max_clock_error_s=limit_s)


def _twin_monitor(setup: RunSetup, run_state: RunState) -> TwinMonitor | None:
    """Return the monitor of the twin beside the judged vehicle; None outside of mode wil."""
    if setup.mode != "wil":
        return None
    return TwinMonitor(
        coupling=setup.vehicle("twin").coupling,
        limit_m=setup.case.sync.max_twin_distance_m,
        max_gap_s=pair_gap_s(setup),
        run_state=run_state,
    )


def flight_parts(
    ground: GroundParts, pair: VehiclePair, runners: Mapping[str, AnyRunner], inbox: OperatorInbox
) -> FlightParts:
    """Return the run with all its parts connected to the vehicles."""
    setup, run_state, recorder, sync = ground.setup, ground.run_state, ground.recorder, ground.sync
    subject = next(context for context in pair.contexts if context.name == setup.subject)
    run_state.note_at = subject.note_at
    ground.contexts = (*pair.contexts, *pair.actors)
    ground.external_io.attach(pair.contexts, pair.guard)
    faults = _signal_faults(ground, pair)
    ground.perception = perception = build_perception(
        setup,
        pair=pair,
        runners=runners,
        external_io=ground.external_io,
        run_state=run_state,
        events=ground.events,
        watchers=_watchers(recorder, ground.external_io, ground.feeds),
        faults=faults,
    )
    goal = _goal_flight(ground, pair, perception)
    sync.attach(pair.contexts)
    sync.watch_clocks(ground.contexts)
    if ground.twin is not None and setup.companion is not None:
        ground.twin.attach(setup.companion, needed_by=perception.bound_to_twin)
    operator_hold = OperatorHold(run_state=run_state)
    ground.actors = _actor_flights(ground, pair, operator_hold)
    before_arming = _before_arming(ground, pair)
    there: dict[str, Any] = {field.name: getattr(ground, field.name) for field in fields(ground)}
    there["perception"] = perception
    return FlightParts(
        **there,
        pair=pair,
        goal=goal,
        operator_hold=operator_hold,
        before_arming=before_arming,
        watchdog=Watchdog(
            run_state=run_state,
            patience_s=stage_patience_s(setup.case.sync),
            pace=setup.pace,
        ),
        operator_handler=operator_handler_of(
            setup,
            pair,
            ground.oracle_runner,
            reporter=ground.reporter,
            recorder=recorder,
            inbox=inbox,
            onboard_fences=before_arming.configuration.fences,
        ),
        lateness=_lateness(setup, run_state, goal),
    )


def _lateness(setup: RunSetup, run_state: RunState, goal: GoalFlight) -> MachineLateness | None:
    """Return what measures how late the run's loop is; None where its clock waits for it."""
    if setup.clock != "wall":
        return None
    remedy = lateness_remedy(virtual=all(flown.embedded for flown in setup.guarded))
    flies_on = any(flown.attached is not None for flown in setup.guarded)
    return MachineLateness(
        run_state=run_state, remedy=remedy, flies_on=flies_on, holding=goal.holding_autonomy
    )


def _signal_faults(ground: GroundParts, pair: VehiclePair) -> SignalFaults:
    """Return the run's signal faults, injected into the pair's pose sources."""
    names = {vehicle.name for vehicle in ground.setup.with_sensors}
    faults = SignalFaults(
        [fault for fault in ground.setup.case.faults if fault.vehicle in names],
        run_state=ground.run_state,
        note=lambda text: ground.recorder.note("fault injected", fault=text),
    )
    for context in pair.contexts:
        context.inject(faults)
    return faults


def _goal_flight(ground: GroundParts, pair: VehiclePair, perception: Perception) -> GoalFlight:
    """Return the flight of the run's goal; it passes the world's events on."""
    setup = ground.setup
    goal = GoalFlight(
        runners=perception.runners,
        subject=setup.subject,
        run_state=ground.run_state,
        events=ground.events,
        started=ground.sync.goal_given,
        within_s=setup.case.sync.goal_timeout_s,
        companion=setup.companion,
        notify=partial(_world_event, ground.recorder, pair),
    )
    ground.run_state.on_stage(partial(_moment, ground.events, goal.notify))
    return goal


def _before_arming(ground: GroundParts, pair: VehiclePair) -> BeforeArming:
    """Return the steps that the run's vehicles go through before they arm."""
    return BeforeArming(
        setup=ground.setup,
        guard=pair.guard,
        contexts=pair.contexts,
        external_io=ground.external_io,
        preflight=ground.preflight,
        configuration=OnboardConfiguration(
            setup=ground.setup,
            contexts=(*pair.contexts, *pair.actors),
            run_state=ground.run_state,
            record=ground.arming,
            note=ground.recorder.note,
        ),
        record=ground.arming,
        actors=pair.actors,
    )


def _actor_flights(
    ground: GroundParts, pair: VehiclePair, operator_hold: OperatorHold
) -> tuple[ActorFlight, ...]:
    """Return the flights of the run's actors; their poses go to world and judge log."""

    def report_pose(sample: PoseSample) -> None:
        t_s, name, pose, velocity_ned_m_s = sample
        ground.recorder.judged(ActorPose(t_s, name, pose, velocity_ned_m_s))
        ground.events.add_pose(name, t_s, pose, velocity_ned_m_s)

    setup = ground.setup
    return tuple(
        ActorFlight(
            setup=actor,
            context=context,
            run_state=ground.run_state,
            operator_hold=operator_hold,
            sync=setup.case.sync,
            events=ground.events,
            report_pose=report_pose,
            send_anchors=pair.send_anchors,
        )
        for actor, context in zip(setup.actors, pair.actors, strict=True)
    )


def _world_event(recorder: RunRecorder, pair: VehiclePair, name: str, t_s: float) -> None:
    """Record an event of the world in the run, and pass it to the vehicles."""
    recorder.judged(LoggedWorldEvent(t_s, name))
    pair.notify(name, t_s)


def _moment(
    events: dict[str, float], notify: Callable[[str, float], None], stage: Stage, t_s: float
) -> None:
    """Pass a stage of the run to the world's motions; GoalFlight passes on t0."""
    if stage in MOMENTS and stage != "goal":
        events[stage] = t_s
        notify(stage, t_s)


def _watchers(
    recorder: RunRecorder, external_io: ExternalIo, feeds: LiveFeeds
) -> PerceptionWatchers:
    """Return the run's watchers of perception: recorder, external I/O, live feeds."""

    def take_reading(reading: Reading) -> None:
        recorder.reading(reading)
        external_io.untouched(reading)

    def take_preview(images: PreviewImages) -> None:
        recorder.shown(images)
        feeds.shown(images)

    return PerceptionWatchers(
        reading=take_reading,
        frame=recorder.mixture,
        perceived=external_io.perceived,
        shown=take_preview,
        images_ended=recorder.images_ended,
    )


def _contact(external_io: ExternalIo, kinds: Mapping[str, str], flag: Flag) -> None:
    """Send a collision of the run to external I/O."""
    if kinds.get(flag.oracle) == "collision":
        external_io.contact(flag)
