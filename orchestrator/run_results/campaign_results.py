"""The result of a campaign: the fields of summary.json."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from wil_campaign.campaigns.values.acceptance import PassRequirement
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.run_results.control_results import (
    control_faults,
    needless_control_texts,
)
from wil_campaign.orchestrator.run_results.exit_codes import equal_run_texts, is_campaign_accepted
from wil_campaign.orchestrator.run_results.run_result import RunResult, Stop
from wil_campaign.safety.model.oracle_results import Verdict

VehicleKind = Literal["embedded", "sitl", "hardware", "unknown"]
SensorKind = Literal["live", "rendered", "file", "synthesised"]
"""Where readings come from; synthesised: computed from pose and world for a vehicle that is not
embedded, and may have such a sensor itself."""
VERDICTS: tuple[Verdict, ...] = ("PASS", "FAIL", "INVALID", "ERROR", "ABORTED")
UNKNOWN_ENDING = (
    "summary.json does not record the end of the campaign: it still flies, was cut off, or was "
    "flown by an earlier version"
)
_STOPS = {
    "signal": "stopped by Ctrl-C or SIGTERM",
    "command": "stopped by an operator's command",
}


@dataclass(frozen=True, slots=True)
class Totals:
    """The totals of results: runs flown, required, and by verdict.

    retried: how many of the runs took more than one attempt, whatever the verdict. Controls count
    in `controls` alone, and those that ended as expected in `controls_met`.
    """

    runs: int
    required: int
    passed: int
    failed: int
    invalid: int
    error: int
    aborted: int
    retried: int = 0
    controls: int = 0
    controls_met: int = 0


@dataclass(frozen=True, slots=True)
class Summary:
    """The summary of a campaign's results. surrogate: the embedded vehicle flew as `real`.

    sensors: source of the readings of each sensor. accepted: None when no required run was flown
    and no control missed its expectation. left_out: what the campaign requires and the command line
    left out, in words. controls: the runs that must not pass; they are not in `runs`. unmet: the
    controls that did not end as expected, in words. caveats: of the campaign itself, and of pass
    rates decided on equal runs. not_flown: runs and controls without a result, by name.

    stopped, broken: how the campaign ended outside of its runs, as in `exit_code`. broken is None
    until the campaign ends: while it flies, after it was cut off, and in files of earlier versions.
    """

    campaign: str
    clock: Clock
    surrogate: bool
    real_kind: VehicleKind
    sensors: dict[str, SensorKind]
    runs: tuple[RunResult, ...]
    totals: Totals
    accepted: bool | None
    left_out: tuple[str, ...] = ()
    controls: tuple[RunResult, ...] = ()
    unmet: tuple[str, ...] = ()
    caveats: tuple[str, ...] = ()
    not_flown: tuple[str, ...] = ()
    stopped: Stop | None = None
    broken: bool | None = None

    @property
    def ending(self) -> str:
        """Return in words what ended the campaign outside of its runs; empty for a regular end."""
        if self.stopped is not None:
            return _STOPS[self.stopped]
        if self.broken is None:
            return UNKNOWN_ENDING
        return "an internal exception occurred outside of its runs" if self.broken else ""


def summarize(
    runs: Iterable[RunResult],
    requirements: Sequence[PassRequirement],
    *,
    campaign: str,
    clock: Clock,
    surrogate: bool,
    real_kind: VehicleKind,
    sensors: dict[str, SensorKind],
    left_out: tuple[str, ...] = (),
    stopped: Stop | None = None,
    broken: bool | None = False,
    controls_due: int = 0,
    missing: int = 0,
    caveats: tuple[str, ...] = (),
    not_flown: tuple[str, ...] = (),
) -> Summary:
    """Return the summary of run results, in the order of `runs`.

    stopped, broken, controls_due, missing: as in `exit_code`; flown controls are among the runs.
    broken: None where the campaign has not ended, or its end is unknown: then it is not accepted.
    """
    all_runs = tuple(runs)
    flown = tuple(run for run in all_runs if run.control is None)
    controls = tuple(run for run in all_runs if run.control is not None)
    return Summary(
        campaign=campaign,
        clock=clock,
        surrogate=surrogate,
        real_kind=real_kind,
        sensors=dict(sorted(sensors.items())),
        runs=flown,
        totals=totals_of(all_runs),
        accepted=is_campaign_accepted(
            all_runs,
            requirements,
            stopped=stopped,
            broken=broken is not False,
            controls_due=controls_due,
            missing=missing,
        ),
        left_out=left_out,
        controls=controls,
        unmet=tuple(control_faults(controls)),
        caveats=(
            *caveats,
            *equal_run_texts(flown, requirements),
            *needless_control_texts(flown, controls),
        ),
        not_flown=not_flown,
        stopped=stopped,
        broken=broken,
    )


def is_same_result(summarised: RunResult, result: RunResult) -> bool:
    """Return whether a run's entry in a summary and its result are of the same flight.

    All figures are compared: another flight of the same seed often has the same verdict.
    """
    return replace(summarised, artifacts=()) == replace(result, artifacts=())  # paths differ


def totals_of(runs: Sequence[RunResult]) -> Totals:
    """Return the totals of run results."""
    controls = [run.control for run in runs if run.control is not None]
    runs = [run for run in runs if run.control is None]
    count = {verdict: sum(run.verdict == verdict for run in runs) for verdict in VERDICTS}
    return Totals(
        runs=len(runs),
        required=sum(run.required for run in runs),
        passed=count["PASS"],
        failed=count["FAIL"],
        invalid=count["INVALID"],
        error=count["ERROR"],
        aborted=count["ABORTED"],
        retried=sum(bool(run.attempts) for run in runs),
        controls=len(controls),
        controls_met=sum(control.met for control in controls),
    )


class SummaryText:
    """Encodes the summaries of one campaign as `to_json` does, each run once.

    It is written after every run: encoded anew, 1,000 runs take 0.7 s of CPU each time.
    """

    def __init__(self) -> None:
        self._known: dict[str, tuple[RunResult, str]] = {}

    def text(self, summary: Summary) -> str:
        """Return a summary as JSON. Raises ValueError for NaN and infinity."""
        text = to_json(replace(summary, runs=(), controls=()))
        text = _with_list(text, "runs", map(self._encoded, summary.runs))
        return _with_list(text, "controls", map(self._encoded, summary.controls))

    def _encoded(self, run: RunResult) -> str:
        name = f"{run.case}/{run.mode}/{run.rep}"
        known = self._known.get(name)
        if known is None or known[0] != run:
            known = self._known[name] = run, to_json(run).rstrip().replace("\n", "\n    ")
        return known[1]


def _with_list(text: str, key: str, entries: Iterable[str]) -> str:
    """Return a JSON text with entries in an empty list of its outermost object."""
    inner = ",\n    ".join(entries)
    empty = f'\n  "{key}": []'  # no string of JSON has a line break
    return text.replace(empty, f"{empty[:-1]}\n    {inner}\n  ]", 1) if inner else text
