"""Builds the result of a run from its decisive events, oracles and statistics."""

from collections import Counter
from dataclasses import replace

from campaigns.setup.named_objects import named_objects
from orchestrator.external.external_io import ExternalIo
from orchestrator.external.program_runner import ProgramRunner
from orchestrator.model.arming_steps import ArmingStep
from orchestrator.model.control_results import ControlResult, control_result
from orchestrator.model.external_results import ExternalResult
from orchestrator.model.results import (
    ActorResult,
    Also,
    CombinationResult,
    FenceChange,
    Loss,
    MixingResult,
    RunResult,
    ShownResult,
    SyncResult,
    percentiles,
    with_note,
)
from orchestrator.model.twin_results import TwinResult
from orchestrator.run.perception.mixing_loop import MixingLoop
from orchestrator.run.perception.perception import Perception
from orchestrator.state.run_setup import RunSetup
from orchestrator.state.run_state import RunState
from recipes.visibility.coverage import Coverage
from safety.evaluation.judge import Judge, unjudged
from safety.model.oracle_results import Flag
from safety.model.verdict import Decision, decide
from safety.preflight import Item

_MOST_ALSO = 50
"""How many events a result lists beside the one that made the verdict."""
_GRAVEST = ("ERROR", "ABORTED")
"""The verdicts of which none is lost among the events that are not listed."""


def result_of(
    *,
    setup: RunSetup,
    run_state: RunState,
    judge: Judge,
    sync: SyncResult,
    mixings: tuple[MixingLoop, ...],
    collisions: tuple[Flag, ...],
    outside: ExternalResult | None,
    artifacts: tuple[str, ...],
    preflight: tuple[Item, ...],
    before_arming: tuple[ArmingStep, ...],
    fence_changes: tuple[FenceChange, ...],
    twin: TwinResult | None,
    losses: tuple[Loss, ...],
    actors: tuple[ActorResult, ...],
    end_s: float,
    wall_s: float,
) -> RunResult:
    """Return the outcome of a run, its flight being over at end_s."""
    plan = setup.order.plan
    oracles = judge.results(end_s)
    completed = run_state.reached("landed") and run_state.reached("done")
    decision = decide(
        run_state.decisive, oracles, end_s=end_s, completed=completed, timeouts=judge.timeouts
    )
    note = decision.note or run_state.last_note()
    reason = reason_of(decision, note)
    takeoff_s, landed_s = run_state.entered_s.get("takeoff"), run_state.entered_s.get("landed")
    return RunResult(
        case=plan.case,
        mode=plan.mode,
        rep=plan.repetition,
        seed=plan.seed,
        verdict=decision.verdict,
        reason=reason,
        also=also_of(decision),
        required=plan.required,
        duration_s=None if takeoff_s is None else (landed_s or end_s) - takeoff_s,
        wall_s=wall_s,
        oracles=oracles,
        sync=sync,
        mixing=_mixing_result(mixings, named=named_objects(setup.campaign)),
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
        not_judged=unjudged(
            setup.campaign.oracles, collision_always=setup.campaign.collision_always
        ),
        control=_control_result(setup, decision),
        exceptions=exceptions_of(run_state),
        twin=twin,
        losses=losses,
        actors=actors,
    )


def reason_of(decision: Decision, note: str) -> str:
    """Return the reason of a run's outcome, with the autonomy's last note at a FAIL."""
    return with_note(decision.reason, note if decision.verdict == "FAIL" else "")


def broken_result(
    setup: RunSetup, run_state: RunState, *, end_s: float, wall_s: float
) -> RunResult:
    """Return the outcome of a run that an internal exception ended before it had any parts."""
    plan = setup.order.plan
    decision = decide(run_state.decisive, (), end_s=end_s, completed=False)
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
        control=_control_result(setup, decision),
        exceptions=exceptions_of(run_state),
    )


def _control_result(setup: RunSetup, decision: Decision) -> ControlResult | None:
    """Return the control result of a run by its verdict; None where the run is no control."""
    return control_result(
        setup.order.plan.control,
        verdict=decision.verdict,
        reason=decision.reason,
        decided_by=decision.source,
        subject=setup.subject,
    )


def exceptions_of(run_state: RunState) -> tuple[str, ...]:
    """Return the internal exceptions of a run, each in a line."""
    return tuple(fault.text for fault in run_state.faults)


def also_of(decision: Decision) -> tuple[Also, ...]:
    """Return the decisive events after the one that made the verdict; equal ones are counted."""
    counts = Counter((event.kind, event.text) for event in decision.also)
    first = {(event.kind, event.text): event.t_s for event in reversed(decision.also)}
    listed = [
        Also(kind, text if count == 1 else f"{text} ({count} times)", first[kind, text])
        for (kind, text), count in counts.items()
    ]
    if len(listed) <= _MOST_ALSO:
        return tuple(listed)
    kept, more = listed[: _MOST_ALSO - 1], listed[_MOST_ALSO - 1 :]
    verdicts = {one.verdict for one in more}
    # Whoever asks whether a vehicle may fly again looks for these.
    gravest = next((one for one in _GRAVEST if one in verdicts), more[0].verdict)
    text = f"{len(more)} more events; log.jsonl has all of them"
    return (*kept, Also(gravest, text, more[0].at_s))


def external_result(
    external_io: ExternalIo, perception: Perception | None
) -> ExternalResult | None:
    """Return the run's results of external I/O; None without any."""
    runners = () if perception is None else perception.runners.values()
    programs = tuple(runner.result for runner in runners if isinstance(runner, ProgramRunner))
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
    """Return the named virtual objects that were looked for and were in view of no mixture."""
    sought: set[str] = set()
    in_view: set[str] = set()
    for one in combinations:
        if one.frames_measured:
            sought.update(one.shown, one.not_mixed)
        in_view.update(name for name, each in one.shown.items() if each.frames_in_view)
        in_view.update(name for name, count in one.not_mixed.items() if count)
    return tuple(sorted((sought & named) - in_view))


def _combination_result(mixing: MixingLoop) -> CombinationResult:
    """Return the run's result of one combination."""
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


def _shown(coverage: Coverage) -> dict[str, ShownResult]:
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
