"""Colours and patches are found where they are, per pixel, and cut-off gates are known as such."""

import colorsys

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.vehicles.perception.blobs import Blob, BlobFinder
from wil_campaign.vehicles.perception.hsv import NAMED_COLORS, HsvMask, HsvRange
from wil_campaign.vehicles.readings import BgrImage

ORANGE_BGR = (0, 120, 255)
WIDTH, HEIGHT = 320, 240
NEAR_LIMIT = 1e-3

colours = st.tuples(*[st.integers(0, 255)] * 3)
fractions = st.tuples(st.integers(0, 255), st.integers(0, 255)).map(
    lambda pair: (min(pair) / 255, max(pair) / 255)
)
hues = st.tuples(st.integers(0, 360), st.integers(0, 360)).map(
    lambda pair: (float(pair[0]), float(pair[1]))
)


def inside(bgr: tuple[int, int, int], wanted: HsvRange) -> bool | None:
    """Return by the standard library whether a colour is in; None close to a limit."""
    blue, green, red = (channel / 255 for channel in bgr)
    hue, saturation, value = colorsys.rgb_to_hsv(red, green, blue)
    hue_deg = hue * 360
    (low, high) = wanted.hue_deg
    limits = [
        (saturation, wanted.saturation),
        (value, wanted.value),
        (hue_deg / 360, (low / 360, high / 360)),
    ]
    if any(abs(x - limit) < NEAR_LIMIT for x, pair in limits for limit in pair):
        return None
    turned = low <= hue_deg <= high if low <= high else hue_deg >= low or hue_deg <= high
    has_hue = (saturation > 0 and turned) or wanted.hue_deg == (0.0, 360.0)
    return (
        has_hue
        and wanted.saturation[0] <= saturation <= wanted.saturation[1]
        and wanted.value[0] <= value <= wanted.value[1]
    )


@settings(deadline=None)
@given(st.lists(colours, min_size=1, max_size=40), hues, fractions, fractions)
def test_the_mask_is_what_the_standard_library_says_of_each_pixel(
    pixels: list[tuple[int, int, int]],
    hue_deg: tuple[float, float],
    saturation: tuple[float, float],
    value: tuple[float, float],
) -> None:
    wanted = HsvRange(hue_deg, saturation, value)
    mask = HsvMask((wanted,)).of(np.array([pixels], np.uint8))
    for pixel, kept in zip(pixels, mask[0], strict=True):
        expected = inside(pixel, wanted)
        assert expected is None or (kept == 255) == expected, pixel


@pytest.mark.parametrize("hue_deg", [(330.0, 360.0), (360.0, 10.0), (360.0, 360.0)])
def test_red_is_at_both_ends_of_the_circle(hue_deg: tuple[float, float]) -> None:
    red_and_grey = np.array([[(0, 0, 255), (40, 40, 90), (90, 90, 90)]], np.uint8)
    assert HsvMask((HsvRange(hue_deg),)).of(red_and_grey).tolist() == [[255, 255, 0]]


def test_every_colour_of_the_full_circle_is_in_and_grey_has_no_hue() -> None:
    image = np.random.default_rng(1).integers(0, 256, (20, 20, 3), dtype=np.uint8)
    assert (HsvMask((HsvRange(),)).of(image) == 255).all()
    grey = np.full((2, 2, 3), 90, np.uint8)
    assert not HsvMask((HsvRange((0.0, 359.9)),)).of(grey).any()


@pytest.mark.parametrize(
    ("name", "bgr"),
    [
        ("orange", (0, 120, 255)),
        ("orange", (0, 60, 127)),
        ("red", (35, 30, 210)),
        ("yellow", (30, 215, 245)),
        ("green", (60, 150, 40)),
        ("cyan", (200, 190, 40)),
        ("blue", (200, 80, 35)),
        ("purple", (160, 50, 120)),
        ("magenta", (160, 45, 210)),
        ("white", (240, 240, 240)),
        ("grey", (128, 128, 128)),
        ("black", (22, 20, 20)),
    ],
)
def test_a_named_colour_is_itself_and_no_other(name: str, bgr: tuple[int, int, int]) -> None:
    pixel = np.array([[bgr]], np.uint8)
    found = {one for one, ranges in NAMED_COLORS.items() if HsvMask(ranges).of(pixel).any()}
    assert found - {"gray", "grey"} == {name} - {"grey"}


def test_a_mask_follows_the_size_of_the_picture() -> None:
    finder = HsvMask(NAMED_COLORS["orange"])
    for shape in ((4, 6), (8, 3), (4, 6)):
        image = np.full((*shape, 3), ORANGE_BGR, np.uint8)
        assert finder.of(image).shape == shape
        assert finder.of(image).all()


