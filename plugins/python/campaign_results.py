"""The results of a flown campaign for Python programs: typed, and as rows of tables."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import wil_campaign
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.run_result import Percentiles, RunResult
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.oracles.contact import exceeded_margin_m

if TYPE_CHECKING:
    from wil_campaign import Study

Row = dict[str, str | float | int | bool | None]
"""A row of a table by column, for pandas.DataFrame(rows) and csv.DictWriter."""

_NOTHING = Percentiles(None, None)


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignResults:
    """The results of a campaign. folder: where its files are; summary: as of summary.json.

    exit_code: what `wil-campaign run` would have ended with; None where results were only read.
    problems: in words, what is missing or damaged in the folder.
    """

    folder: Path
    summary: Summary
    exit_code: int | None = None
    problems: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool | None:
        """Return whether the campaign is accepted; None where no required run was flown."""
        return self.summary.accepted

    @property
    def runs(self) -> tuple[RunResult, ...]:
        """Return the results of the runs, without the controls."""
        return self.summary.runs

    @property
    def controls(self) -> tuple[RunResult, ...]:
        """Return the results of the controls, the runs that must not pass."""
        return self.summary.controls

    def run_folder(self, run: RunResult) -> Path:
        """Return the folder with a run's files: trajectory.csv, run.mcap, mixed.mp4 and others."""
        return self.folder / run.case / run.mode / str(run.rep)

    def rows(self) -> list[Row]:
        """Return one row for each run and control; times in seconds, what is unknown is None."""
        return [_run_row(run) for run in (*self.runs, *self.controls)]

    def oracle_rows(self) -> list[Row]:
        """Return one row for each oracle of each run and control, in the oracle's own unit."""
        flown = (*self.runs, *self.controls)
        return [row for run in flown for row in _oracle_rows(run)]

    def study(self) -> "Study":
        """Return pass rates, tests between modes, and the gap, as `wil-campaign gap` prints."""
        return wil_campaign.Study.read(self.folder)


def read_results(folder: str | Path, *, exit_code: int | None = None) -> CampaignResults:
    """Return the results of a campaign's folder, DIR/<campaign>/<UTC start>.

    Raises ResultsFolderError for a folder without a readable summary.
    """
    documents = read_campaign_documents(Path(folder))
    if documents.summary is None:
        reason = "; ".join(documents.problems) or "summary.json is missing"
        raise ResultsFolderError(f"{folder}: {reason}")
    return CampaignResults(
        folder=Path(folder),
        summary=documents.summary,
        exit_code=exit_code,
        problems=(*documents.problems, *documents.run_problems),
    )


def _run_row(run: RunResult) -> Row:
    mixing = run.mixing
    skew = _NOTHING if mixing is None else mixing.skew_ms
    latency = _NOTHING if mixing is None else mixing.latency_ms
    registration = None if mixing is None else mixing.registration_error_px
    return {
        "case": run.case,
        "mode": run.mode,
        "rep": run.rep,
        "seed": run.seed,
        "verdict": run.verdict,
        "reason": run.reason,
        "decided_by": run.decided_by,
        "required": run.required,
        "is_control": run.control is not None,
        "duration_s": run.duration_s,
        "wall_s": run.wall_s,
        "attempts": len(run.attempts) + 1,
        "contacts": len(run.collisions),
        "takeoff_skew_s": run.sync.takeoff_skew_s,
        "t0_skew_s": run.sync.t0_skew_s,
        "frames": None if mixing is None else mixing.frames,
        "frames_dropped": None if mixing is None else mixing.dropped,
        "skew_ms_p50": skew.p50,
        "skew_ms_p99": skew.p99,
        "latency_ms_p50": latency.p50,
        "latency_ms_p99": latency.p99,
        "registration_error_px_p50": (registration or _NOTHING).p50,
        "registration_error_px_p99": (registration or _NOTHING).p99,
    }


def _oracle_rows(run: RunResult) -> Iterator[Row]:
    for oracle in run.oracles:
        low, high = _limits(oracle)
        yield {
            "case": run.case,
            "mode": run.mode,
            "rep": run.rep,
            "is_control": run.control is not None,
            "oracle": oracle.name,
            "vehicle": oracle.vehicle,
            "required": oracle.required,
            "verdict": oracle.verdict,
            "actual": oracle.actual,
            "limit_low": low,
            "limit_high": high,
            "unit": oracle.unit,
            "margin": oracle.margin,
            "at_s": oracle.at_s,
            "detail": oracle.detail,
        }


def _limits(oracle: OracleResult) -> tuple[float | None, float | None]:
    """Return an oracle's lower and upper limit; a single one is put on its side by the margin.

    Of contact, and where nothing came near, it is the lower one: distances have no other side.
    """
    limit, actual, margin = oracle.limit, oracle.actual, oracle.margin
    if isinstance(limit, tuple):
        return limit
    if limit is None or actual is None or margin is None:
        is_lower = exceeded_margin_m(oracle) is not None
    elif margin == 0.0:
        is_lower = limit == 0.0 and oracle.unit == "m"
    else:
        is_lower = abs((actual - limit) - margin) < abs((limit - actual) - margin)
    return (limit, None) if is_lower else (None, limit)
