"""Merges: priority with soft edge and occlusion, replacement, aggregation, points, sound."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from tests.recipes.samples import (
    HEIGHT,
    WIDTH,
    beam,
    build,
    camera,
    cloud,
    depth,
    fix,
    imu,
    plain,
    pose,
    scan,
    sound,
)
from wil_campaign.recipes.working import Masked
from wil_campaign.worlds.frames import Pose, angle_between, quat_from_euler

RED, GREEN, WHITE = (0, 0, 255), (0, 255, 0), (255, 255, 255)
near = st.floats(-9, 9, width=32)
pairs = st.integers(1, 20).flatmap(
    lambda n: st.tuples(
        *[
            npst.arrays(
                np.float32,
                n,
                elements=st.one_of(st.floats(0, 60, width=32), st.just(np.float32(np.inf))),
            )
        ]
        * 2,
        npst.arrays(np.bool_, n),
    )
)


def merged(name: str, real: Any, twin: Any, /, *, mask: Any = None, **options: Any) -> Any:
    above = Masked(twin, None if mask is None else np.where(mask, 255, 0).astype(np.uint8))
    return build(name, stage="merge", **options)({"real": Masked(real), "twin": above})


def disc(radius: float = 12.0) -> Any:
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.hypot(u - 32, v - 24) <= radius


def test_replacement_by_source_world_is_total() -> None:
    for real, twin in (
        (camera(source="real"), camera(plain(RED))),
        (imu("real"), imu(rates_frd_rad_s=(9.0, 9.0, 9.0))),
        (sound([1], "real"), sound([2])),
        (cloud([[1, 1, 1]], "real"), cloud([[2, 2, 2]])),
    ):
        made = merged("replace", real, twin, source="twin")
        for name in ("image_bgr", "rates_frd_rad_s", "samples", "points_frd_m"):
            if hasattr(made, name):
                assert np.array_equal(getattr(made, name), getattr(twin, name))
        back = merged("replace", real, twin, source="real")
        for name in ("image_bgr", "rates_frd_rad_s", "samples", "points_frd_m"):
            if hasattr(made, name):
                assert np.array_equal(getattr(back, name), getattr(real, name))


def test_replacement_in_a_sector_and_a_region() -> None:
    real, twin = scan(np.full(8, 5.0), "real"), scan(np.full(8, 1.0))
    made = merged("replace", real, twin, sector={"from_deg": -50.0, "to_deg": 50.0}).ranges_m
    assert np.array_equal(made == 1.0, np.abs(np.degrees(real.angles_rad)) <= 50)
    points = merged(
        "replace",
        cloud([[3, 0, 0], [-3, 0, 0]], "real"),
        cloud([[1, 0, 0], [-1, 0, 0]]),
        sector={"from_deg": -90.0, "to_deg": 90.0},
    ).points_frd_m
    assert points.tolist() == [[-3, 0, 0], [1, 0, 0]]
    half = merged(
        "replace", camera(plain(GREEN), "real"), camera(plain(RED)), region={"right": 0.5}
    ).image_bgr
    assert (half[:, : WIDTH // 2] == RED).all()
    assert (half[:, WIDTH // 2 :] == GREEN).all()


@pytest.mark.parametrize(
    ("real", "twin", "when", "replaced"),
    [
        (fix(1, 2, "real", fix_type=1), fix(3, 4), {"what": "fix_type", "below": 3.0}, True),
        (fix(1, 2, "real"), fix(3, 4), {"what": "fix_type", "below": 3.0}, False),
        (fix(1, 2, "real"), fix(3, 4), {"what": "horizontal_accuracy_m", "above": 0.5}, True),
        (beam(40.0, "real"), beam(2.0), {"what": "range_m", "above": 30.0}, True),
        (sound([0, 0], "real"), sound([9, 9]), {"what": "loudness_pa", "below": 0.01}, True),
        (pose(source="real"), pose(Pose((9, 9, 9))), {"what": "up_m", "above": 0.0}, False),
        (camera(plain((9, 9, 9)), "real"), camera(), {"what": "brightness", "below": 20.0}, True),
    ],
)
def test_replacement_by_a_condition(real: Any, twin: Any, when: Any, replaced: bool) -> None:
    made = merged("replace", real, twin, when={"of": "real", **when})
    for name in ("latitude_deg", "range_m", "samples", "pose", "image_bgr"):
        if hasattr(real, name):
            expected = twin if replaced else real
            assert np.array_equal(getattr(made, name), getattr(expected, name))


@given(pairs)
def test_a_condition_may_hold_for_some_beams(given_pair: Any) -> None:
    a, b, mask = given_pair
    made = merged(
        "replace",
        scan(a, "real"),
        scan(b),
        mask=mask,
        when={"of": "twin", "what": "range_m", "below": 20.0},
    ).ranges_m
    assert np.array_equal(made, np.where((b < 20) & mask, b, a))


@given(pairs)
def test_aggregation_of_beams_is_that_of_a_plain_loop(given_pair: Any) -> None:
    a, b, mask = given_pair
    for by, options in (
        ("min", {}),
        ("max", {}),
        ("mean", {}),
        ("median", {}),
        ("weighted", {"real_weight": 1.0, "twin_weight": 3.0}),
    ):
        made = merged("aggregate", scan(a, "real"), scan(b), mask=mask, by=by, **options).ranges_m
        for x, y, kept, found in zip(a.tolist(), b.tolist(), mask, made.tolist(), strict=True):
            values = [x, y] if kept else [x]
            finite = [v for v in values if math.isfinite(v)]
            if by == "min":
                expected = min(values)
            elif by == "max":
                expected = max(values)
            elif not finite:
                expected = math.inf
            elif by == "weighted" and len(finite) == 2:
                expected = (x + 3 * y) / 4
            else:
                expected = sum(finite) / len(finite)
            assert found == pytest.approx(expected, rel=1e-6)


def test_aggregation_of_images_and_depth() -> None:
    real, twin = camera(plain((0, 100, 200)), "real"), camera(plain((100, 0, 200)))
    expected = {"mean": (50, 50, 200), "min": (0, 0, 200), "max": (100, 100, 200)}
    for by, color in expected.items():
        made = merged("aggregate", real, twin, mask=disc(), by=by).image_bgr
        assert (made[disc()] == color).all()
        assert (made[~disc()] == (0, 100, 200)).all()
    weighted = merged("aggregate", real, twin, by="weighted", real_weight=3.0, twin_weight=1.0)
    assert (weighted.image_bgr == (25, 75, 200)).all()
    nearest = merged("aggregate", depth(5.0, "real"), depth(3.0), mask=disc(), by="min").depth_m
    assert np.array_equal(nearest == 3.0, disc())


def test_a_pixel_that_is_kept_in_part_is_kept() -> None:
    real, twin = camera(plain((0, 100, 200)), "real"), camera(plain((100, 0, 200)))
    edge = np.full((HEIGHT, WIDTH), 128, np.uint8)
    for masks in ((edge, None), (None, edge)):
        sides = {"real": Masked(real, masks[0]), "twin": Masked(twin, masks[1])}
        assert (build("aggregate", by="mean")(sides).image_bgr == (50, 50, 200)).all()


def test_an_image_of_one_pixel_is_mixed_too() -> None:
    real, twin = (camera(plain(color, width=1, height=1)) for color in (WHITE, (55, 55, 55)))
    sides = {"real": Masked(real), "twin": Masked(twin, np.array([[128]], np.uint8))}
    assert build("overlay")(sides).image_bgr.tolist() == [[[155] * 3]]
    assert build("aggregate", by="mean")(sides).image_bgr.tolist() == [[[155] * 3]]
    empty = Masked(twin, np.zeros((1, 1), np.uint8))
    assert build("aggregate", by="mean")({**sides, "twin": empty}).image_bgr.tolist() == [
        [[255] * 3]
    ]
    for exposure in (True, False):
        match = build("match_photometry", stage="filter", exposure=exposure)
        assert match(Masked(twin), Masked(real)).reading.image_bgr.tolist() == [[[55] * 3]]
    assert build("subtract_background")(Masked(twin), None).mask.shape == (1, 1)


def test_aggregation_of_single_values_and_places() -> None:
    assert merged("aggregate", beam(4.0, "real"), beam(2.0), by="mean").range_m == 3.0
    assert merged("aggregate", beam(4.0, "real"), beam(math.inf), by="mean").range_m == 4.0
    made = merged("aggregate", imu("real"), imu(rates_frd_rad_s=(1.0, 1.0, 1.0)), by="max")
    assert made.rates_frd_rad_s == (1.0, 1.0, 1.0)
    east = merged("aggregate", fix(10, 179.0, "real"), fix(12, -179.0), by="mean")
    assert (east.latitude_deg, abs(east.longitude_deg)) == (11.0, 180.0)
    one, two = (Pose((0, 0, 0), quat_from_euler(0, 0, yaw)) for yaw in (0.0, 1.0))
    half = merged("aggregate", pose(one, "real"), pose(two), by="mean").pose
    assert angle_between(half.q_wxyz, quat_from_euler(0, 0, 0.5)) < 1e-9
    tilted = merged(
        "aggregate", pose(one, "real"), pose(two), by="weighted", real_weight=0.0, twin_weight=2.0
    )
    assert tilted.pose == two


@given(
    npst.arrays(
        np.float32, st.tuples(st.integers(0, 9), st.just(3)), elements=st.floats(-9, 9, width=32)
    ),
    npst.arrays(
        np.float32, st.tuples(st.integers(1, 9), st.just(3)), elements=st.floats(-9, 9, width=32)
    ),
)
def test_points_are_put_together(a: Any, b: Any) -> None:
    mask = np.arange(len(b)) % 2 == 0
    made = merged("concatenate", cloud(a, "real"), cloud(b), mask=mask)
    assert np.array_equal(made.points_frd_m, np.concatenate([a, b[mask]]))


def test_points_of_a_sensor_elsewhere_are_moved() -> None:
    twin = cloud([[1, 0, 0]], mount=Pose((0.5, 0, 0), quat_from_euler(0, 0, math.pi / 2)))
    made = merged("concatenate", cloud([[9, 9, 9]], "real"), twin).points_frd_m
    assert made[1] == pytest.approx([0.5, 1, 0], abs=1e-6)


def test_every_merge_passes_the_real_side_alone() -> None:
    cases: tuple[tuple[str, Any, dict[str, Any]], ...] = (
        ("overlay", camera(source="real"), {}),
        ("replace", camera(source="real"), {"source": "twin"}),
        ("aggregate", beam(2.0, "real"), {"by": "min"}),
        ("concatenate", cloud([[1, 2, 3]], "real"), {}),
        ("add", sound([5, 6], "real"), {}),
    )
    for name, real, options in cases:
        made = build(name, **options)({"real": Masked(real)})
        assert type(made) is type(real)
        assert made.source == "real"
