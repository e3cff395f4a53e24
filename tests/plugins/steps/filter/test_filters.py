"""Filters keep what they say, and nothing else."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from tests.recipes.samples import (
    HEIGHT,
    WIDTH,
    apply,
    beam,
    build,
    camera,
    cloud,
    depth,
    plain,
    scan,
)
from wil_campaign.recipes.model.registry import StepContext
from wil_campaign.recipes.working import CannotMixError, Masked

ranges = npst.arrays(
    np.float32,
    st.integers(3, 40),
    elements=st.one_of(st.floats(0, 100, width=32), st.just(np.float32(np.inf))),
)
clouds = npst.arrays(
    np.float32, st.tuples(st.integers(1, 60), st.just(3)), elements=st.floats(-50, 50, width=32)
)


def kept(work: Any) -> Any:
    return np.ones(len(work.reading.ranges_m), bool) if work.mask is None else work.mask == 255


@given(ranges, st.floats(0, 50), st.floats(0.1, 60), st.sampled_from(["inside", "outside"]))
def test_a_range_of_values(values: Any, low: float, width: float, keep: Any) -> None:
    work = apply("value_range", scan(values), min_m=low, max_m=low + width, keep=keep)
    inside = (values >= low) & (values <= low + width)
    assert np.array_equal(kept(work), inside if keep == "inside" else ~inside)
    assert np.array_equal(work.reading.ranges_m, values)


def test_a_range_of_values_of_other_sensors() -> None:
    assert apply("value_range", beam(3.0), max_m=2.0).mask.tolist() == [0]
    assert apply("value_range", beam(2.0), max_m=2.0).mask.tolist() == [255]
    work = apply("value_range", cloud([[3, 4, 0], [1, 0, 0]]), min_m=2.0)
    assert work.mask.tolist() == [255, 0]
    assert (apply("value_range", depth(3.0), min_m=4.0).mask == 0).all()


@given(ranges)
def test_filters_only_ever_narrow(values: Any) -> None:
    first = np.where(np.arange(len(values)) % 2, 255, 0).astype(np.uint8)
    for name, options in (
        ("value_range", {"max_m": 50.0}),
        ("remove_outliers", {}),
        ("decimate", {"every": 3}),
        ("isolate_sector", {"from_deg": -30.0, "to_deg": 80.0}),
    ):
        work = build(name, **options)(Masked(scan(values), first), None)
        assert not (work.mask[first == 0]).any(), name


def test_lone_returns_are_outliers_and_nothing_met_is_none() -> None:
    values = np.full(60, 5.0)
    values[[10, 30]] = 1.0
    values[40:44] = 2.0
    values[50] = np.inf
    keep = kept(apply("remove_outliers", scan(values), within_m=0.2, window=2, neighbours=1))
    assert np.flatnonzero(~keep).tolist() == [10, 30]


def test_the_ends_of_a_full_turn_are_neighbours() -> None:
    turn = np.full(36, 5.0)
    turn[0] = turn[-1] = 2.0
    assert kept(apply("remove_outliers", scan(turn), window=1)).all()
    half = scan(turn, step_rad=np.pi / 36)
    assert np.flatnonzero(~kept(apply("remove_outliers", half, window=1))).tolist() == [0, 35]


@given(clouds, st.floats(0.1, 5))
def test_points_with_neighbours_are_those_of_a_plain_count(points: Any, within: float) -> None:
    keep = apply("remove_outliers", cloud(points), within_m=within, neighbours=2).mask == 255
    cells = np.floor(points.astype(np.float64) / within)
    near = (np.abs(cells[:, None] - cells[None]) <= 1).all(axis=2).sum(axis=1) - 1
    assert np.array_equal(keep, near >= 2)


def test_speckles_of_a_depth_picture_are_outliers() -> None:
    values = np.full((HEIGHT, WIDTH), 4.0)
    values[20, 30] = 1.0
    work = apply("remove_outliers", depth(values), within_m=0.5)
    assert np.argwhere(work.mask == 0).tolist() == [[20, 30]]


@given(ranges, st.sampled_from([3, 5]))
def test_the_median_of_beams_is_that_of_a_plain_loop(values: Any, window: int) -> None:
    half = window // 2
    made = apply("median", scan(values), window=window).reading.ranges_m
    around = [
        np.sort([values[(i + k) % len(values)] for k in range(-half, half + 1)])[half]
        for i in range(len(values))
    ]
    assert np.array_equal(made, np.array(around, np.float32))


def test_the_median_of_images_and_of_a_rangefinder_over_time() -> None:
    image = plain()
    image[10, 10] = 255
    assert (apply("median", camera(image)).reading.image_bgr == plain()).all()
    values = np.full((HEIGHT, WIDTH), 3.0)
    values[5, 5] = 90.0
    assert (apply("median", depth(values)).reading.depth_m == 3.0).all()
    median = build("median", window=3)
    heard = [
        median(Masked(beam(r, t_s=float(i))), None).reading.range_m
        for i, r in enumerate([4.0, 9.0, 4.1, 4.2, 0.1])
    ]
    assert heard == [4.0, 9.0, 4.1, 4.2, 4.1]
    with pytest.raises(ValueError, match="odd"):
        build("median", window=4)


@given(st.floats(0, 0.8), st.floats(0, 0.8), st.floats(0.05, 0.2))
def test_a_region_keeps_the_pixels_whose_centres_it_holds(
    left: float, top: float, s: float
) -> None:
    box = {"left": left, "top": top, "right": left + s, "bottom": top + s}
    work = apply("isolate_region", camera(), box=box)
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    x, y = (u + 0.5) / WIDTH, (v + 0.5) / HEIGHT
    inside = (x >= left) & (x < left + s) & (y > top) & (y <= top + s)
    assert ((work.mask == 255) ^ inside).sum() <= 2
    other = apply("isolate_region", camera(), box=box, outside=True)
    assert np.array_equal(other.mask == 255, work.mask == 0)


def test_a_region_may_be_a_polygon_of_any_shape() -> None:
    arrow = [[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [1.0, 1.0], [0.0, 1.0]]
    mask = apply("isolate_region", depth(1.0), polygon=arrow).mask
    assert mask[HEIGHT // 2, 2]
    assert not mask[HEIGHT // 2, WIDTH - 4]
    assert mask[2, WIDTH // 2]
    with pytest.raises(ValueError, match="box or a polygon"):
        build("isolate_region")


def test_isolation_by_depth_needs_depth_and_keeps_a_range_of_it() -> None:
    values = np.linspace(0, 10, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    values[0, 0] = np.inf
    for reading in (camera(depth_m=values), depth(values)):
        mask = apply("isolate_depth", reading, min_m=2.0, max_m=4.0).mask
        assert np.array_equal(mask == 255, (values >= 2) & (values <= 4))
    with pytest.raises(CannotMixError) as caught:
        apply("isolate_depth", camera(), max_m=1.0)
    assert caught.value.reason == "no_depth"


@given(st.integers(-180, 180), st.integers(0, 359))
def test_a_sector_is_counted_clockwise_from_its_first_ray(start: int, width: int) -> None:
    angles = np.degrees(scan(np.ones(360)).angles_rad)
    keep = kept(
        apply(
            "isolate_sector", scan(np.ones(360)), from_deg=float(start), to_deg=float(start + width)
        )
    )
    past = np.round(np.mod(angles - start, 360), 6) % 360
    assert np.array_equal(keep, past <= width)


def test_sector_and_box_of_points() -> None:
    points = cloud([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 5]])
    ahead = apply("isolate_sector", points, from_deg=-45.0, to_deg=45.0).mask
    assert ahead.tolist() == [255, 0, 0, 0]
    boxed = apply("isolate_box", points, right_m=[-2.0, 0.0], down_m=[0.0, 9.0]).mask
    assert boxed.tolist() == [255, 0, 255, 255]
    assert apply("isolate_box", points, forward_m=[0.5, 2.0], outside=True).mask.tolist() == [
        0,
        255,
        255,
        255,
    ]


def test_decimation_keeps_each_nth() -> None:
    assert apply("decimate", scan(np.ones(7)), every=3, offset=1).mask.tolist() == [
        0,
        255,
        0,
        0,
        255,
        0,
        0,
    ]
    with pytest.raises(ValueError, match="below every"):
        build("decimate", every=2, offset=2)


@pytest.mark.parametrize("method", ["mog2", "knn"])
def test_a_moving_object_stands_out_from_a_learned_background(method: Any) -> None:
    rng = np.random.default_rng(3)
    empty = rng.integers(60, 90, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    step = build("subtract_background", method=method, learn=20)
    for _ in range(30):
        noisy = np.clip(empty + rng.normal(0, 1, empty.shape), 0, 255).astype(np.uint8)
        work = step(Masked(camera(noisy)), None)
    assert (work.mask != 0).mean() < 0.01
    visited = empty.copy()
    visited[20:40, 10:30] = (20, 200, 250)
    mask = step(Masked(camera(visited)), None).mask
    assert (mask[22:38, 12:28] == 255).all()
    assert (mask[:15] == 0).mean() > 0.99


@pytest.mark.parametrize("method", ["mog2", "knn"])
def test_nothing_is_kept_while_the_background_is_learned(method: Any) -> None:
    step = build("subtract_background", method=method, learn=5)
    for image in (plain(), plain(width=100, height=80)):
        masks = [step(Masked(camera(image)), None).mask.any() for _ in range(5)]
        assert masks == [False] * 5


def test_the_background_may_be_a_picture(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "empty.png"), plain())
    step = build(
        "subtract_background",
        StepContext(folder=tmp_path),
        method="picture",
        picture="empty.png",
        remove_specks_px=0,
    )
    image = plain()
    image[3:6, 4:8] = (0, 255, 0)
    mask = step(Masked(camera(image)), None).mask
    assert np.array_equal(mask == 255, (image != plain()).any(axis=2))
    with pytest.raises(CannotMixError, match="32 x 24"):
        step(Masked(camera(plain(width=32, height=24))), None)


def test_a_background_that_cannot_be_read_is_reported(tmp_path: Path) -> None:
    (tmp_path / "bad.png").write_bytes(b"no picture")
    kind = build.__globals__["find_step"]("subtract_background")
    for name, said in (("bad.png", "not an image that can be read"), ("none.png", "no file")):
        (fault,) = kind.parameters(method="picture", picture=name).faults(tmp_path)
        assert said in fault.message
    with pytest.raises(ValueError, match="needs the key 'picture'"):
        kind.parameters(method="mog2", picture="x.png")
    for key in ("history", "learn"):
        with pytest.raises(ValueError, match="has no effect with method: picture"):
            kind.parameters(method="picture", picture="x.png", **{key: 9})
