"""Plots of clearance, fence margin, height and mixture figures over time."""

from collections.abc import Mapping, Sequence
from typing import Any

from wil_campaign.orchestrator.report.model import Plot, PlotLimit
from wil_campaign.orchestrator.report.reading.closeup import JudgedFlight
from wil_campaign.orchestrator.report.reading.curves import curve_of
from wil_campaign.orchestrator.report.reading.distances import (
    SHOWN_WITHIN_M,
    TimedPose,
    clearance_values,
    fence_distance_values,
    height_values,
    pair_distances,
)
from wil_campaign.orchestrator.report.reading.held_limits import HeldLimit
from wil_campaign.orchestrator.report.reading.world_facts import recorded_body

Poses = Mapping[str, Sequence[TimedPose]]


def motion_plots(
    poses: Poses,
    flight: JudgedFlight,
    subject: str,
    limits: Sequence[HeldLimit],
) -> tuple[Plot, ...]:
    """Return clearance, fence margin, height and the distance between the vehicles.

    subject: the judged vehicle. limits: of the campaign's oracles; those of its own are drawn.
    """
    poses = {name: found for name, found in poses.items() if found}
    limits = [held_limit for held_limit in limits if held_limit.vehicle == subject]
    found = [
        _clearance_plot(poses, flight, subject, limits),
        _fence_plot(poses, flight),
        _height_plot(poses, subject, limits),
    ]
    if poses.get("real") and poses.get("twin"):
        apart = pair_distances(poses["real"], poses["twin"])
        found.append(Plot("real to twin", "m", (curve_of("pair", apart),)))
    return tuple(plot for plot in found if any(curve.stretches for curve in plot.curves))


def _lines(signal: str, limits: Sequence[HeldLimit]) -> tuple[PlotLimit, ...]:
    return tuple(
        dict.fromkeys(held_limit.line for held_limit in limits if held_limit.signal == signal)
    )


def _clearance_plot(
    poses: Poses,
    flight: JudgedFlight,
    subject: str,
    limits: Sequence[HeldLimit],
) -> Plot:
    if not flight.scene.objects:
        return Plot("clearance", "m", ())
    curves = []
    for name, found in poses.items():
        body = recorded_body(flight.campaign, name)
        swept = clearance_values(found, body, flight.scene, flight.motion)
        curves.append(curve_of(name, swept))
    lines = (PlotLimit(0.0), *_lines("clearance_m", limits))
    note = (
        "least distance of the body to objects, between at_height and land to floors too; "
        f"capped at {SHOWN_WITHIN_M:g} m"
    )
    return Plot("clearance", "m", tuple(curves), lines, note, subject)


def _fence_plot(poses: Poses, flight: JudgedFlight) -> Plot:
    curves = tuple(
        curve_of(name, fence_distance_values(poses[name], fences, flight.motion.near_ground_at))
        for name, fences in flight.fences.items()
        if name in poses
    )
    note = "negative is outside; its floor counts between at_height and land"
    if any(len(fences) > 1 for fences in flight.fences.values()):
        note += "; to the fence in force at each time"
    return Plot("margin to the fence", "m", curves, (PlotLimit(0.0),), note)


def _height_plot(poses: Poses, subject: str, limits: Sequence[HeldLimit]) -> Plot:
    own = [held_limit for held_limit in limits if held_limit.signal == "up_m"]
    partial = dict.fromkeys(held_limit.oracle for held_limit in own if not held_limit.is_whole)
    note = f"the limit of {', '.join(partial)} holds only in its interval" if partial else ""
    curves = tuple(curve_of(name, height_values(found)) for name, found in poses.items())
    return Plot("height", "m", curves, _lines("up_m", own), note, subject)


def mixture_plots(
    provenances: Mapping[str, Sequence[tuple[float, Mapping[str, Any]]]],
    at_s: float | None,
) -> tuple[Plot, ...]:
    """Return skew, latency and registration error of each mixed sensor.

    at_s: the moment; the newest mixture at that time is always among the points.
    """
    wanted = (
        ("exposure skew", "ms", "skew_ms", "between the two exposures that were mixed"),
        ("latency", "ms", "latency_ms", "from exposure to delivery, of the newest mixture"),
        (
            "registration error",
            "px",
            "registration_error_px",
            "of virtual objects, in the image; no line while no corner of them is in view",
        ),
        (
            "registration bound",
            "px",
            "registration_bound_px",
            "upper bound of the error; no line while it is unknown",
        ),
    )
    found = []
    for sensor, rows in provenances.items():
        name = sensor if len(provenances) > 1 else ""
        for title, unit, key, note in wanted:
            curve = curve_of("mixed", _values(rows, key), keep_s=at_s)
            if curve.stretches:
                found.append(Plot(f"{title} {name}".rstrip(), unit, (curve,), note=note))
    return tuple(found)


def _values(
    rows: Sequence[tuple[float, Mapping[str, Any]]], key: str
) -> list[tuple[float, float | None]]:
    """Return a figure of each mixture; None where it has none."""
    return [
        (t_s, float(value) if isinstance(value := fields.get(key), int | float) else None)
        for t_s, fields in rows
    ]
