"""Builds the result of a run from its decisive events, oracles and statistics."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from wil_campaign.campaigns.setup.named_objects import named_objects
from wil_campaign.orchestrator.external.external_io import ExternalIo
from wil_campaign.orchestrator.run.perception.autonomy_runner import AutonomyRunner
from wil_campaign.orchestrator.run.perception.foreign_runner import ForeignRunner
from wil_campaign.orchestrator.run.perception.mixing_loop import MixingLoop
from wil_campaign.orchestrator.run.perception.perception import Perception
from wil_campaign.orchestrator.run_results.attempts import failed_too_text
from wil_campaign.orchestrator.run_results.result_parts import (
    ArmingStep,
    ExternalResult,
    FlownFirmware,
    TwinResult,
)
from wil_campaign.orchestrator.run_results.run_result import (
    ActorResult,
    CombinationResult,
    FenceChange,
    MixingResult,
    RunResult,
    ShownResult,
    SlowAutonomy,
    SyncResult,
    TopicMessageLoss,
    control_of,
    later_events_of,
    percentiles,
    result_without_parts,
    with_note,
)
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.recipes.visibility.coverage import VisibilityCoverage
from wil_campaign.safety.evaluation.judge import Judge, unjudged_contacts
from wil_campaign.safety.model.oracle_results import Flag, OracleResult
from wil_campaign.safety.model.verdict import RunDecision, decide_verdict, event_source_of
from wil_campaign.safety.preflight import PreflightItem
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.track import object_track_of

_STILL_M, _STILL_RAD = 0.05, 0.05
"""What a vehicle that flies as an object may drift by while it stands."""
_MOMENTS = 200


def run_result_of(
    *,
    setup: RunSetup,
    run_state: RunState,
    judge: Judge,
    sync: SyncResult,
    mixings: tuple[MixingLoop, ...],
    collisions: tuple[Flag, ...],
    outside: ExternalResult | None,
    artifacts: tuple[str, ...],
    preflight: tuple[PreflightItem, ...],
    before_arming: tuple[ArmingStep, ...],
    fence_changes: tuple[FenceChange, ...],
    twin: TwinResult | None,
    losses: tuple[TopicMessageLoss, ...],
    actors: tuple[ActorResult, ...],
    slow: tuple[SlowAutonomy, ...],
    views_ended: tuple[str, ...],
    firmware: tuple[FlownFirmware, ...],
    events: Mapping[str, float],
    end_s: float,
    wall_s: float,
) -> RunResult:
    """Return the outcome of a run, its flight being over at end_s. events: of its world."""
    plan = setup.order.plan
    oracles = judge.results(end_s)
    completed = run_state.reached("landed") and run_state.reached("done")
    decision = decide_verdict(
        run_state.decisive,
        oracles,
        end_s=end_s,
        completed=completed,
        timeouts=judge.timeouts,
        worst=judge.worst_texts,
    )
    note = decision.note or run_state.note_at(decision.at_s)
    reason = outcome_reason(decision, note, oracles, goal_s=run_state.entered_s.get("goal"))
    takeoff_s, landed_s = run_state.entered_s.get("takeoff"), run_state.entered_s.get("landed")
    return RunResult(
        case=plan.case,
        mode=plan.mode,
        rep=plan.repetition,
        seed=plan.seed,
        verdict=decision.verdict,
        reason=reason,
        also=later_events_of(decision),
        required=plan.required,
        duration_s=None if takeoff_s is None else (landed_s or end_s) - takeoff_s,
        wall_s=wall_s,
        oracles=oracles,
        sync=sync,
        mixing=_mixing_result(mixings, named=named_objects(setup.case)),
        collisions=collisions,
        outside=outside,
        artifacts=artifacts,
        preflight=preflight,
        before_arming=before_arming,
        fence_changes=fence_changes,
        evidence=judge.evidence,
        decided_by=decision.source,
        note=note,
        trace=decision.trace,
        not_judged=unjudged_contacts(
            setup.case.oracles, collision_always=setup.case.collision_always
        ),
        control=control_of(plan, decision),
        exceptions=exceptions_of(run_state),
        twin=twin,
        losses=losses,
        actors=actors,
        slow=slow,
        views_ended=views_ended,
        unmoved=unmoved_objects(setup.judged_scene, events, run_state.entered_s),
        no_retry=_no_retry(decision, run_state, judge),
        firmware=firmware,
    )


def _no_retry(decision: RunDecision, run_state: RunState, judge: Judge) -> str:
    """Return why the run is not flown again: the subject's first failure beside the verdict.

    What an oracle finds at the end only (never reached, still armed) is a failure where the
    autonomy was done; in a flight that was ended before, its end is the cause. A vehicle that was
    lost while it landed is not known to have failed that.
    """
    seen = {event.source for event in run_state.decisive}
    if run_state.reached("done"):
        seen |= {event.source for event in decision.also}
        seen -= judge.landings if decision.verdict == "ERROR" else frozenset()
    failures = (
        decisive_event
        for decisive_event in decision.also
        if decisive_event.kind == "FAIL" and decisive_event.source in seen
    )
    return next((failed_too_text(failure.text) for failure in failures), "")


def outcome_reason(
    decision: RunDecision, note: str, oracles: Sequence[OracleResult], *, goal_s: float | None
) -> str:
    """Return the reason of a run's outcome; of a FAIL, with what the autonomy did by then.

    That is its note at that time, or that it had not begun to fly: not where the oracle that
    decided was at its worst later. goal_s: when it began; None where it never did. What an autonomy
    failed by itself, as it started, has its own reason.
    """
    if decision.verdict != "FAIL":
        return decision.reason
    is_own = decision.source.partition("/")[0] == "autonomy"
    worst_s = (
        oracle.at_s
        for oracle in oracles
        if oracle.at_s is not None
        and event_source_of(oracle.name, oracle.vehicle) == decision.source
    )
    at_s = max(decision.at_s, *worst_s, -math.inf)
    has_begun = goal_s is not None and at_s >= goal_s
    return with_note(decision.reason, note, has_begun=is_own or has_begun)


def broken_result(
    setup: RunSetup, run_state: RunState, *, end_s: float, wall_s: float
) -> RunResult:
    """Return the outcome of a run that an internal exception ended before it had any parts."""
    decision = decide_verdict(run_state.decisive, (), end_s=end_s, completed=False)
    exceptions = exceptions_of(run_state)
    return result_without_parts(setup.order.plan, decision, wall_s=wall_s, exceptions=exceptions)


def exceptions_of(run_state: RunState) -> tuple[str, ...]:
    """Return the internal exceptions of a run, each in a line."""
    return tuple(fault.text for fault in run_state.faults)


def external_result(
    external_io: ExternalIo, perception: Perception | None
) -> ExternalResult | None:
    """Return the run's results of external I/O; None without any."""
    runners = () if perception is None else perception.runners.values()
    reporting = (runner for runner in runners if isinstance(runner, AutonomyRunner | ForeignRunner))
    programs = tuple(ended for one in reporting if (ended := one.result) is not None)
    result = replace(external_io.result, programs=programs)
    return result if result.anything else None


