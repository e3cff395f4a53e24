"""Two virtual objects of one shape, each shown as the other one."""

import numpy as np
import pytest
from numpy.typing import NDArray

from wil_campaign.recipes.visibility.images import ImagePair, compare_images
from wil_campaign.recipes.visibility.model import (
    ExpectedImage,
    FrameVisibility,
    Mask,
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


def compare(mixed: BgrImage, *, real: BgrImage = ROOM, is_like: bool = True) -> FrameVisibility:
    """Return what a mixture shows of a red person to the left and a blue one to the right."""
    ids: NDArray[np.uint8] = np.where(LEFT, ANNA, np.where(RIGHT, BERT, 1)).astype(np.uint8)
    return compare_images(
        ImagePair(
            t_s=1.0,
            real_bgr=real,
            mixed_bgr=mixed,
            expected=ExpectedImage(ids, painted(RED, BLUE), None, STEP),
            virtual=VIRTUAL,
            limit_px=None,
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
