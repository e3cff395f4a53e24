"""`wil-campaign history`: campaigns over time."""

import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.campaigns.statistics.proportions import Interval
from wil_campaign.orchestrator.cli.standard_streams import err, out
from wil_campaign.orchestrator.cli.text_table import table
from wil_campaign.orchestrator.model.document_writer import write_whole
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.results_folder import read_campaign
from wil_campaign.orchestrator.recording.timestamps import utc_text
from wil_campaign.plugins.statistics.comparison.baseline import results_folders
from wil_campaign.plugins.statistics.history.history import (
    HistoryRow,
    Variation,
    history_rows,
    variations,
)
from wil_campaign.plugins.statistics.history.history_page import render_history
from wil_campaign.plugins.statistics.history.records import (
    FlightRecord,
    HistoryFileError,
    append_records,
    latest,
    read_records,
    records_of,
)
from wil_campaign.worlds.files.problems import printable

_DEFAULT = (Path("results"),)


def history(
    folders: tuple[Path, ...] = _DEFAULT,
    /,
    *,
    keep: Path | None = None,
    page: Path | None = None,
    campaign: str | None = None,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Show pass rates, margins and durations of campaigns over time.

    Flights with other settings (limits, controls, worlds, files) or another firmware than those
    before are marked. Flaky
    are cases that ended differently under the same seed and inputs; stochastic those that did under
    different seeds. Exit code 2: there is nothing to show, or the file of --keep is damaged; 3: a
    folder is damaged, or its campaign was stopped or failed outside of its runs; the rest is shown.

    Parameters
    ----------
    folders
        Results folders of campaigns, or folders that hold some; by default `results`.
    keep
        A file of JSON lines to which new and changed flights are appended; flights in it are shown
        even when their folders are gone.
    page
        Write one HTML page here.
    campaign
        Only the campaign of this name.
    json_
        Print one JSON document.
    """
    problems: list[str] = []
    try:
        known = read_records(keep) if keep is not None else []
        before = set(known)  # also earlier lines: an old copy of a folder is no news
        new = [one for one in latest(_read(folders, problems)) if one not in before]
        if keep is not None:
            append_records(keep, new)
        records = [one for one in latest([*known, *new]) if campaign in {None, one.campaign}]
        if not records:
            where = ", ".join(str(one) for one in folders)
            problems.append(f"no flights of a campaign in {where}")
        rows, varied = history_rows(records), variations(records)
        if records and page is not None:
            write_whole(page, render_history(rows, varied, made_utc=utc_text(time.time())))
    except HistoryFileError as error:
        err(printable(str(error)))
        return 2
    except OSError as error:
        err(f"{page} cannot be written: {error.strerror or error}")
        return 3
    if records:
        out(_as_json(rows, varied) if json_ else _as_text(rows, varied))
    for text in problems:
        err(printable(text))
    return 2 if not records else 3 if problems else 0


def _read(folders: Iterable[Path], problems: list[str]) -> list[FlightRecord]:
    """Return the flights at and beneath folders; unreadable ones are added to the problems."""
    found: list[FlightRecord] = []
    for folder in folders:
        if not folder.is_dir():
            problems.append(f"{folder} is not a folder")
            continue
        for path in results_folders(folder):
            try:
                documents = read_campaign(path)
            except ResultsFolderError as error:
                problems.append(str(error))
                continue
            damaged = (*documents.problems, *documents.run_problems)
            problems += [f"{path}: {text}" for text in damaged]
            summary = documents.summary
            if summary is not None and (summary.stopped or summary.broken):
                problems.append(f"{path}: {summary.ending}")
            found += records_of(documents)
    return found


def _as_text(rows: Sequence[HistoryRow], varied: Sequence[Variation]) -> str:
    """Return the history as a table and sentences."""
    head = ("campaign", "case", "mode", "started", "version", "passed", "95 %", "margin", "flown s")
    cells = [
        (
            row.campaign,
            row.case,
            row.mode,
            row.started_utc,
            row.version,
            _passed_text(row),
            _interval_text(row.interval),
            "-" if row.margin is None else f"{row.margin:.3f}",
            "-" if row.duration_s is None else f"{row.duration_s:.1f}",
        )
        for row in rows
    ]
    lines = [
        printable(f"{one.kind}: {one.campaign} {one.case} {one.mode}: {one.text}") for one in varied
    ]
    lines += [
        printable(
            f"other settings than before: {row.campaign} {row.case} {row.mode} from "
            f"{row.started_utc} on"
        )
        for row in rows
        if row.is_other
    ]
    lines += [
        printable(
            f"other firmware than before: {row.campaign} {row.case} {row.mode} from "
            f"{row.started_utc} on: {row.firmware}"
        )
        for row in rows
        if row.other_firmware
    ]
    lines += _endings(rows)
    return "\n".join([table(head, cells), *([""] if lines else []), *lines])


def _passed_text(row: HistoryRow) -> str:
    """Return how many flights passed; a star marks settings or firmware other than before."""
    star = "* " if row.is_other or row.other_firmware else ""
    unproven = f" +{row.unproven} unproven" if row.unproven else ""
    return f"{star}{row.passed}/{row.flown}{unproven}"


def _endings(rows: Sequence[HistoryRow]) -> list[str]:
    """Return a line for each campaign that did not end normally, or whose end is unknown."""
    campaigns = dict.fromkeys((row.campaign, row.started_utc, row.ending) for row in rows)
    return [
        printable(f"{name} of {started}: {'how it ended is unknown' if text is None else text}")
        for name, started, text in campaigns
        if text != ""
    ]


def _interval_text(interval: Interval | None) -> str:
    return "equal runs" if interval is None else f"[{interval.low:.2f}, {interval.high:.2f}]"


def _as_json(rows: Sequence[HistoryRow], varied: Sequence[Variation]) -> str:
    """Return the history as JSON."""
    document = {
        "schema": "wil/history/1",
        "rows": [asdict(row) for row in rows],
        "variations": [asdict(one) for one in varied],
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
