"""The overview of a campaign: verdict, its basis and caveats, a row per case and mode; pure."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.orchestrator.reading.model import CampaignDocuments
from wil_campaign.orchestrator.report.words import MODES, NOTHING, number_text, run_count_text
from wil_campaign.orchestrator.run_results.acceptance_texts import (
    left_out_text,
    place_of,
    required_text,
    row_verdict,
    shortfall_texts,
    stand_in_text,
)
from wil_campaign.orchestrator.run_results.campaign_results import UNKNOWN_ENDING, Summary
from wil_campaign.orchestrator.run_results.caveats import (
    campaign_caveats,
    retried_texts,
    synthesised_texts,
)
from wil_campaign.orchestrator.run_results.control_results import ended_text, expected_text
from wil_campaign.orchestrator.run_results.exit_codes import standings_of
from wil_campaign.orchestrator.run_results.run_result import RunResult, tightest_oracle
from wil_campaign.safety.model.oracle_results import EvidenceResult


@dataclass(frozen=True, slots=True)
class CampaignVerdict:
    """The campaign's verdict. kind: its colour: good, bad, open."""

    word: str
    kind: str
    sentence: str


@dataclass(frozen=True, slots=True)
class CaseRow:
    """A case and mode in the table of the overview; texts as shown.

    badge: the CSS class of the verdict: `met` or `unmet` for a control.
    """

    case: str
    mode: str
    passed: str
    required: str
    verdict: str
    clearance_m: str
    skew_ms: str
    registration_px: str
    badge: str
    is_control: bool = False


def campaign_verdict_of(documents: CampaignDocuments) -> CampaignVerdict:
    """Return the campaign's verdict in a word and in a sentence."""
    summary = documents.summary
    if summary is None:
        text = (
            "The summary of this campaign is missing or damaged: the campaign may have been killed."
        )
        return CampaignVerdict("no verdict", "open", text)
    totals = summary.totals
    required = required_text(summary, documents.requirements)
    counted = f"{required[0].upper()}{required[1:]}."
    if summary.accepted is False and (why := _not_accepted_because(documents, summary)):
        counted += f" Not accepted because {'; '.join(why)}."
    if others := [run.verdict == "PASS" for run in summary.runs if not run.required]:
        counted += f" Of the {len(others)} runs that are only reported, {sum(others)} passed."
    if totals.controls:
        counted += f" {totals.controls_met} of {totals.controls} controls were met."
    if summary.not_flown:
        missing = _missing_text(summary)
        counted += f" {missing[0].upper()}{missing[1:]}: {run_count_text(len(summary.not_flown))}."
    if summary.ending == UNKNOWN_ENDING:
        counted += f" The file {UNKNOWN_ENDING}."
    elif summary.ending:
        counted += f" {summary.ending[0].upper()}{summary.ending[1:]}."
    if summary.accepted is None:
        return CampaignVerdict("nothing required was flown", "open", counted)
    if summary.accepted:
        limited = " of what was flown" if summary.left_out else ""
        return CampaignVerdict(f"accepted{limited}", "good", counted)
    return CampaignVerdict("not accepted", "bad", counted)


def _not_accepted_because(documents: CampaignDocuments, summary: Summary) -> list[str]:
    """Return which required cases passed too rarely, and which controls were not met."""
    places = {(run.case, run.mode) for run in summary.runs if run.required}
    places |= set(map(place_of, summary.not_flown))
    wanted = [
        requirement
        for requirement in documents.requirements
        if (requirement.case, requirement.mode) in places
    ]
    return [*shortfall_texts(summary.runs, wanted), *summary.unmet]


def stand_in_notice(documents: CampaignDocuments) -> str:
    """Return the text that no hardware flew; empty where it did."""
    return "" if documents.summary is None else stand_in_text(documents.summary)


def validity_limits(documents: CampaignDocuments) -> list[str]:
    """Return the limits of the verdict's validity, for the head of the page; sentences."""
    summary = documents.summary
    if summary is None:
        return []
    found = [stand_in_text(summary)]
    if any(run.mode == "wil" for run in (*summary.runs, *summary.controls)):
        found.append(f"Mode wil is world in the loop: {MODES['wil']}.")
    return [text for text in (*found, left_out_text(summary)) if text]


