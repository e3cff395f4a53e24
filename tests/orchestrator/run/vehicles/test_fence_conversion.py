"""The fence for an autopilot: nowhere tighter than the campaign's."""

import math

import pytest
import shapely

from wil_campaign.orchestrator.run.vehicles.onboard_fences import onboard_fence_of
from wil_campaign.safety.fence.areas import Area, Circle, Polygon
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.vehicles.mavlink.fence_areas import FencePlace, FencePolygon

CIRCLE = Circle((0.0, 0.0), 100.0)
BESIDE: dict[str, Area] = {
    "polygon": Polygon.rectangle((80.0, 160.0), (-20.0, 20.0)),
    "circle": Circle((150.0, 0.0), 80.0),
}


@pytest.mark.parametrize("margin_m", [0.0, 1.0])
@pytest.mark.parametrize("beside", BESIDE)
def test_a_circle_that_is_joined_with_another_area_loses_no_ground(
    beside: str, margin_m: float
) -> None:
    fence = Fence(inclusions=(CIRCLE, BESIDE[beside]))
    onboard = onboard_fence_of(
        fence, margin_m=margin_m, home_ned_m=(0.0, 0.0, 0.0), here_m=(0.0, 0.0), locate=_identity
    )
    (area,) = onboard.areas
    assert isinstance(area, FencePolygon)
    assert len(area.corners) <= 70
    shape = shapely.Polygon(area.corners)
    for degree in range(360):
        reach_m = CIRCLE.radius_m + margin_m - 1e-6
        bearing_rad = math.radians(degree)
        edge = shapely.Point(reach_m * math.cos(bearing_rad), reach_m * math.sin(bearing_rad))
        assert shape.contains(edge), f"at {degree} degrees"
    # The corners stand out by less than one percent of the radius.
    assert -shape.bounds[0] < 1.01 * (CIRCLE.radius_m + margin_m)


def _identity(point_m: tuple[float, float]) -> FencePlace:
    return FencePlace(*point_m)