def _mixing_result(mixings: tuple[MixingLoop, ...], *, named: set[str]) -> MixingResult | None:
    """Return the run's result of mixing; None without mixing. named: by goal or oracles."""
    if not mixings:
        return None
    combinations = tuple(_combination_result(mixing) for mixing in mixings)
    first = combinations[0]
    return MixingResult(
        frames=first.frames,
        dropped=sum(first.dropped.values()),
        rate_hz=first.rate_hz,
        skew_ms=first.skew_ms,
        latency_ms=first.latency_ms,
        registration_error_px=first.registration_error_px,
        registration_bound_px=first.registration_bound_px,
        combinations=combinations,
        frames_measured=first.frames_measured,
        shown=first.shown,
        not_measured=first.not_measured,
        unseen=_unseen(combinations, named),
    )


def _unseen(combinations: tuple[CombinationResult, ...], named: set[str]) -> tuple[str, ...]:
    """Return the named virtual objects that were looked for and were in view of no mixture.

    Where none at all was in view, so that nothing was mixed: all that mixtures had to show.
    """
    sought: set[str] = set()
    in_view: set[str] = set()
    to_show: set[str] = set()
    for combination in combinations:
        if combination.frames_measured:
            sought.update(combination.shown, combination.not_mixed)
            to_show.update(combination.shown)
        in_view.update(name for name, each in combination.shown.items() if each.frames_in_view)
        in_view.update(name for name, count in combination.not_mixed.items() if count)
    return tuple(sorted((sought & named) - in_view if in_view else (sought & named) | to_show))


