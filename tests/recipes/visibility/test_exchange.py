"""Two virtual objects of one shape, each shown as the other one."""

import numpy as np
import pytest
from numpy.typing import NDArray

from wil_campaign.recipes.visibility.exchange import ColoredImages, with_exchanged
from wil_campaign.recipes.visibility.images import ImagePair, compare_images
from wil_campaign.recipes.visibility.model import (
    ExpectedImage,
    FrameVisibility,
    Mask,
    ObjectVisibility,
    VirtualObjects,
)
from wil_campaign.vehicles.readings import BgrImage

WIDTH, HEIGHT, STEP = 160, 120, 4
RED, BLUE = (30, 30, 190), (190, 40, 30)
ANNA, BERT = 2, 3
ROOM = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
VIRTUAL = VirtualObjects({ANNA: "anna", BERT: "bert"})


def column(x: int, half: int = 8) -> Mask:
    """Return where a person stands, in samples."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.asarray((abs(columns - x) <= half) & (abs(rows - 60) <= 30))


LEFT, RIGHT = column(40), column(120)


def painted(left: tuple[int, ...], right: tuple[int, ...], on: BgrImage = ROOM) -> BgrImage:
    """Return an image with both persons."""
    image = on.copy()
    image[LEFT], image[RIGHT] = left, right
    return image


def compare(
    mixed: BgrImage,
    *,
    real: BgrImage = ROOM,
    is_like: bool = True,
    colors: tuple[tuple[int, ...], tuple[int, ...]] = (RED, BLUE),
    limit_px: float | None = None,
) -> FrameVisibility:
    """Return what a mixture shows of a red person to the left and a blue one to the right."""
    ids: NDArray[np.uint8] = np.where(LEFT, ANNA, np.where(RIGHT, BERT, 1)).astype(np.uint8)
    return compare_images(
        ImagePair(
            t_s=1.0,
            real_bgr=real,
            mixed_bgr=mixed,
            expected=ExpectedImage(ids, painted(*colors), None, STEP),
            virtual=VIRTUAL,
            limit_px=limit_px,
            is_like=is_like,
        )
    )


def blended(image: BgrImage, real: BgrImage, share: float) -> BgrImage:
    """Return an image that is laid over the persons' places by a share."""
    mixed = real.astype(float) + share * (image.astype(float) - real)
    return np.where((LEFT | RIGHT)[:, :, None], mixed.round().astype(np.uint8), real)


@pytest.mark.parametrize("share", [1.0, 0.5, 0.3])
def test_exchanged_objects_are_displaced(share: float) -> None:
    """Each outline is where it is expected: a verdict rested on the other person's distance."""
    frame = compare(blended(painted(BLUE, RED), ROOM, share))
    anna, bert = frame.objects
    assert (anna.place_of, bert.place_of) == ("bert", "anna")
    assert anna.is_displaced
    assert bert.is_displaced
    assert anna.offset == bert.offset == 80 * STEP


def contrasting() -> BgrImage:
    """Return a real image that is blue behind the red person and red behind the blue one."""
    return painted((250, 20, 10), (10, 20, 250))


@pytest.mark.parametrize("real", [ROOM, contrasting()])
@pytest.mark.parametrize("share", [1.0, 0.5, 0.3])
def test_a_blend_exchanges_none(real: BgrImage, share: float) -> None:
    """What shines through is no other person."""
    frame = compare(blended(painted(RED, BLUE), real, share), real=real)
    assert all(one.is_shown and not one.is_displaced for one in frame.objects)
    assert not any(one.place_of for one in frame.objects)


@pytest.mark.parametrize("gain", [0.4, 1.3])
def test_other_light_exchanges_none(gain: float) -> None:
    lit = np.clip(painted(RED, BLUE) * gain, 0, 255).astype(np.uint8)
    frame = compare(np.where((LEFT | RIGHT)[:, :, None], lit, ROOM))
    assert all(one.is_shown and not one.is_displaced for one in frame.objects)


def test_dim_persons_before_colored_walls_are_not_exchanged() -> None:
    """The colours of the other one fit better; but the redder one is the redder one."""
    anna, bert = (233, 191, 187), (176, 133, 249)
    walls = painted((162, 116, 24), (37, 1, 175))
    dim = (painted(anna, bert, on=walls) * 0.7).astype(np.uint8)
    mixed = np.where((LEFT | RIGHT)[:, :, None], dim, walls)
    frame = compare(mixed, real=walls, colors=(anna, bert))
    assert all(one.is_shown and not one.place_of for one in frame.objects)


def test_persons_of_nearly_one_colour_are_not_exchanged() -> None:
    grey, other = (60, 60, 60), (66, 66, 66)
    frame = compare(painted(other, grey), colors=(grey, other))
    assert not any(one.place_of for one in frame.objects)


def test_an_exchange_within_the_limit_displaces_none() -> None:
    frame = compare(painted(BLUE, RED), limit_px=400.0)
    assert not any(one.place_of for one in frame.objects)


@pytest.mark.parametrize(("half", "is_seen"), [(1, False), (2, True)])
def test_an_object_of_a_few_samples_tells_no_colours(half: int, *, is_seen: bool) -> None:
    """Of 9 samples the mean is that of the edges; 25 suffice."""
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    for number, x in ((ANNA, 40), (BERT, 120)):
        ids[60 - half : 61 + half, x - half : x + half + 1] = number
    expected, mixed = ROOM.copy(), ROOM.copy()
    expected[ids == ANNA], expected[ids == BERT] = RED, BLUE
    mixed[ids == ANNA], mixed[ids == BERT] = BLUE, RED
    shown = [
        ObjectVisibility(name, True, 0.1, 1.0, True, 0.0, 9.6, "px") for name in ("anna", "bert")
    ]
    images = ColoredImages(
        real_bgr=ROOM,
        mixed_bgr=mixed,
        expected_bgr=expected,
        ids=ids,
        changed=ids > 0,
        px_per_sample=STEP,
    )
    found = with_exchanged(shown, {ANNA: "anna", BERT: "bert"}, images)
    assert [bool(one.place_of) for one in found] == [is_seen, is_seen]


def test_grey_persons_are_not_exchanged() -> None:
    frame = compare(painted((70, 70, 70), (60, 60, 60)))
    assert not any(one.is_displaced for one in frame.objects)


def test_other_colours_of_a_simulator_are_no_exchange() -> None:
    frame = compare(painted(BLUE, RED), is_like=False)
    assert not any(one.is_displaced for one in frame.objects)


def test_exchanged_objects_in_a_whole_image_of_the_twin_are_displaced() -> None:
    """The recipe changes every pixel."""
    anna, bert = compare(painted(BLUE, RED, on=ROOM + np.uint8(1))).objects
    assert (anna.place_of, bert.place_of) == ("bert", "anna")
    assert anna.is_displaced
    assert bert.is_displaced


def test_objects_with_their_own_colours_are_in_their_places() -> None:
    frame = compare(painted(RED, BLUE))
    assert [(one.offset, one.place_of) for one in frame.objects] == [(0.0, ""), (0.0, "")]
