"""Judges recorded runs again, by the oracles that the campaign file has now."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from campaigns.expansion.expansion import Campaign, RunPlan
from orchestrator.model.control_results import control_result
from orchestrator.model.results import RunResult, Summary, summarize
from orchestrator.model.results_reader import ResultError, read_result
from orchestrator.recording.errors import RecordingError
from orchestrator.recording.judge_log_file import FILE_NAME
from orchestrator.run.flight.run_oracles import build_judge
from orchestrator.run.flight.run_outcome import also_of, reason_of
from orchestrator.state.run_setup import RunOrder, RunSetup
from safety.evaluation.judge import COLLISION_ALWAYS
from safety.evaluation.judge_log import JudgeLogError, judge_from_log, read_judge_log
from safety.evidence.evidence import SOURCE
from safety.model.verdict import DecisiveEvent, DecisiveKind, decide, source_of

_KINDS: dict[str, DecisiveKind] = {
    "ERROR": "ERROR",
    "INVALID": "INVALID",
    "FAIL": "FAIL",
    "ABORTED": "ABORTED",
}


@dataclass(frozen=True, slots=True)
class Reevaluation:
    """A recorded run as judged when it was flown, and as judged again now."""

    before: RunResult
    now: RunResult


def summary_of(campaign: Campaign, folder: Path, rejudged: Iterable[Reevaluation]) -> Summary:
    """Return the summary of recorded runs by their reevaluation.

    What the folder says of its vehicles and sensors is kept; what is not in it, was not flown.
    """
    runs = [each.now for each in rejudged]
    found = {f"{run.case}/{run.mode}/{run.rep}" for run in runs}
    before = _summary_before(folder)
    return summarize(
        runs,
        campaign.requirements,
        campaign=campaign.name,
        clock=before.get("clock", "virtual"),
        surrogate=before.get("surrogate") is True,
        real_kind=before.get("real_kind", "unknown"),
        sensors=before.get("sensors", {}),
        left_out=campaign.left_out,
        controls_due=len(campaign.controls),
        caveats=campaign.caveats,
        not_flown=tuple(plan.name for plan in campaign.plans if plan.name not in found),
    )


def _summary_before(folder: Path) -> dict[str, Any]:
    """Return the summary.json of a campaign before its reevaluation; empty without."""
    try:
        found = json.loads((folder / "summary.json").read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def judge_campaign_again(campaign: Campaign, folder: Path) -> tuple[Reevaluation, ...]:
    """Reevaluate every recorded run of the campaign in a results folder.

    Raises RecordingError when there is none, or when a recording cannot be read.
    """
    found = tuple(
        judge_run_again(plan, folder / plan.name)
        for plan in campaign.plans
        if (folder / plan.name).is_dir()
    )
    if not found:
        first = campaign.plans[0].name
        raise RecordingError(f"{folder} has no run of this campaign, such as {first}")
    return found


def judge_run_again(plan: RunPlan, folder: Path) -> Reevaluation:
    """Reevaluate one recorded run. Raises RecordingError."""
    try:
        before = read_result(folder / "result.json")
    except ResultError as error:
        raise RecordingError(str(error)) from error
    events: dict[str, float] = {}
    setup = RunSetup.of(RunOrder(plan=plan, folder=folder, clock="virtual"))
    judge = build_judge(setup, events)
    try:
        with (folder / FILE_NAME).open("rb") as stream:
            played = judge_from_log(read_judge_log(stream), judge, events)
    except (OSError, JudgeLogError) as error:
        said = getattr(error, "strerror", None) or error
        raise RecordingError(f"{folder / FILE_NAME}: {said}") from error
    if played.end_s is None:
        raise RecordingError(f"{folder / FILE_NAME} was cut before the end of the run")
    oracles = judge.results(played.end_s)
    decision = decide(
        [*_foreign_events(folder / "log.jsonl", before), *judge.decisive],
        oracles,
        end_s=played.end_s,
        completed={"landed", "done"} <= played.stages,
        timeouts=judge.timeouts,
    )
    reason = reason_of(decision, decision.note or before.note)
    always = setup.campaign.collision_always
    now = replace(
        before,
        not_judged=() if always else (COLLISION_ALWAYS.name,),
        verdict=decision.verdict,
        reason=reason,
        also=also_of(decision),
        required=plan.required,
        oracles=oracles,
        evidence=judge.evidence,
        decided_by=decision.source,
        trace=decision.trace,
        control=control_result(
            plan.control,
            verdict=decision.verdict,
            reason=reason,
            decided_by=decision.source,
            subject=before.subject,
        ),
    )
    return Reevaluation(before, now)


def _foreign_events(log: Path, before: RunResult) -> Iterator[DecisiveEvent]:
    """Yield what decided the run beside its oracles: guard, mixing, autonomy, operator."""
    own = {source_of(oracle.name, oracle.vehicle) for oracle in before.oracles}
    try:
        lines = [json.loads(line) for line in log.read_text("utf-8").splitlines()]
        for line in lines:
            source = line.get("source", "")
            judged = source in own or source.startswith(SOURCE)
            if line["event"] == "decisive" and not judged:
                yield DecisiveEvent(
                    line["t_s"],
                    _KINDS[line["kind"]],
                    line["reason"],
                    source,
                    line.get("note", ""),
                    line.get("trace", ""),
                )
    except (OSError, ValueError, KeyError, AttributeError) as error:
        raise RecordingError(f"{log} cannot be read: {error}") from error
