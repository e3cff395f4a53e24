"""Sensor coverage of a search as SVG: sectors of the field of view by distance; pure."""

from collections.abc import Iterator
from dataclasses import dataclass

from markupsafe import Markup

from wil_campaign.orchestrator.report.rendering.markup import svg_element
from wil_campaign.plugins.search.exploration.sensed import EDGES_M, LEVELS, SensedCoverage

_WIDTH, _ROW, _LEFT, _TOP, _BOTTOM = 200.0, 22.0, 62.0, 8.0, 34.0


@dataclass(frozen=True, slots=True)
class SensedPanel:
    """A drawing of one sensor's coverage, and its figures as text."""

    title: str
    text: str
    svg: Markup


def sensed_panels(coverages: tuple[SensedCoverage, ...]) -> list[SensedPanel]:
    """Return a drawing of each coverage."""
    return [
        SensedPanel(
            f"{coverage.object} by {coverage.sensor}"
            if coverage.object
            else f"nearest by {coverage.sensor}",
            _text(coverage),
            _panel(coverage),
        )
        for coverage in coverages
    ]


def _text(one: SensedCoverage) -> str:
    if not one.seen:
        return f"seen in none of {one.flights} flights"
    near = "" if one.nearest_m is None else f", as near as {one.nearest_m:.2f} m"
    share = f", in up to {100.0 * one.largest_share:.0f} % of the image" if one.object else ""
    distinct = f", {one.reduced} distinct readings" if one.reduced else ""
    return (
        f"seen in {one.seen} of {one.flights} flights{near}{share}; {len(one.cells)} of "
        f"{one.of_cells} cells{distinct}, the last new one in flight {one.newest}"
    )


def _panel(one: SensedCoverage) -> Markup:
    height = _ROW * LEVELS
    box = f"0 0 {_LEFT + _WIDTH + _TOP:g} {_TOP + height + _BOTTOM:g}"
    what = one.object or "the nearest thing"
    label = f"where {one.sensor} saw {what}"
    children = [*_cells(one), *_labels()]
    return svg_element(
        "svg", {"class": "space", "viewBox": box, "role": "img", "aria-label": label}, children
    )


def _cells(one: SensedCoverage) -> Iterator[Markup]:
    """Yield the cells; a seen one has a disc that grows with the number of flights."""
    width = _WIDTH / one.sectors
    for level in range(LEVELS):
        for sector in range(one.sectors):
            count, failed = one.cells.get((sector, level), 0), one.failed.get((sector, level), 0)
            place = {
                "x": round(_LEFT + width * sector, 2),
                "y": round(_TOP + _ROW * (LEVELS - 1 - level), 2),
                "width": round(width, 2),
                "height": _ROW,
            }
            text = f"{count} flights, {failed} of them failed"
            title = svg_element("title", {}, [text])
            yield svg_element(
                "rect", {"class": "cell" if count else "unexplored", **place}, [title]
            )
            if count:
                yield _disc(place, count / one.flights, is_failed=failed > 0, title=text)


def _disc(place: dict[str, float], share: float, *, is_failed: bool, title: str) -> Markup:
    """Return the disc of a seen cell; its area is proportional to the share of flights."""
    radius = max(1.5, 0.45 * _ROW * share**0.5)
    return svg_element(
        "circle",
        {
            "class": "seen failed" if is_failed else "seen",
            "cx": round(place["x"] + place["width"] / 2.0, 2),
            "cy": round(place["y"] + place["height"] / 2.0, 2),
            "r": round(radius, 2),
        },
        [svg_element("title", {}, [title])],
    )


def _labels() -> Iterator[Markup]:
    """Yield the distances between the rows, and the ends of the columns."""
    for index, edge in enumerate(EDGES_M):
        y = _TOP + _ROW * (LEVELS - 1 - index) + 4.0
        yield svg_element("text", {"x": _LEFT - 4, "y": y, "text-anchor": "end"}, [f"{edge:g} m"])
    bottom = _TOP + _ROW * LEVELS + 12.0
    yield svg_element("text", {"x": _LEFT, "y": bottom}, ["left"])
    right = {"x": _LEFT + _WIDTH, "y": bottom, "text-anchor": "end"}
    yield svg_element("text", right, ["right"])
    x, y = 12.0, _TOP + _ROW * LEVELS / 2
    turned = {"x": x, "y": y, "text-anchor": "middle", "transform": f"rotate(-90 {x} {y})"}
    yield svg_element("text", {"class": "axis-name", **turned}, ["distance"])
