"""Holes in what a depth camera measured: small ones close, wide openings do not."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.recipes.samples import HEIGHT, WIDTH, apply, camera, depth, plain
from wil_campaign.recipes.working import CannotMixError


def filled(depth_m: Any, holes_px: int = 5) -> Any:
    return apply("fill_depth", depth(depth_m), holes_px=holes_px).reading.depth_m


def test_a_small_hole_takes_the_distance_around_it() -> None:
    depth_m = np.full((HEIGHT, WIDTH), 2.0, np.float32)
    depth_m[20:25, 30:35] = np.inf
    assert np.array_equal(filled(depth_m), np.full((HEIGHT, WIDTH), 2.0, np.float32))


def test_a_wide_opening_stays_open_to_its_edge() -> None:
    """Sky beside a wall is no hole: a virtual thing there must be seen right up to the wall."""
    depth_m = np.full((HEIGHT, WIDTH), 2.0, np.float32)
    depth_m[:, 32:] = np.inf
    assert np.array_equal(filled(depth_m), depth_m)


@given(
    hnp.arrays(
        np.float32,
        (HEIGHT, WIDTH),
        elements=st.one_of(st.just(float("inf")), st.floats(0.0, 50.0, width=32)),
        fill=st.just(np.float32(np.inf)),
    )
)
def test_known_depth_stays_and_filled_depth_is_no_nearer_than_it(
    depth_m: Any,
) -> None:
    made = filled(depth_m)
    known = np.isfinite(depth_m)
    assert np.array_equal(made[known], depth_m[known])
    assert not np.isnan(made).any()
    new = made[~known & np.isfinite(made)]
    assert len(new) == 0 or new.min() >= depth_m[known].min() * 0.999 - 1e-6


def test_a_picture_without_depth_is_left_out() -> None:
    with pytest.raises(CannotMixError) as caught:
        apply("fill_depth", camera(plain()))
    assert caught.value.reason == "no_depth"


def test_nothing_virtual_shines_through_a_filled_hole() -> None:
    seen = np.full((HEIGHT, WIDTH), 2.0, np.float32)
    seen[20:24, 30:34] = np.inf
    real = camera(plain((9, 9, 9)), "real", depth_m=seen)
    assert real.depth_m is not None
    assert np.isinf(real.depth_m).any()
    assert np.isfinite(apply("fill_depth", real, on="real").reading.depth_m).all()
