"""Plots over time as SVG. Curves stretch with the page, labels do not: places are in percent."""

from collections.abc import Iterator

from markupsafe import Markup

from orchestrator.report.model import Curve, Plot, RunReport
from orchestrator.report.rendering.markup import element, points_text
from orchestrator.report.rendering.scales import Scale, ticks_within, value_scale

_GRID = 1000.0
"""Units of the stretched drawing in both directions."""
_NAMED_FIRST = ("goal", "takeoff", "land", "done")
_ROOM = 0.1
"""Of the width, for the name of a stage."""


def time_scale(run: RunReport) -> Scale:
    """Return the axis of time, relative to the goal where it was given."""
    zero_s = run.goal_s or 0.0
    low, high = run.span_s[0] - zero_s, run.span_s[1] - zero_s
    high = max(high, low + 1.0)
    return Scale(low, high, ticks_within(low, high, 8))


def plot_svg(plot: Plot, run: RunReport) -> Markup:
    """Return a plot: its axis of values beside its curves."""
    times, zero_s = time_scale(run), run.goal_s or 0.0
    values = value_scale(
        [*(value for curve in plot.curves for _, value in curve.points), *plot.limits]
    )
    children = [
        *_grid(times, values),
        *_stage_lines(run, times, zero_s),
        *(_level(values, limit, "limit") for limit in plot.limits),
        _curves(plot, times, values, zero_s),
    ]
    if run.moment is not None:
        children.append(_upright(times.share(run.moment.t_s - zero_s), "moment"))
    children.append(element("line", {"class": "cursor", "y1": "0", "y2": "100%", "x1": 0, "x2": 0}))
    label = f"{plot.title} in {plot.unit} over time"
    chart = {"class": "chart", "width": "100%", "height": "100%", "role": "img"}
    return Markup("").join(
        [
            element("svg", {"class": "axis", "aria-hidden": "true"}, _value_labels(values)),
            element("svg", {**chart, "aria-label": label}, children),
        ]
    )


def time_axis_svg(run: RunReport) -> Markup:
    """Return the axis of time beneath the plots, and the stages on it."""
    times = time_scale(run)
    labels = [
        element(
            "text",
            {"x": _percent(times.share(tick)), "y": 14, "text-anchor": _anchor(times.share(tick))},
            [f"{tick:g} s"],
        )
        for tick in times.ticks
    ]
    return element("svg", {"class": "times", "width": "100%", "height": 20}, labels)


def stage_axis_svg(run: RunReport) -> Markup:
    """Return the names of the stages where each begins; one that has no room is left out."""
    times, zero_s = time_scale(run), run.goal_s or 0.0
    shares = {stage: times.share(t_s - zero_s) for stage, t_s in run.stages}
    named: dict[str, float] = {}
    for stage in sorted(shares, key=lambda one: one not in _NAMED_FIRST):
        share = shares[stage]
        is_free = all(abs(share - other) >= _ROOM for other in named.values())
        if 0.0 <= share <= 1.0 - _ROOM / 2 and is_free:
            named[stage] = share
    labels = [
        element("text", {"x": _percent(share), "y": 12, "dx": 2}, [stage])
        for stage, share in named.items()
    ]
    return element("svg", {"class": "stages", "width": "100%", "height": 16}, labels)


def _percent(share: float) -> str:
    return f"{100.0 * share:.2f}%"


def _anchor(share: float) -> str:
    if share < 0.03:
        return "start"
    return "end" if share > 0.97 else "middle"


def _grid(times: Scale, values: Scale) -> Iterator[Markup]:
    for tick in times.ticks:
        yield _upright(times.share(tick), "grid")
    for tick in values.ticks:
        yield _level(values, tick, "grid")


def _upright(share: float, kind: str) -> Markup:
    place = _percent(share)
    return element("line", {"class": kind, "x1": place, "x2": place, "y1": 0, "y2": "100%"})


def _level(values: Scale, value: float, kind: str) -> Markup:
    place = _percent(1.0 - values.share(value))
    return element("line", {"class": kind, "x1": 0, "x2": "100%", "y1": place, "y2": place})


def _stage_lines(run: RunReport, times: Scale, zero_s: float) -> Iterator[Markup]:
    for _, t_s in run.stages:
        share = times.share(t_s - zero_s)
        if 0.0 <= share <= 1.0:
            yield _upright(share, "stage")


def _curves(plot: Plot, times: Scale, values: Scale, zero_s: float) -> Markup:
    curves = [_curve(curve, times, values, zero_s) for curve in plot.curves]
    box = {
        "viewBox": f"0 0 {_GRID:g} {_GRID:g}",
        "preserveAspectRatio": "none",
        "width": "100%",
        "height": "100%",
    }
    return element("svg", box, curves)


def _curve(curve: Curve, times: Scale, values: Scale, zero_s: float) -> Markup:
    points = (
        (_GRID * times.share(t_s - zero_s), _GRID * (1.0 - values.share(value)))
        for t_s, value in curve.points
    )
    return element(
        "polyline",
        {
            "class": f"curve {_subject(curve.subject)}",
            "points": points_text(points),
            "data-name": curve.subject,
            "data-low": repr(values.low),
            "data-high": repr(values.high),
        },
    )


def _subject(name: str) -> str:
    """Return a class for a subject; a name from a file never becomes one."""
    return name if name in {"real", "twin", "mixed", "pair"} else "other"


def _value_labels(values: Scale) -> Iterator[Markup]:
    for tick in values.ticks:
        share = 1.0 - values.share(tick)
        nudge = "0.8em" if share < 0.1 else "-0.2em" if share > 0.9 else "0.35em"
        place = {"x": "96%", "y": _percent(share), "dy": nudge, "text-anchor": "end"}
        yield element("text", place, [values.tick_text(tick)])
