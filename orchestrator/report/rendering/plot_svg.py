"""Plots over time as SVG; curves stretch with the page, labels are placed in percent."""

import itertools
import math
from collections.abc import Iterator, Sequence

from markupsafe import Markup

from wil_campaign.orchestrator.report.model import (
    Closeup,
    Plot,
    PlotCurve,
    PlotLimit,
    Point,
    RunReport,
)
from wil_campaign.orchestrator.report.rendering.markup import points_text, svg_element
from wil_campaign.orchestrator.report.rendering.scales import AxisScale, ticks_within, value_scale

_GRID = 1000.0
"""Units of the stretched drawing on both axes."""
_SHORT = 0.8
"""Half the length of the line that a single value is drawn as, in the same units."""
_UNSEEN = 0.5
"""A bend of a line by less is not drawn: a twentieth of a pixel, in the same units."""
_LEAST_STEP = 1e-9
_MOST_STEP = 8.0
"""Farthest distance along the time axis between two points of a straight line."""
_NAMED_FIRST = ("goal", "takeoff", "land", "done")
_ROOM = 0.1
"""Share of the width for the name of a stage."""


def time_scale(run: RunReport) -> AxisScale:
    """Return the time axis, relative to the goal where one was given."""
    return _times(run.span_s, run.goal_s or 0.0, 8)


def _times(span_s: Point, zero_s: float, about: int) -> AxisScale:
    low, high = span_s[0] - zero_s, span_s[1] - zero_s
    high = max(high, low + 1.0)
    return AxisScale(low, high, ticks_within(low, high, about))


def plot_svg(plot: Plot, run: RunReport) -> Markup:
    """Return a plot: its value axis and its curves."""
    times, zero_s = time_scale(run), run.goal_s or 0.0
    values = value_scale([*_values_of(plot), *(plot_limit.value for plot_limit in plot.limits)])
    children = [
        *_grid(times, values),
        *_stage_lines(run, times, zero_s),
        *(_limit_line(limit, times, values, zero_s) for limit in plot.limits),
        _curves(plot, times, values, zero_s),
    ]
    if run.moment is not None:
        children.append(_upright(times.share(run.moment.t_s - zero_s), "moment"))
    children.append(
        svg_element("line", {"class": "cursor", "y1": "0", "y2": "100%", "x1": 0, "x2": 0})
    )
    return _chart(f"{plot.title} in {plot.unit} over time", values, children)


def closeup_svg(closeup: Closeup, goal_s: float | None) -> Markup:
    """Return the close-up of a violation: limit, excess, crossing, and worst value."""
    plot, zero_s = closeup.plot, goal_s or 0.0
    times = _times(closeup.span_s, zero_s, 6)
    values = value_scale(
        [*_values_of(plot), *(plot_limit.value for plot_limit in plot.limits)], about=4
    )
    worst_s, worst = closeup.worst
    spot = {
        "class": "worst",
        "cx": _percent(times.share(worst_s - zero_s)),
        "cy": _percent(1.0 - values.share(worst)),
        "r": 4,
    }
    children = [
        *_grid(times, values),
        *(_limit_line(limit, times, values, zero_s) for limit in plot.limits),
        _curves(plot, times, values, zero_s),
        _upright(times.share(closeup.crossed_s - zero_s), "moment"),
        svg_element("circle", spot),
    ]
    chart = _chart(f"{plot.title} in {plot.unit} about the violation", values, children)
    return chart + _time_axis(times)


def _values_of(plot: Plot) -> Iterator[float]:
    return (value for curve in plot.curves for _, value in curve.points)


def _chart(label: str, values: AxisScale, children: list[Markup]) -> Markup:
    chart = {"class": "chart", "width": "100%", "height": "100%", "role": "img"}
    return Markup("").join(
        [
            svg_element("svg", {"class": "axis", "aria-hidden": "true"}, _value_labels(values)),
            svg_element("svg", {**chart, "aria-label": label}, children),
        ]
    )


def time_axis_svg(run: RunReport) -> Markup:
    """Return the time axis beneath the plots."""
    return _time_axis(time_scale(run))


def _time_axis(times: AxisScale) -> Markup:
    labels = [
        svg_element(
            "text",
            {"x": _percent(times.share(tick)), "y": 14, "text-anchor": _anchor(times.share(tick))},
            [f"{tick:g} s"],
        )
        for tick in times.ticks
    ]
    return svg_element("svg", {"class": "times", "width": "100%", "height": 20}, labels)


def stage_axis_svg(run: RunReport) -> Markup:
    """Return the stage names at their beginnings; a name without space is left out."""
    times, zero_s = time_scale(run), run.goal_s or 0.0
    shares = {stage: times.share(t_s - zero_s) for stage, t_s in run.stages}
    named: dict[str, float] = {}
    for stage in sorted(shares, key=lambda one: one not in _NAMED_FIRST):
        share = shares[stage]
        is_free = all(abs(share - other) >= _ROOM for other in named.values())
        if 0.0 <= share <= 1.0 - _ROOM / 2 and is_free:
            named[stage] = share
    labels = [
        svg_element("text", {"x": _percent(share), "y": 12, "dx": 2}, [stage])
        for stage, share in named.items()
    ]
    return svg_element("svg", {"class": "stages", "width": "100%", "height": 16}, labels)


def _percent(share: float) -> str:
    return f"{100.0 * share:.2f}%"


def _anchor(share: float) -> str:
    if share < 0.03:
        return "start"
    return "end" if share > 0.97 else "middle"


def _grid(times: AxisScale, values: AxisScale) -> Iterator[Markup]:
    for tick in times.ticks:
        yield _upright(times.share(tick), "grid")
    for tick in values.ticks:
        yield _level(values, tick, "grid")


