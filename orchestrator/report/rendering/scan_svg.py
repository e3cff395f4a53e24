"""A lidar scan seen from above, forward up; SVG."""

import math
from collections.abc import Iterator, Sequence

from markupsafe import Markup

from wil_campaign.orchestrator.report.model import Frame, Scan
from wil_campaign.orchestrator.report.rendering.markup import element, points_text

_HALF = 110.0


def scan_svg(scans: Sequence[Scan | Frame]) -> Markup | None:
    """Return scans drawn over each other, the last one on top; None without a scan."""
    given = [one for one in scans if isinstance(one, Scan)]
    if not given:
        return None
    met = [r for scan in given for r in scan.ranges_m if r is not None]
    far_m = min(max(met, default=1.0), max(scan.range_max_m for scan in given))
    scale = (_HALF - 10.0) / max(far_m, 0.1)
    rings = [
        element("circle", {"class": "grid", "cx": 0, "cy": 0, "r": scale * metres})
        for metres in _ring_radii(far_m)
    ]
    labels = [
        element("text", {"class": "tick", "x": 2, "y": -scale * metres - 2}, [f"{metres:g} m"])
        for metres in _ring_radii(far_m)
    ]
    nose = element("path", {"class": "nose", "d": "M0 -7 L4 5 L-4 5 Z"})
    beams = [dot for scan in given for dot in _dots(scan, scale, far_m)]
    box = f"{-_HALF:g} {-_HALF:g} {2 * _HALF:g} {2 * _HALF:g}"
    label = "lidar ranges from above, forward is up"
    attributes = {"class": "scan", "viewBox": box, "role": "img", "aria-label": label}
    return element("svg", attributes, [*rings, *beams, nose, *labels])


def _ring_radii(far_m: float) -> Iterator[float]:
    step = next((one for one in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0) if far_m / one <= 5.0), 50.0)
    yield from (step * k for k in range(1, int(far_m / step) + 1))


def _dots(scan: Scan, scale: float, far_m: float) -> Iterator[Markup]:
    ends = []
    for index, range_m in enumerate(scan.ranges_m):
        if range_m is None or range_m > far_m:
            continue
        angle = scan.start_angle_rad + index * scan.step_rad
        ends.append((scale * range_m * math.sin(angle), -scale * range_m * math.cos(angle)))
    kind = scan.source if scan.source in {"real", "twin", "mixed"} else "other"
    path = " ".join(f"M{points_text([end])}h0" for end in ends)
    yield element("path", {"class": f"beams {kind}", "d": path})
