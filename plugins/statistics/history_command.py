"""`wil-campaign history`: campaigns over time."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.foundation.files.document_writer import HTML, require_own_file
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.cli.text_table import table_lines
from wil_campaign.plugins.statistics.history.folder_history import history as read_history
from wil_campaign.plugins.statistics.history.history import HistoryRow, VerdictVariation
from wil_campaign.plugins.statistics.history.records import HistoryFileError

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
    require_own_file(page, HTML)
    try:
        found = read_history(*folders, keep=keep, campaign=campaign)
        if found.rows and page is not None:
            found.write_page(page)
    except HistoryFileError as error:
        write_stderr(printable_problem(str(error)))
        return 2
    except OSError as error:
        write_stderr(f"{page} cannot be written: {error.strerror or error}")
        return 3
    if found.rows:
        write_stdout((_as_json if json_ else _as_text)(found.rows, found.variations))
    for text in found.problems:
        write_stderr(printable_problem(text))
    return 2 if not found.rows else 3 if found.problems else 0


def _as_text(rows: Sequence[HistoryRow], varied: Sequence[VerdictVariation]) -> str:
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
            _interval_text(row),
            "-" if row.margin is None else f"{row.margin:.3f}",
            "-" if row.duration_s is None else f"{row.duration_s:.1f}",
        )
        for row in rows
    ]
    lines = [
        printable_problem(
            f"{variation.kind}: {variation.campaign} {variation.case} {variation.mode}: "
            f"{variation.text}"
        )
        for variation in varied
    ]
    lines += [
        printable_problem(
            f"other settings than before: {row.campaign} {row.case} {row.mode} from "
            f"{row.started_utc} on"
        )
        for row in rows
        if row.is_other
    ]
    lines += [
        printable_problem(
            f"other firmware than before: {row.campaign} {row.case} {row.mode} from "
            f"{row.started_utc} on: {row.firmware}"
        )
        for row in rows
        if row.other_firmware
    ]
    lines += _endings(rows)
    return "\n".join([table_lines(head, cells), *([""] if lines else []), *lines])


def _passed_text(row: HistoryRow) -> str:
    """Return how many flights passed; a star marks settings or firmware other than before."""
    star = "* " if row.is_other or row.other_firmware else ""
    unproven = f" +{row.unproven} unproven" if row.unproven else ""
    return f"{star}{row.passed}/{row.flown}{unproven}"


def _endings(rows: Sequence[HistoryRow]) -> list[str]:
    """Return a line for each campaign that did not end normally, or whose end is unknown."""
    campaigns = dict.fromkeys((row.campaign, row.started_utc, row.ending) for row in rows)
    return [
        printable_problem(
            f"{name} of {started}: {'how it ended is unknown' if text is None else text}"
        )
        for name, started, text in campaigns
        if text != ""
    ]


def _interval_text(row: HistoryRow) -> str:
    """Return the interval of a pass rate; a dash where no flight proved anything."""
    if row.interval is not None:
        return row.interval.rate_text
    return "equal runs" if row.flown else "-"


def _as_json(rows: Sequence[HistoryRow], varied: Sequence[VerdictVariation]) -> str:
    """Return the history as JSON."""
    document = {
        "schema": "wil/history/1",
        "rows": [asdict(row) for row in rows],
        "variations": [asdict(variation) for variation in varied],
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
