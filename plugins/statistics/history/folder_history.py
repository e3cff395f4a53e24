"""The history of campaigns by their results folders, and by a file that outlives them."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from wil_campaign.foundation.files.document_writer import write_atomically
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.recording.timestamps import utc_text
from wil_campaign.plugins.statistics.comparison.baseline import results_folders
from wil_campaign.plugins.statistics.history.history import (
    HistoryRow,
    VerdictVariation,
    history_rows,
    verdict_variations,
)
from wil_campaign.plugins.statistics.history.history_page import render_history
from wil_campaign.plugins.statistics.history.records import (
    FlightRecord,
    append_records,
    flight_records_of,
    latest_records,
    read_records,
)
from wil_campaign.plugins.statistics.report_links import REPORT, link_from


@dataclass(frozen=True, slots=True)
class History:
    """Campaigns over time: a row for each case and mode of each campaign, oldest first.

    variations: flights that ended differently, flaky ones first. problems: in words, what could not
    be read, or ended early. reports: of the campaigns in the folders, by name and time of start.
    """

    rows: tuple[HistoryRow, ...]
    variations: tuple[VerdictVariation, ...]
    problems: tuple[str, ...]
    reports: Mapping[tuple[str, str], Path] = field(default_factory=dict)

    def write_page(self, path: str | Path) -> None:
        """Write the history as one HTML page, which links to the reports. Raises OSError."""
        links = {key: link_from(path, report) for key, report in self.reports.items()}
        made_utc = utc_text(time.time())
        page = render_history(
            self.rows,
            self.variations,
            problems=self.problems,
            reports=links,
            made_utc=made_utc,
        )
        write_atomically(Path(path), page)


def history(
    *folders: str | Path, keep: str | Path | None = None, campaign: str | None = None
) -> History:
    """Return the history of campaigns. folders: of their results, or that hold some.

    keep: a file of JSON lines to which new and changed flights are appended; its own are in the
    history even when their folders are gone. campaign: only the one of this name.

    Raises HistoryFileError for a damaged file, and where it cannot be written.
    """
    problems: list[str] = []
    known = read_records(Path(keep)) if keep is not None else []
    before = set(known)  # also earlier lines: an old copy of a folder is no news
    reports: dict[tuple[str, str], Path] = {}
    read = latest_records(_read(map(Path, folders), problems, reports))
    new = [flight_record for flight_record in read if flight_record not in before]
    if keep is not None:
        append_records(Path(keep), new)
    records = [
        flight_record
        for flight_record in latest_records([*known, *new])
        if campaign in {None, flight_record.campaign}
    ]
    if not records:
        problems.append(f"no flights of a campaign in {_names(folders)}")
    rows, varied = tuple(history_rows(records)), tuple(verdict_variations(records))
    return History(rows, varied, tuple(problems), reports)


def _names(folders: Sequence[str | Path]) -> str:
    return ", ".join(map(str, folders))


def _read(
    folders: Iterable[Path], problems: list[str], reports: dict[tuple[str, str], Path]
) -> list[FlightRecord]:
    """Return the flights at and beneath folders.

    Unreadable folders are added to the problems, and the reports of the others to `reports`.
    """
    found: list[FlightRecord] = []
    for folder in folders:
        if not folder.is_dir():
            problems.append(f"{folder} is not a folder")
            continue
        for path in results_folders(folder):
            try:
                documents = read_campaign_documents(path)
            except ResultsFolderError as error:
                problems.append(str(error))
                continue
            damaged = (*documents.problems, *documents.run_problems)
            problems += [f"{path}: {text}" for text in damaged]
            summary = documents.summary
            if summary is not None and (summary.stopped or summary.broken):
                problems.append(f"{path}: {summary.ending}")
            records = list(flight_records_of(documents))
            found += records
            if records and (path / REPORT).is_file():
                reports[(records[0].campaign, records[0].started_utc)] = path / REPORT
    return found
