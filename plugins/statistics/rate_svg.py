"""Pass rates drawn with their Clopper-Pearson intervals, as SVG; pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from wil_campaign.plugins.statistics.proportions import RateInterval

_WIDE, _HIGH, _EDGE = 360.0, 64.0, 8.0
_BAR_WIDE, _BAR_HIGH = 220.0, 18.0


@dataclass(frozen=True, slots=True)
class DrawnRate:
    """A pass rate. interval: None where equal runs count as one, or nothing flew.

    is_changed: flown with other settings or firmware than the rate before it.
    """

    passed: int
    flown: int
    interval: RateInterval | None
    is_changed: bool = False


def rate_series(rates: Sequence[DrawnRate]) -> Markup:
    """Return rates over time, oldest to the left: bars are intervals, dashes are changed settings.

    A change begins a new line.
    """
    step = (_WIDE - 2 * _EDGE) / max(1, len(rates) - 1)
    scale = "".join(
        f'<line class="scale" x1="0" x2="{_WIDE:g}" y1="{_y(share):.1f}" y2="{_y(share):.1f}"/>'
        for share in (0.0, 0.5, 1.0)
    )
    lines: list[list[str]] = [[]]
    bars: list[str] = []
    dots: list[str] = []
    for index, rate in enumerate(rates):
        x = _EDGE + index * step
        if rate.is_changed:
            lines.append([])
            between = x - step / 2 if index else x
            ends = f'x1="{between:.1f}" x2="{between:.1f}" y1="0" y2="{_HIGH:g}"'
            bars.append(f'<line class="changed" {ends}/>')
        if not rate.flown:
            continue
        y = _y(rate.passed / rate.flown)
        lines[-1].append(f"{x:.1f},{y:.1f}")
        if rate.interval is not None:
            ends = f'y1="{_y(rate.interval.low):.1f}" y2="{_y(rate.interval.high):.1f}"'
            bars.append(f'<line class="interval" x1="{x:.1f}" x2="{x:.1f}" {ends}/>')
        dots.append(f'<circle class="rate" cx="{x:.1f}" cy="{y:.1f}" r="3.5"/>')
    series = "".join(
        f'<polyline class="series" points="{" ".join(line)}"/>' for line in lines if line
    )
    return _svg(_WIDE, _HIGH, _series_text(rates), scale + "".join(bars) + series + "".join(dots))


def rate_bar(rate: DrawnRate) -> Markup:
    """Return one rate from 0 to 100 %, left to right, with its interval as a bar."""
    middle = _BAR_HIGH / 2
    whole = f'x1="{_x(0.0):.1f}" x2="{_x(1.0):.1f}" y1="{middle:g}" y2="{middle:g}"'
    parts = [f'<line class="scale" {whole}/>']
    for share in (0.0, 0.5, 1.0):
        ends = f'x1="{_x(share):.1f}" x2="{_x(share):.1f}" y1="3" y2="{_BAR_HIGH - 3:g}"'
        parts.append(f'<line class="scale" {ends}/>')
    if rate.interval is not None:
        ends = f'x1="{_x(rate.interval.low):.1f}" x2="{_x(rate.interval.high):.1f}"'
        parts.append(f'<line class="interval" {ends} y1="{middle:g}" y2="{middle:g}"/>')
    if rate.flown:
        at = f'cx="{_x(rate.passed / rate.flown):.1f}" cy="{middle:g}"'
        parts.append(f'<circle class="rate" {at} r="3.5"/>')
    return _svg(_BAR_WIDE, _BAR_HIGH, rate_text(rate), "".join(parts))


def rate_text(rate: DrawnRate) -> str:
    """Return a rate and its interval in words."""
    text = f"{rate.passed} of {rate.flown} passed"
    if rate.interval is None:
        return text
    return f"{text}, interval of {rate.interval.low:.0%} to {rate.interval.high:.0%}"


def _series_text(rates: Sequence[DrawnRate]) -> str:
    changes = sum(rate.is_changed for rate in rates)
    newest = rate_text(rates[-1]) if rates else "none"
    changed = f"; other settings or firmware {changes} times" if changes else ""
    return f"Pass rates of {len(rates)} campaigns, newest: {newest}{changed}"


def _svg(wide: float, high: float, label: str, inside: str) -> Markup:
    box = f'viewBox="0 0 {wide:g} {high:g}" width="{wide:g}" height="{high:g}"'
    return Markup(  # noqa: S704 - numbers and words of ours alone
        f'<svg class="rates" {box} role="img" aria-label="{label}">{inside}</svg>'
    )


def _y(share: float) -> float:
    return _EDGE + (1.0 - share) * (_HIGH - 2 * _EDGE)


def _x(share: float) -> float:
    return _EDGE + share * (_BAR_WIDE - 2 * _EDGE)
