"""A virtual object looks as the other camera would show it: it does not shine."""

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.recipes.samples import build, camera
from wil_campaign.plugins.steps.operations.photometry import (
    PhotometricCorrection,
    PhotometricCorrector,
    measure_photometry,
)
from wil_campaign.recipes.working import CannotMixError, Masked
from wil_campaign.worlds.camera import Intrinsics

WIDTH, HEIGHT = 320, 240
LENS = Intrinsics.from_fov(WIDTH, HEIGHT, 1.2)


def hall(seed: int = 1) -> Any:
    """A wall with posters, as a perfect camera shows it: sharp, without noise."""
    rng = np.random.default_rng(seed)
    image = np.full((HEIGHT, WIDTH, 3), (120, 125, 130), np.uint8)
    for _ in range(40):
        x, y = (int(v) for v in rng.integers(0, (WIDTH - 40, HEIGHT - 40)))
        w, h = (int(v) for v in rng.integers(15, 40, 2))
        color = [int(v) for v in rng.integers(40, 210, 3)]
        cv2.rectangle(image, (x, y), (x + w, y + h), color, -1)
    return image


def taken(image: Any, gains: Any = (1, 1, 1), noise: float = 0.0, blur: float = 0.0) -> Any:
    seen = image.astype(np.float64)
    if blur:
        seen = cv2.GaussianBlur(seen, (0, 0), blur)
    seen = seen * np.array(gains)
    seen = seen + np.random.default_rng(9).normal(0, noise, seen.shape) if noise else seen
    return np.clip(np.rint(seen), 0, 255).astype(np.uint8)


def reading(image: Any, source: Any = "twin", seq: int = 0) -> Any:
    return camera(image, source, intrinsics=LENS, seq=seq)


@pytest.mark.parametrize("noise", [2.0, 5.0, 10.0])
def test_noise_is_measured(noise: float) -> None:
    found = measure_photometry(taken(hall(), noise=noise)).noise_std_dn
    assert found == pytest.approx(noise, rel=0.1)
    assert measure_photometry(hall()).noise_std_dn == pytest.approx(0.0, abs=0.3)


@pytest.mark.parametrize("blur", [0.8, 1.5, 2.5])
def test_blur_is_measured(blur: float) -> None:
    assert measure_photometry(taken(hall(), blur=blur)).blur_sigma_px == pytest.approx(
        blur, rel=0.2
    )
    assert (measure_photometry(hall()).blur_sigma_px or 0.0) < 0.4


@settings(max_examples=10, deadline=None)
@given(
    st.tuples(st.floats(0.6, 1.15), st.floats(0.6, 1.15), st.floats(0.6, 1.15)),
    st.floats(0, 6),
    st.sampled_from([0.0, 1.0, 2.0]),
)
def test_a_twin_takes_over_the_look_of_the_real_camera(gains: Any, noise: float, blur: Any) -> None:
    real = taken(hall(), gains, noise, blur)
    matched = build("match_photometry")(Masked(reading(hall())), Masked(reading(real, "real")))
    made, wanted = measure_photometry(matched.reading.image_bgr), measure_photometry(real)
    assert made.level_bgr == pytest.approx(wanted.level_bgr, abs=3.5)
    assert made.noise_std_dn == pytest.approx(wanted.noise_std_dn, abs=0.15 * noise + 0.4)
    smooth_made, smooth_real = (
        cv2.GaussianBlur(image, (0, 0), 3.0).astype(float)
        for image in (matched.reading.image_bgr, real)
    )
    assert np.abs(smooth_made - smooth_real).mean() < 3.0