@pytest.mark.parametrize(
    "wrong", [{"hue_deg": (-1.0, 5.0)}, {"saturation": (0.6, 0.5)}, {"value": (0.0, 1.5)}]
)
def test_impossible_ranges_are_refused(wrong: dict[str, tuple[float, float]]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        HsvRange(**wrong)


def room() -> BgrImage:
    return np.full((HEIGHT, WIDTH, 3), (120, 110, 100), np.uint8)


def frame(image: BgrImage, centre: tuple[int, int], inner: int, bar: int) -> None:
    """Draw a square frame; `inner` is half of the opening."""
    outer = inner + bar
    u, v = centre
    hole = np.zeros(image.shape[:2], np.uint8)
    cv2.rectangle(hole, (u - outer, v - outer), (u + outer, v + outer), 255, cv2.FILLED)
    cv2.rectangle(hole, (u - inner, v - inner), (u + inner, v + inner), 0, cv2.FILLED)
    image[hole > 0] = ORANGE_BGR


def find(image: BgrImage, decimate: int = 1) -> Blob | None:
    return BlobFinder(NAMED_COLORS["orange"], decimate=decimate).find(image)


def test_a_patch_is_measured() -> None:
    image = room()
    image[100:120, 50:90] = ORANGE_BGR
    blob = find(image)
    assert blob is not None
    assert blob.area_px == 800
    assert blob.centroid_px == pytest.approx((69.5, 109.5))
    assert (blob.box.left_px, blob.box.top_px) == (50, 100)
    assert (blob.box.width_px, blob.box.height_px) == (40, 20)
    assert blob.box.centre_px == (69.5, 109.5)
    assert not blob.borders.any
    assert blob.opening is None


def test_nothing_and_specks_are_not_seen() -> None:
    image = room()
    assert find(image) is None
    image[5, 5] = image[50, 60] = ORANGE_BGR
    assert find(image) is None


def test_specks_do_not_move_the_patch() -> None:
    image = room()
    image[100:120, 50:90] = ORANGE_BGR
    image[5, 5] = ORANGE_BGR
    blob = find(image)
    assert blob is not None
    assert blob.centroid_px == pytest.approx((69.5, 109.5))
    assert blob.box.left_px == 50


@pytest.mark.parametrize("decimate", [1, 2])
def test_the_opening_of_a_gate(decimate: int) -> None:
    image = room()
    frame(image, (150, 130), inner=40, bar=8)
    blob = find(image, decimate)
    assert blob is not None
    opening = blob.opening
    assert opening is not None
    assert opening.across_px is not None
    assert opening.down_px is not None
    assert opening.centre_px == pytest.approx((150, 130), abs=decimate - 0.9)
    assert opening.across_px == pytest.approx((109.5, 190.5), abs=decimate - 0.9)
    assert opening.down_px == pytest.approx((89.5, 170.5), abs=decimate - 0.9)
    assert blob.area_px == pytest.approx(97 * 97 - 81 * 81, rel=0.05 * decimate)


def test_bars_of_a_gate_that_leaves_above_and_below_still_tell_across() -> None:
    image = room()
    frame(image, (150, 120), inner=125, bar=15)
    blob = find(image)
    assert blob is not None
    assert blob.borders.top
    assert blob.borders.bottom
    assert not blob.borders.left
    assert blob.opening is not None
    assert blob.opening.down_px is None
    assert blob.opening.across_px == pytest.approx((24.5, 275.5))


def test_a_gate_cut_off_at_one_side_tells_the_other_axis_only() -> None:
    image = room()
    frame(image, (10, 120), inner=50, bar=10)
    blob = find(image)
    assert blob is not None
    assert blob.borders.left
    assert not blob.borders.right
    assert blob.opening is not None
    assert blob.opening.across_px is None
    assert blob.opening.down_px == pytest.approx((69.5, 170.5))


def test_one_bar_encloses_nothing() -> None:
    image = room()
    image[:, 100:120] = ORANGE_BGR
    blob = find(image)
    assert blob is not None
    assert blob.borders.top
    assert blob.borders.bottom
    assert blob.opening is None


def test_a_picture_full_of_orange() -> None:
    image = np.full((HEIGHT, WIDTH, 3), ORANGE_BGR, np.uint8)
    blob = find(image)
    assert blob is not None
    assert blob.borders.left
    assert blob.borders.right
    assert blob.opening is None


@settings(deadline=None, max_examples=60)
@given(st.integers(-200, 500), st.integers(-200, 400), st.integers(4, 300), st.integers(3, 60))
def test_an_opening_is_measured_right_wherever_the_gate_is(
    u: int, v: int, inner: int, bar: int
) -> None:
    image = room()
    frame(image, (u, v), inner, bar)
    blob = find(image)
    if blob is None or blob.opening is None:
        return
    if blob.opening.across_px is not None:
        assert blob.opening.across_px == (u - inner - 0.5, u + inner + 0.5)
    if blob.opening.down_px is not None:
        assert blob.opening.down_px == (v - inner - 0.5, v + inner + 0.5)