def _upright(share: float, kind: str) -> Markup:
    place = _percent(share)
    return svg_element("line", {"class": kind, "x1": place, "x2": place, "y1": 0, "y2": "100%"})


def _level(values: AxisScale, value: float, kind: str, span: Point = (0.0, 1.0)) -> Markup:
    place = _percent(1.0 - values.share(value))
    ends = {"x1": _percent(span[0]), "x2": _percent(span[1]), "y1": place, "y2": place}
    return svg_element("line", {"class": kind, **ends})


def _limit_line(limit: PlotLimit, times: AxisScale, values: AxisScale, zero_s: float) -> Markup:
    span = (0.0, 1.0)
    if limit.span_s is not None:
        first, last = (times.share(t_s - zero_s) for t_s in limit.span_s)
        span = (min(1.0, max(0.0, first)), min(1.0, max(0.0, last)))
    return _level(values, limit.value, "limit", span)


def _stage_lines(run: RunReport, times: AxisScale, zero_s: float) -> Iterator[Markup]:
    for _, t_s in run.stages:
        share = times.share(t_s - zero_s)
        if 0.0 <= share <= 1.0:
            yield _upright(share, "stage")


def _curves(plot: Plot, times: AxisScale, values: AxisScale, zero_s: float) -> Markup:
    judged = [curve for curve in plot.curves if curve.subject == plot.judged]
    curves = [
        _excess(curve, limit, times, values, zero_s)
        for curve in judged
        for limit in plot.limits
        if limit.is_upper is not None
    ]
    curves += [_curve(curve, times, values, zero_s) for curve in plot.curves]
    box = {
        "viewBox": f"0 0 {_GRID:g} {_GRID:g}",
        "preserveAspectRatio": "none",
        "width": "100%",
        "height": "100%",
    }
    return svg_element("svg", box, curves)


def _curve(curve: PlotCurve, times: AxisScale, values: AxisScale, zero_s: float) -> Markup:
    """Return a curve as one path, broken between its stretches."""
    stretches = (_places(points, times, values, zero_s) for points in curve.stretches)
    return svg_element(
        "path",
        {
            "class": f"curve {_subject(curve.subject)}",
            "d": " ".join(f"M{points_text(_with_length(_bent(stretch)))}" for stretch in stretches),
            "data-name": curve.subject,
            "data-low": repr(values.low),
            "data-high": repr(values.high),
        },
    )


def _places(
    points: Sequence[Point], times: AxisScale, values: AxisScale, zero_s: float
) -> Sequence[Point]:
    """Return where points lie in the stretched drawing."""
    return [
        (_GRID * times.share(t_s - zero_s), _GRID * (1.0 - values.share(value)))
        for t_s, value in points
    ]


def _bent(places: Sequence[Point]) -> Sequence[Point]:
    """Return the places where a line bends, and in between so many that the cursor finds one."""
    kept = list(places[:1])
    for before, place, after in zip(places, places[1:], places[2:], strict=False):
        level = (place[0] - before[0]) / max(after[0] - before[0], _LEAST_STEP)
        straight = before[1] + level * (after[1] - before[1])
        is_far = after[0] - kept[-1][0] > _MOST_STEP
        if is_far or abs(place[1] - straight) > _UNSEEN:
            kept.append(place)
    return [*kept, *places[len(places) - 1 :]] if len(places) > 1 else kept


def _with_length(places: Sequence[Point]) -> Sequence[Point]:
    """Return a line's places; a single one as a short line, which can be seen."""
    if len(places) > 1:
        return places
    x, y = places[0]
    return [(x - _SHORT, y), (x + _SHORT, y)]


def _excess(
    curve: PlotCurve, limit: PlotLimit, times: AxisScale, values: AxisScale, zero_s: float
) -> Markup:
    """Return the areas between a curve and a violated limit, while the limit holds."""
    first_s, last_s = limit.span_s or (-math.inf, math.inf)
    sign = 1.0 if limit.is_upper else -1.0
    base = _GRID * (1.0 - values.share(limit.value))
    areas = []
    for stretch in curve.stretches:
        inside = [one for one in stretch if first_s <= one[0] <= last_s]
        for points in _stretches_beyond(inside, limit.value, sign):
            places = _places(points, times, values, zero_s)
            corners = [(places[0][0], base), *places, (places[-1][0], base)]
            areas.append(svg_element("polygon", {"points": points_text(corners)}))
    return svg_element("g", {"class": "excess"}, areas) if areas else Markup("")


def _stretches_beyond(points: Sequence[Point], value: float, sign: float) -> Iterator[list[Point]]:
    stretch: list[Point] = []
    for one, other in itertools.pairwise(points):
        a, b = sign * (one[1] - value), sign * (other[1] - value)
        if a > 0.0:
            stretch.append(one)
        if (a > 0.0) != (b > 0.0):
            share = a / (a - b)
            stretch.append((one[0] + share * (other[0] - one[0]), value))
            if a > 0.0:
                yield stretch
                stretch = []
    if points and sign * (points[-1][1] - value) > 0.0:
        yield [*stretch, points[-1]]


def _subject(name: str) -> str:
    """Return the CSS class of a subject; other names from a file share one class."""
    return name if name in {"real", "twin", "mixed", "pair"} else "other"


def _value_labels(values: AxisScale) -> Iterator[Markup]:
    for tick in values.ticks:
        share = 1.0 - values.share(tick)
        nudge = "0.8em" if share < 0.1 else "-0.2em" if share > 0.9 else "0.35em"
        place = {"x": "96%", "y": _percent(share), "dy": nudge, "text-anchor": "end"}
        yield svg_element("text", place, [values.tick_text(tick)])
