"""The report at the end of `search`: whatever becomes of it, the results stay as they are."""

from pathlib import Path

from campaigns.search.search_campaign import SearchCampaign
from orchestrator.cli.standard_streams import err
from orchestrator.report.search_report import FILE_NAME, write_search_page
from orchestrator.search.search_runner import SearchOutcome


def write_search_report(search: SearchCampaign, outcome: SearchOutcome) -> Path | None:
    """Write the page of a search, and return where it is; None, after a line, where it is not."""
    try:
        return write_search_page(search, outcome)
    except Exception as error:  # noqa: BLE001 - the flights are over, and their results are whole
        why = f"{type(error).__name__}: {error}"
        err(f"ERROR: {FILE_NAME} was not written ({why}); the results are complete without it")
        return None
