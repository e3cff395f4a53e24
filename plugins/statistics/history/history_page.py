"""The history page: pass rates of each case and mode with intervals, and all figures; pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from wil_campaign.orchestrator.report.rendering.page_parts import render_template
from wil_campaign.plugins.statistics.history.history import HistoryRow, VerdictVariation
from wil_campaign.plugins.statistics.rate_svg import DrawnRate, rate_series


@dataclass(frozen=True, slots=True)
class _Series:
    name: str
    newest: HistoryRow
    svg: Markup


def render_history(
    rows: Sequence[HistoryRow],
    variations: Sequence[VerdictVariation],
    *,
    problems: Sequence[str],
    reports: Mapping[tuple[str, str], str],
    made_utc: str,
) -> str:
    """Return the history page as HTML. reports: links, by campaign and time of its start.

    problems: what is missing or damaged in the folders, and so not shown.
    """
    groups: dict[str, list[HistoryRow]] = {}
    for row in rows:
        groups.setdefault(f"{row.campaign} {row.case} {row.mode}", []).append(row)
    return render_template(
        "history.html.j2",
        package="wil_campaign.plugins.statistics",
        reports=reports,
        problems=problems,
        series=[
            _Series(name, group[-1], rate_series([_rate(row) for row in group]))
            for name, group in groups.items()
        ],
        rows=rows,
        variations=variations,
        made_utc=made_utc,
    )


def _rate(row: HistoryRow) -> DrawnRate:
    is_changed = row.is_other or row.other_firmware
    return DrawnRate(row.passed, row.flown, row.interval, is_changed)