def test_each_property_can_be_left_out() -> None:
    real = Masked(reading(taken(hall(), (0.6, 0.8, 0.9), 5.0, 1.5), "real"))
    only: dict[str, Any] = {
        "exposure": False,
        "white_balance": False,
        "noise": False,
        "blur": False,
    }
    twin = Masked(reading(hall()))
    assert build("match_photometry", **only)(twin, real) is twin
    dim = build("match_photometry", **{**only, "exposure": True})(twin, real).reading.image_bgr
    ratio = dim.reshape(-1, 3).mean(axis=0) / hall().reshape(-1, 3).mean(axis=0)
    assert np.ptp(ratio) < 0.01
    assert ratio.mean() == pytest.approx((0.6 * 0.8 * 0.9) ** (1 / 3), abs=0.04)
    cast = build("match_photometry", **{**only, "white_balance": True})(twin, real)
    ratio = cast.reading.image_bgr.reshape(-1, 3).mean(axis=0) / hall().reshape(-1, 3).mean(axis=0)
    assert ratio.prod() == pytest.approx(1.0, abs=0.06)
    assert np.ptp(ratio) > 0.2


def test_stated_gains_of_a_camera_are_not_measured() -> None:
    step = build("match_photometry", gains_bgr=[0.5, 0.5, 0.5], noise=False, blur=False)
    made = step(Masked(reading(hall())), Masked(reading(hall(), "real"))).reading.image_bgr
    assert np.abs(made - hall() / 2.0).max() <= 1.0


def test_blur_of_an_isolated_object_takes_in_nothing_of_its_background() -> None:
    image = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    image[80:160, 100:200] = (0, 0, 200)
    mask = np.where((image == (0, 0, 200)).all(axis=2), 255, 0).astype(np.uint8)
    what = PhotometricCorrection(blur_sigma_px=3.0)
    made = PhotometricCorrector(0).applied(image, mask, what, 0)
    assert (made[mask == 255] == (0, 0, 200)).all()
    assert (made[mask == 0] == 255).all()
    spread = PhotometricCorrector(0).applied(image, None, what, 0)
    assert (spread[mask == 255] != (0, 0, 200)).any()


def test_noise_repeats_and_differs_from_frame_to_frame() -> None:
    what = PhotometricCorrection(noise_std_dn=4.0)
    image = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    first, again = (PhotometricCorrector(3).applied(image, None, what, 5) for _ in range(2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, PhotometricCorrector(3).applied(image, None, what, 6))
    assert first.astype(float).std() == pytest.approx(4.0, rel=0.03)
    assert first.astype(float).mean() == pytest.approx(100.0, abs=0.1)


def test_a_correction_does_not_flicker() -> None:
    step = build("match_photometry", measure_every=1, smoothing=0.9, noise=False, blur=False)
    step(Masked(reading(hall())), Masked(reading(hall(), "real")))
    dark = Masked(reading(taken(hall(), (0.5, 0.5, 0.5)), "real"))
    levels = [step(Masked(reading(hall())), dark).reading.image_bgr.mean() for _ in range(4)]
    assert levels == sorted(levels, reverse=True)
    assert levels[0] > 0.93 * hall().mean()


def test_nothing_is_matched_without_the_other_side() -> None:
    with pytest.raises(CannotMixError):
        build("match_photometry")(Masked(reading(hall())), None)
    with pytest.raises(ValueError, match="on"):
        build("match_photometry", on="both")
    with pytest.raises(ValueError, match="has no effect with noise: false"):
        build("match_photometry", noise=False, noise_std_dn=3.0)


@pytest.mark.parametrize("given_as", ["rgb", "hsv", "lab", "ycrcb"])
def test_color_spaces_become_bgr(given_as: str) -> None:
    code = {
        "rgb": cv2.COLOR_BGR2RGB,
        "hsv": cv2.COLOR_BGR2HSV,
        "lab": cv2.COLOR_BGR2LAB,
        "ycrcb": cv2.COLOR_BGR2YCrCb,
    }[given_as]
    made = build("color_space", given=given_as)(Masked(reading(cv2.cvtColor(hall(), code))), None)
    assert np.abs(made.reading.image_bgr.astype(int) - hall()).max() <= 8


def test_grey_has_no_colour() -> None:
    made = build("color_space", shown="gray")(Masked(reading(hall())), None).reading.image_bgr
    assert (np.ptp(made, axis=2) == 0).all()
