"""Writes report.html of a search.

The page of a search: its failures, plots of its parameter space, and its cost; pure.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.foundation.files.document_writer import write_atomically
from wil_campaign.orchestrator.recording.timestamps import utc_text
from wil_campaign.orchestrator.report.rendering.page_parts import render_template
from wil_campaign.plugins.search.exploration.coverage import SpaceCoverage, space_coverage_of
from wil_campaign.plugins.search.exploration.model import SearchFindings
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign
from wil_campaign.plugins.search.exploration.sensed import SensedCoverage
from wil_campaign.plugins.search.exploration.space import SearchSpace
from wil_campaign.plugins.search.report.sensed_svg import sensed_panels
from wil_campaign.plugins.search.report.space_svg import space_panels
from wil_campaign.plugins.search.search_document import BROKEN, sensed_coverage_of, unsettled_texts
from wil_campaign.plugins.search.search_runner import SearchOutcome


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchPage:
    """The page's content besides the findings. files: of confirmed failures, by variant.

    exit_code: of the search. unsettled: sentences about what neither failed nor passed for certain.
    """

    campaign: str
    strategy: str
    objective: tuple[str, ...]
    ended: str
    exit_code: int
    files: Mapping[str, str]
    coverage: SpaceCoverage
    unsettled: tuple[str, ...] = ()
    sensed: tuple[SensedCoverage, ...] = ()


def render_search(
    page: SearchPage, space: SearchSpace, findings: SearchFindings, *, made_utc: str
) -> str:
    """Return the page of a search as HTML."""
    return render_template(
        "search.html.j2",
        package="wil_campaign.plugins.search.report",
        page=page,
        findings=findings,
        panels=space_panels(space, findings),
        seen=sensed_panels(page.sensed),
        constraints=[constraint.text for constraint in space.constraints],
        values_text=space.text,
        farthest="" if page.coverage.farthest is None else space.text(page.coverage.farthest),
        made_utc=made_utc,
    )


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
        unsettled=(*([BROKEN] if outcome.is_broken else []), *unsettled_texts(findings)),
        files=outcome.files,
        coverage=space_coverage_of(search.space, findings.proven_values),
        sensed=sensed_coverage_of(findings),
    )
    path = outcome.folder / FILE_NAME
    write_atomically(
        path, render_search(page, search.space, findings, made_utc=utc_text(time.time()))
    )
    return path