def verdict_grounds(documents: CampaignDocuments) -> list[tuple[str, str]]:
    """Return the basis of the verdict: vehicles, sensors, evidence, mixture, controls."""
    summary = documents.summary
    if summary is None:
        return []
    found = [("real vehicle", _real_text(summary)), ("clock", summary.clock)]
    if summary.sensors:
        shown = ", ".join(f"{name}: {kind}" for name, kind in summary.sensors.items())
        found.append(("sensors", shown))
    found += [("evidence", text) for text in _evidence_texts(summary.runs)]
    found += [("mixture", text) for text in _mixture_texts(summary.runs)]
    found += [("control", text) for text in _control_texts(summary.controls)]
    return found


def verdict_cautions(documents: CampaignDocuments) -> list[str]:
    """Return the caveats of a green result."""
    summary = documents.summary
    if summary is None:
        return []
    found = [
        *campaign_caveats(summary.runs),
        *synthesised_texts(summary),
        *summary.caveats,
        *(f"not at the first attempt: {text}" for text in retried_texts(summary.runs)),
        *summary.unmet,
    ]
    if summary.not_flown:
        found.append(f"{_missing_text(summary)}: {', '.join(summary.not_flown)}")
    return found


def _missing_text(summary: Summary) -> str:
    """Return in words why runs are missing in a summary.

    While a campaign flies, or its last run lands after its program died, they may follow.
    """
    has_ended = summary.broken is not None or summary.stopped is not None
    return "never flown" if has_ended else "without a result when summary.json was written"


def case_rows(documents: CampaignDocuments) -> list[CaseRow]:
    """Return a row for each case and mode, the controls last."""
    groups: dict[tuple[str, str, bool], list[RunResult]] = {}
    for entry in documents.entries:
        if entry.result is not None:
            is_control = entry.result.control is not None
            groups.setdefault((entry.case, entry.mode, is_control), []).append(entry.result)
    rows = [_case_row(documents, *key, runs) for key, runs in groups.items()]
    return sorted(rows, key=lambda row: row.is_control)


def _case_row(
    documents: CampaignDocuments, case: str, mode: str, is_control: bool, runs: Sequence[RunResult]
) -> CaseRow:
    passed = sum(run.verdict == "PASS" for run in runs)
    required, verdict = _standing(documents, case, mode, runs)
    badge = verdict
    if is_control:
        control = runs[0].control
        required = f"must be {control.verdict}" if control is not None else ""
        verdict = runs[0].verdict
        badge = "unmet" if any(run.went_wrong for run in runs) else "met"
    clearances = [run.clearance_m for run in runs if run.clearance_m is not None]
    skews = [abs(run.sync.takeoff_skew_s) for run in runs if run.sync.takeoff_skew_s is not None]
    errors = [
        run.mixing.registration_error_px.p50
        for run in runs
        if run.mixing is not None
        and run.mixing.registration_error_px is not None
        and run.mixing.registration_error_px.p50 is not None
    ]
    return CaseRow(
        case=case,
        mode=mode,
        passed=f"{passed}/{len(runs)}",
        required=required,
        verdict=verdict,
        clearance_m=number_text(min(clearances, default=None), "m", 2).removesuffix(" m"),
        skew_ms=f"{1000.0 * max(skews):.0f}" if skews else NOTHING,
        registration_px=f"{max(errors):.1f}" if errors else NOTHING,
        badge=badge,
        is_control=is_control,
    )


def _standing(
    documents: CampaignDocuments, case: str, mode: str, runs: Sequence[RunResult]
) -> tuple[str, str]:
    """Return the required passes of a case and mode, and the verdict on them."""
    if not any(run.required for run in runs):
        return NOTHING, "reported"
    places = {
        (requirement.case, requirement.mode): requirement for requirement in documents.requirements
    }
    wanted = places.get((case, mode)) or PassRequirement(
        case, mode, PassShare(len(runs), len(runs))
    )
    (standing,) = standings_of(runs, [wanted])
    verdict = row_verdict(standing, runs)
    if wanted.test is None:
        return str(wanted.share), verdict
    rates = f"{wanted.test.at_least:g} against {wanted.test.against:g}"
    return f"{rates}: {standing.decision}", verdict


