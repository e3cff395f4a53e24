"""Evaluates recorded runs again with the oracles that the campaign file has now."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan, load_campaign
from wil_campaign.foundation.files.limited_json import (
    loads_limited_json,
    read_limited_bytes,
    read_limited_json,
)
from wil_campaign.foundation.files.paths import open_at_once
from wil_campaign.orchestrator.campaign.folder.manifest import (
    judging_manifest,
    manifest_run_values,
    world_digest,
)
from wil_campaign.orchestrator.campaign.folder.manifest_changes import (
    changes_since_flight,
    damaged_manifest_keys,
)
from wil_campaign.orchestrator.campaign.folder.repetitions import runs_due
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import vehicles_with_open_poses
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.judge_log_file import FILE_NAME
from wil_campaign.orchestrator.recording.trajectory import recorded_note
from wil_campaign.orchestrator.run.judging.run_oracles import build_judge
from wil_campaign.orchestrator.run.judging.run_outcome import outcome_reason
from wil_campaign.orchestrator.run_results.attempts import after_attempts
from wil_campaign.orchestrator.run_results.campaign_results import (
    Summary,
    is_same_result,
    summarize,
)
from wil_campaign.orchestrator.run_results.control_results import control_result
from wil_campaign.orchestrator.run_results.evidence_files import foreign_files
from wil_campaign.orchestrator.run_results.exit_codes import exit_code
from wil_campaign.orchestrator.run_results.result_reader import (
    ResultError,
    read_result,
    read_summary,
)
from wil_campaign.orchestrator.run_results.run_result import RunResult, later_events_of
from wil_campaign.orchestrator.state.run_log import decisive_event
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.safety.evaluation.judge import unjudged_contacts
from wil_campaign.safety.evaluation.judge_log import JudgeLogError, judge_from_log, read_judge_log
from wil_campaign.safety.evidence.evidence import SOURCE
from wil_campaign.safety.model.verdict import (
    DecisiveEvent,
    RunDecision,
    decide_verdict,
    event_source_of,
)
from wil_campaign.worlds.scene.track import RunHistory

_REMEDY = "; restore the file, or fly the campaign again"


@dataclass(frozen=True, slots=True)
class Reevaluation:
    """The result of a recorded run at its flight, and its result now."""

    before: RunResult
    now: RunResult


@dataclass(frozen=True, slots=True)
class Judgement:
    """The reevaluation of a results folder, with the exit code that `run` has for such results.

    changed_since_flight: what affects verdicts and has changed since the flight, in words.
    """

    runs: tuple[Reevaluation, ...]
    summary: Summary
    exit_code: int
    changed_since_flight: tuple[str, ...]


def judge_campaign_again(campaign: Campaign, folder: Path) -> Judgement:
    """Reevaluate every recorded run of the campaign in a results folder.

    Raises RecordingError when there is none, when a recording or summary.json cannot be read, or
    when a run cannot be shown to have flown in the world that its files describe now.
    """
    campaign = _as_settled(campaign, _document(folder / "campaign.json"))
    recorded = [plan for plan in campaign.plans if (folder / plan.name / "result.json").exists()]
    if not recorded:
        first = campaign.plans[0].name
        raise RecordingError(f"{folder} has no run of this campaign, such as {first}")
    flown = _document(folder / "campaign.json")
    _require_all_repetitions(campaign, flown, folder)
    _require_same_worlds(recorded, flown, folder)
    now = judging_manifest(campaign, flown)
    before = _summary_of_flight(folder / "summary.json")
    rejudged = tuple(judge_run_again(plan, folder / plan.name) for plan in recorded)
    by_name = {plan.name: each for plan, each in zip(recorded, rejudged, strict=True)}
    now_by_name = {name: each.now for name, each in by_name.items()}
    due = runs_due(campaign.plans, campaign.test, now_by_name)
    absent = [plan for plan in due if plan.name not in by_name]
    due_names = {plan.name for plan in due}
    surplus = [name for name in by_name if name not in due_names]
    lost = [plan.name for plan in absent if (folder / plan.name).is_dir()]
    left = [f"not counted, flown after the decision: {', '.join(surplus)}"] if surplus else []
    left += [f"begun and lost, without a result: {', '.join(lost)}"] if lost else []
    counted = tuple(by_name[plan.name] for plan in due if plan.name in by_name)
    _require_own_summary(before, counted, folder)
    runs = [each.now for each in counted]
    return Judgement(
        counted,
        _summary(campaign, before, runs, absent, left),
        exit_code(
            runs,
            campaign.requirements,
            stopped=before.stopped,
            broken=before.broken is not False,
            controls_due=len(campaign.controls),
            missing=sum(plan.required for plan in absent),
        ),
        tuple(changes_since_flight(flown, now, file=campaign.document.path.name)),
    )


def _as_settled(campaign: Campaign, flown: Mapping[str, Any]) -> Campaign:
    """Return a campaign with the pose sources that its flight settled, and its file leaves open."""
    given = flown["options"].get("set", ()) if isinstance(flown.get("options"), dict) else ()
    wanted = {
        f"vehicles.{with_open_pose}.pose_source=simulator"
        for with_open_pose in vehicles_with_open_poses(campaign)
    }
    if not (settled := tuple(one for one in given if one in wanted)):
        return campaign
    options = replace(campaign.options, sets=(*campaign.options.sets, *settled))
    return load_campaign(campaign.document.path, options)


def _summary(
    campaign: Campaign,
    before: Summary,
    runs: Sequence[RunResult],
    absent: Sequence[RunPlan],
    left: Sequence[str],
) -> Summary:
    """Return the summary of the reevaluated runs; absent: those without a result in the folder.

    left: caveats of those that do not count, as the sequential test decides before them, or were
    lost. Vehicles, sensors and what ended the campaign are taken from the summary of the flight.
    """
    return summarize(
        runs,
        campaign.requirements,
        campaign=campaign.name,
        clock=before.clock,
        surrogate=before.surrogate,
        real_kind=before.real_kind,
        sensors=before.sensors,
        left_out=campaign.left_out,
        stopped=before.stopped,
        broken=before.broken,
        controls_due=len(campaign.controls),
        missing=sum(plan.required for plan in absent),
        caveats=(*campaign.caveats, *left),
        not_flown=tuple(plan.name for plan in absent),
    )


def _summary_of_flight(path: Path) -> Summary:
    """Return the summary as it was written at the flight. Raises RecordingError."""
    try:
        return read_summary(path)
    except ResultError as error:
        raise RecordingError(
            f"{error}: without this file it is unknown how the campaign ended; restore the file, "
            "or fly the campaign again"
        ) from error


def _require_own_summary(summary: Summary, runs: Iterable[Reevaluation], folder: Path) -> None:
    """Raise RecordingError for a summary of other flights; one that was cut off lacks some."""
    stated = {_name_of(run): run for run in (*summary.runs, *summary.controls)}
    for run in (each.before for each in runs):
        entry = stated.get(_name_of(run))
        is_own = summary.broken is None if entry is None else is_same_result(entry, run)
        if not is_own:
            raise RecordingError(
                f"{folder / 'summary.json'} is not of the flight of {_name_of(run)}: restore the "
                "file, or fly the campaign again"
            )


def _name_of(run: RunResult) -> str:
    return f"{run.case}/{run.mode}/{run.rep}"


def _document(path: Path) -> dict[str, Any]:
    """Return a JSON document of the results folder; empty without one, or if it is damaged."""
    try:
        document = read_limited_json(path)
    except (OSError, ValueError):
        return {}
    is_whole = isinstance(document, dict) and not damaged_manifest_keys(document)
    return document if is_whole else {}


def _require_all_repetitions(campaign: Campaign, manifest: Mapping[str, Any], folder: Path) -> None:
    """Raise RecordingError where more repetitions were flown than the campaign has now."""
    planned = {plan.name for plan in campaign.plans}
    cells = {name.rpartition("/")[0] for name in planned}
    beyond = {
        name: int(repetition)
        for name in manifest_run_values(manifest, "documents")
        for cell, _, repetition in [name.rpartition("/")]
        if cell in cells and repetition.isdecimal() and name not in planned
        if (folder / name).is_dir()
    }
    if beyond:
        raise RecordingError(
            f"{folder} has {len(beyond)} runs that would not be judged, such as "
            f"{next(iter(beyond))}: give --repetitions {max(beyond.values())}"
        )


def _require_same_worlds(
    plans: Iterable[RunPlan], manifest: Mapping[str, Any], folder: Path
) -> None:
    """Raise RecordingError unless the manifest shows that each run flew in its files' world.

    The vehicle flew among the objects of that time; its clearance to other objects shows nothing.
    """
    flown_in = manifest_run_values(manifest, "world")
    for plan in plans:
        flown = flown_in.get(plan.name)
        if flown is None:
            raise RecordingError(
                f"{folder / 'campaign.json'} is missing, damaged, or does not say in which world "
                f"{plan.name} was flown: restore that file, or fly the campaign again"
            )
        if flown != world_digest(plan.files):
            raise RecordingError(
                f"{plan.name} was flown in another world than its files describe now: restore the "
                "world, or fly the campaign again"
            )


def judge_run_again(plan: RunPlan, folder: Path) -> Reevaluation:
    """Reevaluate one recorded run. Raises RecordingError."""
    try:
        before = read_result(folder / "result.json")
    except ResultError as error:
        raise RecordingError(f"{error}{_REMEDY}") from error
    if _name_of(before) != plan.name:
        raise RecordingError(f"{folder / 'result.json'} is of another run{_REMEDY}")
    # First: of a damaged file anything is said, and where it can be read, anything is judged.
    if foreign := foreign_files(folder, before.evidence_files):
        raise RecordingError(f"{folder}: {foreign[0]}{_REMEDY}")
    events = RunHistory()
    setup = RunSetup.of(RunOrder(plan=plan, folder=folder, clock="virtual"))
    judge = build_judge(setup, events)
    try:
        with open_at_once(folder / FILE_NAME) as stream:
            played = judge_from_log(read_judge_log(stream), judge, events)
    except (OSError, JudgeLogError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RecordingError(f"{folder / FILE_NAME}: {reason}{_REMEDY}") from error
    if played.end_s is None:
        raise RecordingError(f"{folder / FILE_NAME} was cut before the end of the run{_REMEDY}")
    oracles = judge.results(played.end_s)
    decision = decide_verdict(
        [*_foreign_events(folder / "log.jsonl", before), *judge.decisive],
        oracles,
        end_s=played.end_s,
        completed={"landed", "done"} <= played.stages.keys(),
        timeouts=judge.timeouts,
        worst=judge.worst_texts,
    )
    note = decision.note or _note_at(folder, decision, before)
    reason = outcome_reason(decision, note, oracles, goal_s=played.stages.get("goal"))
    campaign = setup.case
    now = replace(
        before,
        not_judged=unjudged_contacts(campaign.oracles, collision_always=campaign.collision_always),
        verdict=decision.verdict,
        reason=reason,
        also=later_events_of(decision),
        required=plan.required,
        oracles=oracles,
        evidence=judge.evidence,
        decided_by=decision.source,
        note=note,
        trace=decision.trace,
        control=control_result(
            plan.control,
            verdict=decision.verdict,
            reason=decision.reason,
            decided_by=decision.source,
            subject=before.subject,
        ),
    )
    return Reevaluation(before, after_attempts(now, before.attempts))


def _note_at(folder: Path, decision: RunDecision, before: RunResult) -> str:
    """Return the autonomy's note at the time of a decision, as the flight or its path has it."""
    made = (decision.verdict, decision.source, decision.reason)
    if made == (before.verdict, before.decided_by, before.bare_reason):
        return before.note
    return recorded_note(folder / "trajectory.csv", before.subject, decision.at_s)


