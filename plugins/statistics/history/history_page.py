"""The history page: a curve of pass rates for each case and mode, and all figures; pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from wil_campaign.orchestrator.report.rendering.page_parts import render_template
from wil_campaign.plugins.statistics.history.history import HistoryRow, Variation

_WIDE, _HIGH, _EDGE = 360.0, 64.0, 6.0


@dataclass(frozen=True, slots=True)
class _Series:
    name: str
    newest: HistoryRow
    svg: Markup


def render_history(
    rows: Sequence[HistoryRow], variations: Sequence[Variation], *, made_utc: str
) -> str:
    """Return the history page as HTML."""
    groups: dict[str, list[HistoryRow]] = {}
    for row in rows:
        groups.setdefault(f"{row.campaign} {row.case} {row.mode}", []).append(row)
    return render_template(
        "history.html.j2",
        package="wil_campaign.plugins.statistics",
        series=[_Series(name, group[-1], _curve(group)) for name, group in groups.items()],
        rows=rows,
        variations=variations,
        made_utc=made_utc,
    )


def _curve(rows: Sequence[HistoryRow]) -> Markup:
    """Return the pass rates of a case and mode as SVG, with their intervals, oldest to the left.

    Flights by other settings or firmware than those before begin a new line.
    """
    step = (_WIDE - 2 * _EDGE) / max(1, len(rows) - 1)
    lines: list[list[str]] = [[]]
    marks: list[str] = []
    for index, row in enumerate(rows):
        if row.is_other or row.other_firmware:
            lines.append([])
        if not row.flown:
            continue
        x, y = _EDGE + index * step, _y(row.passed / row.flown)
        lines[-1].append(f"{x:.1f},{y:.1f}")
        if row.interval is not None:
            ends = f'y1="{_y(row.interval.low):.1f}" y2="{_y(row.interval.high):.1f}"'
            marks.append(f'<line class="axis" x1="{x:.1f}" x2="{x:.1f}" {ends}/>')
        marks.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.5" fill="currentColor"/>')
    line = "".join(
        f'<polyline points="{" ".join(points)}" fill="none" stroke="currentColor"/>'
        for points in lines
    )
    box = f'viewBox="0 0 {_WIDE:g} {_HIGH:g}" width="{_WIDE:g}" height="{_HIGH:g}"'
    return Markup(  # noqa: S704 - numbers only
        f'<svg {box} role="img" aria-label="pass rate over time">{line}{"".join(marks)}</svg>'
    )


def _y(share: float) -> float:
    return _EDGE + (1.0 - share) * (_HIGH - 2 * _EDGE)
