"""The page of a search: its failures, plots of its parameter space, and its cost; pure."""

from collections.abc import Mapping
from dataclasses import dataclass

from wil_campaign.orchestrator.report.rendering.page_parts import render_template
from wil_campaign.plugins.search.exploration.coverage import SpaceCoverage
from wil_campaign.plugins.search.exploration.model import Findings
from wil_campaign.plugins.search.exploration.sensed import SensedCoverage
from wil_campaign.plugins.search.exploration.space import Space, Values
from wil_campaign.plugins.search.report.sensed_svg import sensed_panels
from wil_campaign.plugins.search.report.space_svg import space_panels


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


def render_search(page: SearchPage, space: Space, findings: Findings, *, made_utc: str) -> str:
    """Return the page of a search as HTML."""

    def values_text(values: Values) -> str:
        units = {one.name: one.unit for one in space.parameters}
        return ", ".join(f"{name} {value} {units[name]}".rstrip() for name, value in values.items())

    return render_template(
        "search.html.j2",
        package="wil_campaign.plugins.search.report",
        page=page,
        findings=findings,
        panels=space_panels(space, findings),
        seen=sensed_panels(page.sensed),
        constraints=[one.text for one in space.constraints],
        values_text=values_text,
        farthest="" if page.coverage.farthest is None else values_text(page.coverage.farthest),
        made_utc=made_utc,
    )
