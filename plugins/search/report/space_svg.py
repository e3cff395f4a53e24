"""The parameter space of a search as SVG: flown, failed, unexplored; pure."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from wil_campaign.orchestrator.report.rendering.markup import svg_element
from wil_campaign.orchestrator.report.words import number_text
from wil_campaign.plugins.search.exploration.coverage import admissible_shares, cell_count, cell_of
from wil_campaign.plugins.search.exploration.model import SearchFindings, TriedVariant
from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter

_SIDE, _LEFT, _TOP, _BOTTOM = 200.0, 46.0, 8.0, 34.0
_MOST_PANELS = 15
"""The pairs of six parameters; the page leaves out more."""
_MARK = 4.0

Axis = tuple[int, SpaceParameter]


@dataclass(frozen=True, slots=True)
class SpacePanel:
    """A drawing of two parameters of the search space."""

    title: str
    svg: Markup


def space_panels(space: SearchSpace, findings: SearchFindings) -> list[SpacePanel]:
    """Return a drawing of each pair of parameters, or of a single parameter."""
    axes = list(enumerate(space.parameters))
    pairs = list(itertools.combinations(axes, 2)) or [(axes[0], axes[0])]
    samples = admissible_shares(space)
    return [
        SpacePanel(
            f"{first[1].name} and {second[1].name}" if first is not second else first[1].name,
            _panel(space, findings, samples, first, second),
        )
        for first, second in pairs[:_MOST_PANELS]
    ]


def _panel(
    space: SearchSpace,
    findings: SearchFindings,
    samples: Sequence[tuple[float, ...]],
    across: Axis,
    up: Axis,
) -> Markup:
    children = [
        *_cells(space, findings, samples, across, up),
        *_refused(space, findings, across, up),
        *_marks(space, findings, across, up),
        *_labels(across[1], up[1]),
    ]
    box = f"0 0 {_LEFT + _SIDE + _TOP:g} {_TOP + _SIDE + _BOTTOM:g}"
    label = f"variants tried by {across[1].name} and {up[1].name}"
    return svg_element(
        "svg", {"class": "space", "viewBox": box, "role": "img", "aria-label": label}, children
    )


def _cells(
    space: SearchSpace,
    findings: SearchFindings,
    samples: Sequence[tuple[float, ...]],
    across: Axis,
    up: Axis,
) -> Iterator[Markup]:
    """Yield the cells: flown, unexplored, or excluded by the constraints."""

    def cell(shares: Sequence[float]) -> tuple[int, int]:
        return cell_of(across[1], shares[across[0]]), cell_of(up[1], shares[up[0]])

    flown = {cell(shares) for values in findings.proven_values if (shares := space.shares(values))}
    # A single parameter is drawn on both axes.
    is_sampled = bool(space.constraints) or across is up
    admissible = {cell(shares) for shares in samples} | flown if is_sampled else None
    columns, rows = cell_count(across[1]), cell_count(up[1])
    for column, row in itertools.product(range(columns), range(rows)):
        known = "cell" if (column, row) in flown else "unexplored"
        yield svg_element(
            "rect",
            {
                "class": known if admissible is None or (column, row) in admissible else "shut",
                "x": _LEFT + _SIDE * column / columns,
                "y": _TOP + _SIDE * (1.0 - (row + 1) / rows),
                "width": _SIDE / columns,
                "height": _SIDE / rows,
            },
        )


def _refused(
    space: SearchSpace, findings: SearchFindings, across: Axis, up: Axis
) -> Iterator[Markup]:
    for variant, _ in findings.refused:
        if (shares := space.shares(variant.values)) is not None:
            x, y = _place(shares, across, up)
            yield svg_element("circle", {"class": "refused", "cx": x, "cy": y, "r": 1.5})


def _marks(
    space: SearchSpace, findings: SearchFindings, across: Axis, up: Axis
) -> Iterator[Markup]:
    """Yield a mark of each flown variant, each failure, and the campaign's own values."""
    for tried_variant in findings.tried:
        if (shares := space.shares(tried_variant.variant.values)) is not None:
            yield _variant_mark(tried_variant, *_place(shares, across, up))
    for case in findings.confirmed:
        found, smallest = space.shares(case.variant.values), space.shares(case.reduced.values)
        if found is not None:
            x, y = _place(found, across, up)
            yield svg_element("circle", {"class": "confirmed", "cx": x, "cy": y, "r": 2 * _MARK})
        if smallest is not None:
            x, y = _place(smallest, across, up)
            corners = f"{x},{y - _MARK} {x + _MARK},{y} {x},{y + _MARK} {x - _MARK},{y}"
            yield svg_element("polygon", {"class": "reduced", "points": corners})
    if (own := space.shares({})) is not None:
        x, y = _place(own, across, up)
        yield svg_element("path", {"class": "own", "d": f"M{x - 6},{y}h12M{x},{y - 6}v12"})


