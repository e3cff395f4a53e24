"""Writes report.html of a search."""

import time
from pathlib import Path

from wil_campaign.orchestrator.model.document_writer import write_whole
from wil_campaign.orchestrator.recording.timestamps import utc_text
from wil_campaign.plugins.search.exploration.coverage import coverage_of
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign
from wil_campaign.plugins.search.report.search_page import SearchPage, render_search
from wil_campaign.plugins.search.search_document import sensed_of, unsettled_texts
from wil_campaign.plugins.search.search_runner import SearchOutcome

FILE_NAME = "report.html"


def write_search_page(search: SearchCampaign, outcome: SearchOutcome) -> Path:
    """Write the page of a search into its folder, and return where it is. Raises OSError."""
    findings = outcome.findings
    page = SearchPage(
        campaign=search.campaign.name,
        strategy=search.part.strategy,
        objective=search.part.oracles,
        ended=outcome.ended,
        exit_code=outcome.exit_code,
        unsettled=tuple(unsettled_texts(findings)),
        files=outcome.files,
        coverage=coverage_of(search.space, [one.variant.values for one in findings.tried]),
        sensed=sensed_of(findings),
    )
    path = outcome.folder / FILE_NAME
    write_whole(path, render_search(page, search.space, findings, made_utc=utc_text(time.time())))
    return path