def unmoved_objects(
    scene: Scene, events: Mapping[str, float], entered_s: Mapping[Stage, float]
) -> tuple[str, ...]:
    """Return the objects that have a motion and stood still from the takeoff until `done`.

    Of a motion that waits for `done`: until the vehicles have landed. entered_s: of the stages.
    """
    begin_s, done_s = entered_s.get("takeoff"), entered_s.get("done", entered_s.get("land"))
    if begin_s is None or done_s is None:
        return ()
    landed_s = entered_s.get("landed", done_s)
    return tuple(
        scene_object.name
        for scene_object in scene.objects
        if scene_object.motion is not None
        and not _moves(
            scene_object,
            begin_s,
            landed_s if scene_object.motion.start.waits_for == "done" else done_s,
            events,
        )
    )


def _moves(one: SceneObject, begin_s: float, end_s: float, events: Mapping[str, float]) -> bool:
    """Return whether an object is elsewhere, or turned, at some time between two."""
    travel = one.travel(begin_s, end_s, events)
    if travel.length_m < _STILL_M and travel.turn_rad < _STILL_RAD:
        return False
    if object_track_of(one.name, events) is None:
        return True
    # The way of a vehicle that stands grows by the noise of its positions.
    first = one.pose_at(begin_s, events).position_ned_m
    times_s = (begin_s + (end_s - begin_s) * share / _MOMENTS for share in range(1, _MOMENTS + 1))
    return any(
        math.dist(first, one.pose_at(t_s, events).position_ned_m) >= _STILL_M for t_s in times_s
    )


def _combination_result(mixing: MixingLoop) -> CombinationResult:
    statistics, counts = mixing.statistics, mixing.mixer.counts()
    error = statistics.registration_error_px.percentiles()
    bound = statistics.registration_bound_px.percentiles()
    never = {"replaced": statistics.replaced, "missed": statistics.missed}
    unmixed = {reason: count for reason, count in never.items() if count}
    coverage = None if mixing.probe is None else mixing.probe.coverage
    return CombinationResult(
        name=mixing.name,
        sensor=mixing.mixer.combination.sensor.kind,
        publish=mixing.mixer.publish,
        frames=statistics.frames,
        dropped={**dict(counts.dropped), **unmixed},
        faults=dict(counts.faults),
        rate_hz=statistics.rate_hz or 0.0,
        skew_ms=statistics.skew_ms.percentiles(),
        latency_ms=statistics.latency_ms.percentiles(),
        registration_error_px=error if error.p50 is not None else None,
        registration_bound_px=bound if bound.p50 is not None else None,
        frames_measured=0 if coverage is None else coverage.frames,
        shown={} if coverage is None else _shown(coverage),
        not_mixed={} if coverage is None else dict(sorted(coverage.not_mixed.items())),
        not_measured=mixing.unmeasured if coverage is None else coverage.why_not_measured(),
        not_bounded=statistics.unbounded,
    )


def _shown(coverage: VisibilityCoverage) -> dict[str, ShownResult]:
    """Return the run's results of how mixtures showed virtual objects."""
    return {
        name: ShownResult(
            frames_in_view=one.in_view,
            frames_shown=one.shown,
            offset_px=percentiles(one.offsets) if one.unit == "px" else None,
            offset_m=percentiles(one.offsets) if one.unit == "m" else None,
        )
        for name, one in sorted(coverage.objects.items())
    }