def _foreign_events(log: Path, before: RunResult) -> list[DecisiveEvent]:
    """Return the decisive events of guard, mixing, autonomy and operator, not of oracles.

    Raises RecordingError when the log is damaged, was cut, or lacks the event of the verdict.
    """
    own = {event_source_of(oracle.name, oracle.vehicle) for oracle in before.oracles}
    try:
        is_whole, events, flags = False, list[DecisiveEvent](), set[tuple[Any, ...]]()
        for text in read_limited_bytes(log).splitlines():
            line = loads_limited_json(text)
            if line["event"] == "flag":
                flags.add(
                    (line["t_s"], line["text"], event_source_of(line["oracle"], line["vehicle"]))
                )
            if line["event"] == "decisive":
                events.append(decisive_event(line))
            is_whole = is_whole or (line["event"] == "stage" and line["stage"] == "end")
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RecordingError(f"{log} cannot be read: {reason}{_REMEDY}") from error
    if not is_whole:
        raise RecordingError(f"{log} was cut before the end of the run{_REMEDY}")
    # An oracle may have the name of another part, as `sync`: only its events have a flag as well.
    judged = [event for event in events if (event.t_s, event.text, event.source) in flags]
    foreign = [event for event in events if event not in judged and not _is_evidence(event.source)]
    decided_by = before.decided_by
    known = {"", *own, *(one.source for one in foreign)}
    if decided_by not in known and not _is_evidence(decided_by):
        raise RecordingError(f"{log} lacks what decided the run: {before.reason}{_REMEDY}")
    return foreign


def _is_evidence(source: str) -> bool:
    """Return whether a decisive event is from the evidence, which is evaluated again as well."""
    return source.startswith(SOURCE)
