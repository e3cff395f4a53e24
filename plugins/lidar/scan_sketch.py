"""Lidar scans in the report: seen from above, forward up; SVG of recorded messages."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from wil_campaign.orchestrator.report.rendering.markup import points_text, svg_element

_MOST_BEAMS = 360
_HALF = 110.0


@dataclass(frozen=True, slots=True)
class SketchedScan:
    """A planar lidar scan. Angles in radians, to the right from forward; None: no return."""

    source: str
    start_angle_rad: float
    step_rad: float
    range_max_m: float
    ranges_m: tuple[float | None, ...]


def _scan(document: Mapping[str, Any]) -> SketchedScan:
    wil = document["wil"]
    every = max(1, len(document["ranges"]) // _MOST_BEAMS)
    return SketchedScan(
        source=str(wil["source"]),
        start_angle_rad=float(wil["start_angle_rad"]),
        step_rad=float(wil["step_rad"]) * every,
        range_max_m=float(wil["range_max_m"]),
        ranges_m=tuple(_range(value) for value in document["ranges"][::every]),
    )


def _range(value: Any) -> float | None:
    is_number = isinstance(value, int | float) and math.isfinite(value)
    return float(value) if is_number else None


def scans_svg(documents: Sequence[Mapping[str, Any]]) -> Markup | None:
    """Return recorded scans drawn over each other, the last one on top; None for no whole one."""
    given: list[SketchedScan] = []
    for document in documents:
        with suppress(KeyError, ValueError, TypeError, AttributeError):  # a damaged recording
            given.append(_scan(document))
    if not given:
        return None
    met = [r for scan in given for r in scan.ranges_m if r is not None]
    far_m = min(max(met, default=1.0), max(scan.range_max_m for scan in given))
    scale = (_HALF - 10.0) / max(far_m, 0.1)
    rings = [
        svg_element("circle", {"class": "grid", "cx": 0, "cy": 0, "r": scale * metres})
        for metres in _ring_radii(far_m)
    ]
    labels = [
        svg_element("text", {"class": "tick", "x": 2, "y": -scale * metres - 2}, [f"{metres:g} m"])
        for metres in _ring_radii(far_m)
    ]
    nose = svg_element("path", {"class": "nose", "d": "M0 -7 L4 5 L-4 5 Z"})
    beams = [dot for scan in given for dot in _dots(scan, scale, far_m)]
    box = f"{-_HALF:g} {-_HALF:g} {2 * _HALF:g} {2 * _HALF:g}"
    label = "lidar ranges from above, forward is up"
    attributes = {"class": "scan", "viewBox": box, "role": "img", "aria-label": label}
    return svg_element("svg", attributes, [*rings, *beams, nose, *labels])


def _ring_radii(far_m: float) -> Iterator[float]:
    step = next((one for one in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0) if far_m / one <= 5.0), 50.0)
    yield from (step * k for k in range(1, int(far_m / step) + 1))


def _dots(scan: SketchedScan, scale: float, far_m: float) -> Iterator[Markup]:
    ends = []
    for index, range_m in enumerate(scan.ranges_m):
        if range_m is None or range_m > far_m:
            continue
        angle = scan.start_angle_rad + index * scan.step_rad
        ends.append((scale * range_m * math.sin(angle), -scale * range_m * math.cos(angle)))
    kind = scan.source if scan.source in {"real", "twin", "mixed"} else "other"
    path = " ".join(f"M{points_text([end])}h0" for end in ends)
    yield svg_element("path", {"class": f"beams {kind}", "d": path})
