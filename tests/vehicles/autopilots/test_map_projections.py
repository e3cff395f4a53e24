"""Degrees to metres as the autopilots do it: cases computed by hand, and there and back."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.ardupilot.simulated_truth import ArduPilotProjection
from wil_campaign.vehicles.autopilots.map_projections import Px4Projection
from wil_campaign.worlds.geodesy import LocalFrame

ZURICH = (47.397742, 8.545594)


def test_ardupilot_degrees_are_as_long_as_its_scaling_factor() -> None:
    here = ArduPilotProjection(60.0, 8.0)
    # 1e-5 degrees are 100 units of 1e-7: 1.11318845 m northwards.
    assert here.to_metres(60.00001, 8.0) == pytest.approx((1.1131884502, 0.0), abs=1e-6)
    # Half as long eastwards at 60 degrees.
    assert here.to_metres(60.0, 8.00001) == pytest.approx((0.0, 0.5565942251), abs=1e-6)


def test_ardupilot_scales_longitude_by_the_latitude_in_the_middle() -> None:
    here = ArduPilotProjection(0.0, 0.0)
    _, east_m = here.to_metres(80.0, 1.0)
    assert east_m == pytest.approx(111318.845021 * math.cos(math.radians(40.0)), abs=1e-3)


def test_ardupilot_crosses_the_date_line() -> None:
    assert ArduPilotProjection(0.0, 179.99999).to_metres(0.0, -179.99999) == pytest.approx(
        (0.0, 2.2263769), abs=1e-6
    )


def test_px4_degrees_are_arcs_of_its_sphere() -> None:
    degree_m = 6_371_000.0 * math.pi / 180.0
    here = Px4Projection(0.0, 0.0)
    assert here.to_metres(1.0, 0.0) == pytest.approx((degree_m, 0.0), abs=1e-6)
    assert here.to_metres(0.0, 1.0) == pytest.approx((0.0, degree_m), abs=1e-6)
    # 1e-5 degrees north at 60 degrees: 1.1119493 m; east half of it.
    north_m, east_m = Px4Projection(60.0, 8.0).to_metres(60.00001, 8.00001)
    assert (north_m, east_m) == pytest.approx((1.1119493, 0.5559746), abs=1e-6)


@pytest.mark.parametrize("kind", [Px4Projection, ArduPilotProjection])
@given(north_m=st.floats(-2000.0, 2000.0), east_m=st.floats(-2000.0, 2000.0))
def test_metres_come_back_from_degrees(
    kind: type[Px4Projection] | type[ArduPilotProjection], north_m: float, east_m: float
) -> None:
    here = kind(*ZURICH)
    back = here.to_metres(*here.to_degrees(north_m, east_m))
    assert back == pytest.approx((north_m, east_m), abs=1e-6)


@pytest.mark.parametrize(("kind", "apart_m"), [(Px4Projection, 0.29), (ArduPilotProjection, 0.18)])
def test_wgs84_is_centimetres_off_within_a_hall(
    kind: type[Px4Projection] | type[ArduPilotProjection], apart_m: float
) -> None:
    """The reason for these projections: at 100 m, WGS-84 gives other metres than were flown."""
    latitude_deg, longitude_deg = kind(*ZURICH).to_degrees(0.0, 100.0)
    _, east_m, _ = LocalFrame(*ZURICH, 0.0).to_ned(latitude_deg, longitude_deg, 0.0)
    assert abs(east_m - 100.0) == pytest.approx(apart_m, abs=0.01)
