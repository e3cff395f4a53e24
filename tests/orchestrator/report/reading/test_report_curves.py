"""Where the curves of plots are broken, what stays of many points, and how both are drawn."""

import math
import re

import pytest

from wil_campaign.orchestrator.report.model import Plot, PlotCurve, PlotLimit, RunReport
from wil_campaign.orchestrator.report.reading.curves import curve_of, longest_step_s
from wil_campaign.orchestrator.report.reading.signal_plots import mixture_plots
from wil_campaign.orchestrator.report.rendering.plot_svg import plot_svg


def spans(curve: PlotCurve) -> list[tuple[float, float]]:
    return [(stretch[0][0], stretch[-1][0]) for stretch in curve.stretches]


def drawn(plot: Plot) -> list[str]:
    run = RunReport(name="a/wil/1", case="a", mode="wil", rep="1", result=None, span_s=(0.0, 10.0))
    (path,) = re.findall(r'<path class="curve [^"]*" d="([^"]*)"', plot_svg(plot, run))
    return str(path).split("M")[1:]


def test_there_is_no_line_while_there_is_no_value() -> None:
    rows = [
        (k / 10, {"skew_ms": 1.0, "registration_error_px": None if 30 <= k < 50 else 2.0})
        for k in range(100)
    ]
    plots = {
        mixture_plot.title: mixture_plot for mixture_plot in mixture_plots({"camera": rows}, 4.0)
    }
    (skew,), (error,) = plots["exposure skew"].curves, plots["registration error"].curves
    assert spans(skew) == [(0.0, 9.9)]
    assert spans(error) == [(0.0, 2.9), (5.0, 9.9)]
    assert len(drawn(plots["registration error"])) == 2
    assert "registration bound" not in plots


def test_there_is_no_line_across_a_gap_in_the_recording() -> None:
    values = [(k / 50, 1.0) for k in range(500) if not 200 <= k < 220]
    assert spans(curve_of("real", values)) == [(0.0, 3.98), (4.4, 9.98)]
    # A jitter of one step is no gap, nor are steps of a slow recording.
    assert len(curve_of("real", [(k / 50, 1.0) for k in range(500) if k != 50]).stretches) == 1
    assert len(curve_of("real", [(float(k), 1.0) for k in range(9)]).stretches) == 1


def test_a_single_value_between_gaps_can_be_seen() -> None:
    values = [(k / 10, None if k != 50 else 3.0) for k in range(100)]
    curve = curve_of("mixed", values)
    assert spans(curve) == [(5.0, 5.0)]
    (line,) = drawn(Plot("error", "px", (curve,)))
    (left, _), (right, _) = (map(float, one.split(",")) for one in line.split())
    assert (left, right) == pytest.approx((499.2, 500.8))


def test_the_shading_beyond_a_limit_stops_at_a_gap() -> None:
    curve = PlotCurve("real", (((1.0, 2.0), (2.0, 2.0)), ((7.0, 2.0), (8.0, 2.0))))
    plot = Plot("height", "m", (curve,), (PlotLimit(1.0, is_upper=True),), judged="real")
    run = RunReport(name="a/wil/1", case="a", mode="wil", rep="1", result=None, span_s=(0.0, 10.0))
    areas = re.findall(r'<polygon points="([^"]*)"', plot_svg(plot, run))
    ends = [sorted(float(one.split(",")[0]) for one in area.split()) for area in areas]
    assert [(end[0], end[-1]) for end in ends] == [(100.0, 200.0), (700.0, 800.0)]


@pytest.mark.parametrize("count", [501, 30_000])
def test_least_and_largest_values_stay_of_many_points(count: int) -> None:
    values = [(k / 50, math.sin(k / 40)) for k in range(count)]
    values[count // 3] = (values[count // 3][0], 7.0)
    values[count // 2] = (values[count // 2][0], -7.0)
    curve = curve_of("real", values, keep_s=1.001)
    assert len(curve.points) <= 501
    assert {values[count // 3], values[count // 2], values[50]} <= set(curve.points)
    assert list(curve.points) == sorted(curve.points)


def test_many_narrow_gaps_of_a_long_flight_are_not_drawn_one_by_one() -> None:
    values = [(k / 15, 1.0 if k % 2 else None) for k in range(9000)]
    curve = curve_of("mixed", values)
    assert len(curve.stretches) == 1
    assert len(curve.points) <= 500


def test_nothing_has_no_curve() -> None:
    assert curve_of("real", []).stretches == ()
    assert curve_of("real", [(0.0, None), (1.0, math.nan)]).stretches == ()
    assert longest_step_s([]) == longest_step_s([1.0]) == pytest.approx(0.2)