def _real_text(summary: Summary) -> str:
    if summary.surrogate:
        return "played by the embedded surrogate: a simulation in this program, no hardware"
    flown = any(run.mode != "sim" for run in summary.runs)
    return summary.real_kind if flown else "not flown: mode sim alone"


def _evidence_texts(runs: Iterable[RunResult]) -> Iterator[str]:
    """Yield a text per vehicle: the signals of required oracles, each in its worst run."""
    groups: dict[str, dict[tuple[str, str], list[EvidenceResult]]] = {}
    for run in runs:
        for result in run.evidence:
            if result.required:
                signals = groups.setdefault(result.vehicle, {})
                signals.setdefault((result.signal, result.source), []).append(result)
    for vehicle, signals in groups.items():
        count = max(len(results) for results in signals.values())
        texts = [_signal_text(*key, results) for key, results in signals.items()]
        yield f"{vehicle} in {run_count_text(count)}, longest gap and its limit: {'; '.join(texts)}"


def _signal_text(signal: str, source: str, results: Sequence[EvidenceResult]) -> str:
    # Limits may differ by case: a longer gap within its own is not what was too long.
    worst = max(results, key=lambda one: (one.verdict != "PASS", one.largest_gap_s))
    bad = sum(result.verdict != "PASS" for result in results)
    by = f" ({source})" if source else ""
    gap, limit = number_text(worst.largest_gap_s, "s"), number_text(worst.limit_s, "s")
    if gap == limit and worst.largest_gap_s > worst.limit_s:
        gap, limit = (f"{each:.6g} s" for each in (worst.largest_gap_s, worst.limit_s))
    text = f"{signal}{by} {gap.removesuffix(' s')} of {limit}"
    return text + (f", NOT SUFFICIENT in {run_count_text(bad)}" if bad else "")


def _mixture_texts(runs: Iterable[RunResult]) -> Iterator[str]:
    mixed = [run.mixing for run in runs if run.mixing is not None]
    if not mixed:
        return
    frames, dropped = (
        sum(mixing_result.frames for mixing_result in mixed),
        sum(mixing_result.dropped for mixing_result in mixed),
    )
    errors = [
        mixing_result.registration_error_px.p99
        for mixing_result in mixed
        if mixing_result.registration_error_px is not None
        and mixing_result.registration_error_px.p99 is not None
    ]
    text = f"{frames} mixtures in {run_count_text(len(mixed))}, {dropped} with something left out"
    if errors:
        worst = number_text(max(0.1, *errors), "px", 1)
        text += f"; registration error below {worst} in 99 % of those measured"
    if unmeasured := len(mixed) - len(errors):
        text += f"; registration error not measured in {run_count_text(unmeasured)}"
    yield text
    names = dict.fromkeys(name for mixing_result in mixed for name in mixing_result.shown)
    for name in names:
        seen = [mixing_result.shown[name] for mixing_result in mixed if name in mixing_result.shown]
        in_view = sum(shown_result.frames_in_view for shown_result in seen)
        shown = sum(shown_result.frames_shown for shown_result in seen)
        yield f"{name} shown in {shown} of the {in_view} mixtures with it in view"


def _control_texts(controls: Iterable[RunResult]) -> Iterator[str]:
    for run in controls:
        if run.control is not None:
            must = expected_text(run.control)
            not_met = "" if run.control.met else "NOT MET: "
            yield f"{run.case} {run.mode} must {must}; {not_met}it {ended_text(run)}"


def margin_text(run: RunResult | None) -> str:
    """Return the margin of a run's tightest oracle, with the oracle's name."""
    tightest = None if run is None else tightest_oracle(run)
    if tightest is None:
        return NOTHING
    return f"{number_text(tightest.margin, tightest.unit, 2)} ({tightest.name})"
