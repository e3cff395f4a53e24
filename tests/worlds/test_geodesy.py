import math

import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.worlds.frames import Vec3, norm, subtract
from wil_campaign.worlds.geodesy import LocalFrame, ecef_from_geodetic, geodetic_from_ecef

latitudes = st.floats(-90.0, 90.0)
longitudes = st.floats(-180.0, 180.0)
altitudes = st.floats(-400.0, 9000.0)
offsets = st.floats(-5000.0, 5000.0)
vectors = st.tuples(offsets, offsets, offsets)


@given(latitudes, longitudes, altitudes, vectors)
def test_ned_to_geodetic_and_back_is_below_a_millimetre(
    lat: float, lon: float, alt: float, ned: Vec3
) -> None:
    frame = LocalFrame(lat, lon, alt)
    place = frame.to_geodetic(ned)
    back = frame.to_ned(place.latitude_deg, place.longitude_deg, place.altitude_m)
    assert norm(subtract(back, ned)) < 1e-3


@given(latitudes, longitudes, altitudes)
def test_ecef_agrees_with_pyproj(lat: float, lon: float, alt: float) -> None:
    transformer = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    expected = transformer.transform(lon, lat, alt)
    assert norm(subtract(ecef_from_geodetic(lat, lon, alt), expected)) < 1e-6
    place = geodetic_from_ecef(expected)
    ground = ecef_from_geodetic(place.latitude_deg, place.longitude_deg, place.altitude_m)
    assert norm(subtract(ground, expected)) < 1e-6


def test_axes_point_north_east_down() -> None:
    frame = LocalFrame(47.397742, 8.545594, 488.0)
    north = frame.to_ned(47.397742 + 1e-4, 8.545594, 488.0)
    east = frame.to_ned(47.397742, 8.545594 + 1e-4, 488.0)
    down = frame.to_ned(47.397742, 8.545594, 478.0)
    assert north == pytest.approx((11.12, 0.0, 0.0), abs=0.01)
    assert east == pytest.approx((0.0, 7.55, 0.0), abs=0.01)
    assert down == pytest.approx((0.0, 0.0, 10.0), abs=1e-6)


def test_origin_is_zero() -> None:
    assert norm(LocalFrame(-33.0, 151.0, 12.0).to_ned(-33.0, 151.0, 12.0)) < 1e-9


@pytest.mark.parametrize(
    ("lat", "lon", "alt"), [(90.1, 0, 0), (math.nan, 0, 0), (0, 181, 0), (0, 0, math.inf)]
)
def test_impossible_origin_is_refused(lat: float, lon: float, alt: float) -> None:
    with pytest.raises(ValueError, match="is not"):
        LocalFrame(lat, lon, alt)
