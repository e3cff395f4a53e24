"""The result of a run, from what happened to it."""

from dataclasses import replace

from orchestrator.control_results import control_result
from orchestrator.outside.outside import Outside
from orchestrator.outside.program import ProgramPilot
from orchestrator.outside.results import OutsideResult
from orchestrator.results import (
    Also,
    CombinationResult,
    FenceChange,
    MixingResult,
    RunResult,
    ShownResult,
    SyncResult,
    percentiles,
)
from orchestrator.run.course import Course
from orchestrator.run.mixing import MixingLoop
from orchestrator.run.perceiving import Perception
from orchestrator.run.setup import RunSetup
from recipes.visibility.coverage import Coverage
from safety.judge import COLLISION_ALWAYS, Judge
from safety.preflight import Item
from safety.results import Flag
from safety.verdict import Decision, decide


def result_of(
    *,
    setup: RunSetup,
    course: Course,
    judge: Judge,
    sync: SyncResult,
    mixings: tuple[MixingLoop, ...],
    collisions: tuple[Flag, ...],
    outside: OutsideResult | None,
    artifacts: tuple[str, ...],
    preflight: tuple[Item, ...],
    fence_changes: tuple[FenceChange, ...],
    end_s: float,
    wall_s: float,
) -> RunResult:
    """Return what a run came to, its flight being over at end_s."""
    plan = setup.order.plan
    oracles = judge.results(end_s)
    completed = course.reached("landed") and course.reached("done")
    decision = decide(
        course.decisive, oracles, end_s=end_s, completed=completed, timeouts=judge.timeouts
    )
    note = decision.note or course.last_note()
    reason = reason_of(decision, note)
    takeoff_s, landed_s = course.entered_s.get("takeoff"), course.entered_s.get("landed")
    flown = takeoff_s is not None
    return RunResult(
        case=plan.case,
        mode=plan.mode,
        rep=plan.repetition,
        seed=plan.seed,
        verdict=decision.verdict,
        reason=reason,
        also=also_of(decision),
        required=plan.required,
        duration_s=(landed_s or end_s) - takeoff_s if flown and takeoff_s is not None else None,
        wall_s=wall_s,
        oracles=oracles,
        sync=sync,
        mixing=_mixing(mixings),
        collisions=collisions,
        outside=outside,
        artifacts=artifacts,
        preflight=preflight,
        fence_changes=fence_changes,
        evidence=judge.evidence,
        decided_by=decision.source,
        note=note,
        trace=decision.trace,
        not_judged=() if setup.campaign.collision_always else (COLLISION_ALWAYS.name,),
        control=control_result(
            plan.control,
            verdict=decision.verdict,
            reason=reason,
            decided_by=decision.source,
            subject=setup.subject,
        ),
        exceptions=exceptions_of(course),
    )


def reason_of(decision: Decision, note: str) -> str:
    """Return the reason, with what the autonomy noted last where it is a FAIL."""
    if decision.verdict != "FAIL" or not note:
        return decision.reason
    return f"{decision.reason}; the autonomy's last note was '{note}'"


def broken_result(setup: RunSetup, course: Course, *, end_s: float, wall_s: float) -> RunResult:
    """Return what a run came to of which an exception of ours left no more than that it was."""
    plan = setup.order.plan
    decision = decide(course.decisive, (), end_s=end_s, completed=False)
    return RunResult(
        case=plan.case,
        mode=plan.mode,
        rep=plan.repetition,
        seed=plan.seed,
        verdict=decision.verdict,
        reason=decision.reason,
        also=also_of(decision),
        required=plan.required,
        duration_s=None,
        wall_s=wall_s,
        oracles=(),
        sync=SyncResult(),
        mixing=None,
        decided_by=decision.source,
        control=control_result(
            plan.control,
            verdict=decision.verdict,
            reason=decision.reason,
            decided_by=decision.source,
            subject=setup.subject,
        ),
        exceptions=exceptions_of(course),
    )


def exceptions_of(course: Course) -> tuple[str, ...]:
    """Return the exceptions of ours, each in a line."""
    return tuple(fault.text for fault in course.faults)


def also_of(decision: Decision) -> tuple[Also, ...]:
    """Return what came after the event that made the verdict."""
    return tuple(Also(event.kind, event.text, event.t_s) for event in decision.also)


def outside_result(outside: Outside, perception: Perception | None) -> OutsideResult | None:
    """Return what came in and went out; None when there was nothing outside of the process."""
    pilots = () if perception is None else perception.pilots.values()
    programs = tuple(pilot.result for pilot in pilots if isinstance(pilot, ProgramPilot))
    result = replace(outside.result, programs=programs)
    return result if result.anything else None


def _mixing(mixings: tuple[MixingLoop, ...]) -> MixingResult | None:
    if not mixings:
        return None
    combinations = tuple(_combination(mixing) for mixing in mixings)
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
    )


def _combination(mixing: MixingLoop) -> CombinationResult:
    statistics, counts = mixing.statistics, mixing.mixer.counts()
    error = statistics.registration_error_px.percentiles()
    bound = statistics.registration_bound_px.percentiles()
    replaced = {"replaced": statistics.replaced} if statistics.replaced else {}
    coverage = None if mixing.probe is None else mixing.probe.coverage
    return CombinationResult(
        name=mixing.name,
        sensor=mixing.mixer.combination.sensor.kind,
        publish=mixing.mixer.publish,
        frames=statistics.frames,
        dropped={**dict(counts.dropped), **replaced},
        faults=dict(counts.faults),
        rate_hz=statistics.rate_hz or 0.0,
        skew_ms=statistics.skew_ms.percentiles(),
        latency_ms=statistics.latency_ms.percentiles(),
        registration_error_px=error if error.p50 is not None else None,
        registration_bound_px=bound if bound.p50 is not None else None,
        frames_measured=0 if coverage is None else coverage.frames,
        shown={} if coverage is None else _shown(coverage),
        not_measured=mixing.unmeasured if coverage is None else coverage.not_measured,
    )


def _shown(coverage: Coverage) -> dict[str, ShownResult]:
    return {
        name: ShownResult(
            frames_in_view=one.in_view,
            frames_shown=one.shown,
            offset_px=percentiles(one.offsets) if one.unit == "px" else None,
            offset_m=percentiles(one.offsets) if one.unit == "m" else None,
        )
        for name, one in sorted(coverage.objects.items())
    }
