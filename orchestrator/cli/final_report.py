"""Writes the report at the end of `run` and `search`; its failure leaves the results as is."""

from pathlib import Path

from campaigns.search.search_campaign import SearchCampaign
from orchestrator.cli.standard_streams import err
from orchestrator.report import campaign_report, search_report
from orchestrator.search.search_runner import SearchOutcome


def write_final_report(folder: Path) -> campaign_report.WrittenReport | None:
    """Write the report of a campaign that was just flown, and return where it is.

    None where it was not written: a line on standard error says why.
    """
    try:
        return campaign_report.write_report(folder)
    except KeyboardInterrupt:
        why = "interrupted"
    except Exception as error:  # noqa: BLE001 - the flights are over, and their results are whole
        why = f"{type(error).__name__}: {error}"
    err(
        f"ERROR: {campaign_report.FILE_NAME} was not written ({why}); the results are complete "
        f"without it, and `wil-campaign report {folder}` writes it"
    )
    return None


def write_search_report(search: SearchCampaign, outcome: SearchOutcome) -> Path | None:
    """Write the report of a search; return its path, or None after an error message."""
    try:
        return search_report.write_search_page(search, outcome)
    except Exception as error:  # noqa: BLE001 - the flights are over, and their results are whole
        why = f"{type(error).__name__}: {error}"
        name = search_report.FILE_NAME
        err(f"ERROR: {name} was not written ({why}); the results are complete without it")
        return None