def _variant_mark(tried: TriedVariant, x: float, y: float) -> Markup:
    """Return a variant's mark, by the verdicts of the last mode with a PASS or a FAIL."""
    modes = list(tried.outcomes)
    proven = [mode for mode in modes if tried.failed(mode) or tried.passed(mode)]
    outcomes = tried.outcomes[(proven or modes)[-1]]
    verdicts = {outcome.verdict for outcome in outcomes}
    title = svg_element("title", {}, [f"{tried.variant.name}: {', '.join(sorted(verdicts))}"])
    if "FAIL" in verdicts:
        d = f"M{x - _MARK},{y - _MARK}l8,8M{x - _MARK},{y + _MARK}l8,-8"
        return svg_element("path", {"class": "fail", "d": d}, [title])
    if "PASS" in verdicts:
        return svg_element("circle", {"class": "pass", "cx": x, "cy": y, "r": _MARK - 1.0}, [title])
    corner = {"x": x - 3.0, "y": y - 3.0, "width": 6.0, "height": 6.0}
    return svg_element("rect", {"class": "nothing", **corner}, [title])


def _place(shares: Sequence[float], across: Axis, up: Axis) -> tuple[float, float]:
    x = _LEFT + _SIDE * shares[across[0]]
    y = _TOP + _SIDE * (1.0 - shares[up[0]])
    return round(x, 2), round(y, 2)


def _labels(across: SpaceParameter, up: SpaceParameter) -> Iterator[Markup]:
    """Yield the limits and the names of both axes."""
    bottom = _TOP + _SIDE + 12.0
    low, high = _ends(across)
    yield svg_element("text", {"x": _LEFT, "y": bottom}, [low])
    yield svg_element("text", {"x": _LEFT + _SIDE, "y": bottom, "text-anchor": "end"}, [high])
    middle = {"x": _LEFT + _SIDE / 2, "y": bottom + 14.0, "text-anchor": "middle"}
    yield svg_element("text", {"class": "axis-name", **middle}, [_axis_name(across)])
    if up is across:
        return
    low, high = _ends(up)
    yield svg_element("text", {"x": _LEFT - 4, "y": _TOP + _SIDE, "text-anchor": "end"}, [low])
    yield svg_element("text", {"x": _LEFT - 4, "y": _TOP + 8, "text-anchor": "end"}, [high])
    x, y = 12.0, _TOP + _SIDE / 2
    turned = {"x": x, "y": y, "text-anchor": "middle", "transform": f"rotate(-90 {x} {y})"}
    yield svg_element("text", {"class": "axis-name", **turned}, [_axis_name(up)])


def _ends(parameter: SpaceParameter) -> tuple[str, str]:
    if parameter.choices:
        return str(parameter.choices[0]), str(parameter.choices[-1])
    return number_text(parameter.low), number_text(parameter.high)


def _axis_name(parameter: SpaceParameter) -> str:
    return f"{parameter.name}, {parameter.unit}" if parameter.unit else parameter.name
