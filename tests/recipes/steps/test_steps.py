"""Each step by itself: geometry is exact, masks are per pixel."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.recipes.model.registry import StepContext, StepParameters, find_step
from wil_campaign.recipes.operations.optics import (
    camera_disagreement_px,
    resized_image,
    scaled_intrinsics,
)
from wil_campaign.recipes.working import CannotMixError, Masked, Operator
from wil_campaign.vehicles.readings import BgrImage, CameraReading, Source
from wil_campaign.worlds.camera import Intrinsics

CameraMerge = Callable[[Mapping[Source, Masked[CameraReading]]], CameraReading]
WIDTH, HEIGHT = 64, 48
CAMERA = Intrinsics.from_fov(WIDTH, HEIGHT, 1.2)
ORANGE_BGR = (0, 120, 255)


def picture(color: tuple[int, int, int] = (200, 60, 30)) -> BgrImage:
    return np.full((HEIGHT, WIDTH, 3), color, np.uint8)


def reading(image: BgrImage, source: Source = "twin", **more: Any) -> CameraReading:
    height, width = image.shape[:2]
    camera = (
        CAMERA if (width, height) == (WIDTH, HEIGHT) else scaled_intrinsics(CAMERA, width, height)
    )
    return replace(CameraReading(1.0, 1.0, 3, source, image, camera), **more)


def build(name: str, /, context: StepContext | None = None, **parameters: Any) -> Any:
    kind = find_step(name)
    assert kind is not None
    return kind.build(kind.parameters(**parameters), context or StepContext())


def overlay(*priority: str) -> CameraMerge:
    merge: CameraMerge = build("overlay", priority=list(priority))
    return merge


def kept(operator: Operator, image: BgrImage, **more: Any) -> Any:
    mask = operator(Masked(reading(image, **more)), None).mask
    assert mask is not None
    assert mask.shape == image.shape[:2]
    assert set(np.unique(mask)) <= {0, 255}
    return mask == 255


def test_an_orange_gate_is_kept_and_the_blue_behind_it_is_not() -> None:
    image = picture()
    image[10:20, 10:30] = ORANGE_BGR
    assert np.array_equal(
        kept(build("isolate_color", name="orange"), image), (image == ORANGE_BGR).all(axis=2)
    )


def test_red_wraps_around_the_circle_of_hues() -> None:
    image = picture((128, 128, 128))
    image[0, 0], image[0, 1], image[0, 2] = (0, 10, 200), (20, 0, 200), (200, 0, 0)
    mask = kept(build("isolate_color", name="red"), image)
    assert mask.sum() == 2
    assert mask[0, 0]
    assert mask[0, 1]


def test_own_ranges_add_to_a_named_colour() -> None:
    image = picture((128, 128, 128))
    image[0, 0], image[0, 1] = ORANGE_BGR, (255, 0, 0)
    mine = [{"hue_deg": [235.0, 245.0], "saturation": [0.5, 1.0]}]
    mask = kept(build("isolate_color", name="orange", ranges=mine), image)
    assert mask.sum() == 2


def test_clean_up_removes_specks_fills_holes_and_takes_in_the_edge() -> None:
    image = picture()
    image[10:30, 10:30] = ORANGE_BGR
    image[40, 50] = ORANGE_BGR
    image[20, 20] = (255, 0, 0)
    plain = kept(build("isolate_color", name="orange"), image)
    assert plain[40, 50]
    assert not plain[20, 20]
    cleaned = kept(
        build("isolate_color", name="orange", remove_specks_px=1, fill_holes_px=1), image
    )
    assert not cleaned[40, 50]
    assert cleaned[20, 20]
    shrunk = kept(build("isolate_color", name="orange", shrink_px=1), image)
    assert not shrunk[10, 15]
    assert shrunk[12, 12]


def test_a_black_object_is_kept_by_its_id_and_shown() -> None:
    image = picture()
    image[5:9, 5:9] = 0
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    ids[5:9, 5:9] = 7
    choose = build("isolate_objects", StepContext({"wall": 3, "gate": 7}), names=["gate"])
    twin = choose(Masked(reading(image, object_ids=ids)), None)
    real = picture((10, 200, 200))
    mixed = overlay("twin", "real")({"twin": twin, "real": Masked(reading(real, "real"))})
    assert (mixed.image_bgr[5:9, 5:9] == 0).all()
    assert (mixed.image_bgr[9:] == (10, 200, 200)).all()


def test_objects_need_ids_and_a_name_that_the_world_knows() -> None:
    choose = build("isolate_objects", StepContext({"gate": 7}), names=["gate"])
    with pytest.raises(CannotMixError) as caught:
        choose(Masked(reading(picture())), None)
    assert caught.value.reason == "no_ids"
    assert "`register`" in str(caught.value)
    with pytest.raises(ValueError, match="no object 'door'"):
        build("isolate_objects", StepContext({"gate": 7}), names=["door"])


def test_two_filters_keep_what_both_keep() -> None:
    image = picture()
    image[:10] = ORANGE_BGR
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    ids[5:20] = 7
    by_color = build("isolate_color", name="orange")
    by_id = build("isolate_objects", StepContext({"gate": 7}), names=["gate"])
    work = by_id(by_color(Masked(reading(image, object_ids=ids)), None), None)
    assert work.mask is not None
    assert np.array_equal(np.flatnonzero(work.mask.any(axis=1)), np.arange(5, 10))


@given(st.integers(1, 200), st.integers(1, 200), st.floats(-0.6, 0.6), st.floats(-0.4, 0.4))
def test_scaled_intrinsics_see_a_point_at_the_scaled_place(
    width: int, height: int, right: float, down: float
) -> None:
    u, v = CAMERA.project((1.0, right, down)) or (0.0, 0.0)
    seen = scaled_intrinsics(CAMERA, width, height).project((1.0, right, down))
    assert seen is not None
    assert seen[0] == pytest.approx((u + 0.5) * width / WIDTH - 0.5, abs=1e-9)
    assert seen[1] == pytest.approx((v + 0.5) * height / HEIGHT - 0.5, abs=1e-9)


@settings(deadline=None)
@given(st.sampled_from([0.5, 1.5, 2.0, 3.0]), st.integers(8, 40), st.integers(8, 30))
def test_the_picture_is_scaled_where_its_intrinsics_say(factor: float, left: int, top: int) -> None:
    """The centre of mass of a bright square moves as the pinhole's points do."""
    image = picture((0, 0, 0))
    image[top : top + 8, left : left + 8] = 255
    work = Masked(reading(image))
    scaled = resized_image(work, round(WIDTH * factor), round(HEIGHT * factor))
    assert scaled.reading.intrinsics.width_px == scaled.reading.image_bgr.shape[1]
    moments = cv2.moments(scaled.reading.image_bgr[:, :, 0])
    assert moments["m10"] / moments["m00"] == pytest.approx(
        (left + 3.5 + 0.5) * factor - 0.5, abs=0.05
    )
    assert moments["m01"] / moments["m00"] == pytest.approx(
        (top + 3.5 + 0.5) * factor - 0.5, abs=0.05
    )


def test_depth_ids_and_mask_take_the_nearest_pixel() -> None:
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    ids[:, 20:40] = 200
    depth = np.where(ids == 200, np.float32(2.5), np.float32(np.inf)).astype(np.float32)
    mask = np.where(ids == 200, 255, 0).astype(np.uint8)
    work = resized_image(Masked(reading(picture(), object_ids=ids, depth_m=depth), mask), 32, 24)
    assert work.reading.object_ids is not None
    assert work.reading.depth_m is not None
    assert work.mask is not None
    inside = work.reading.object_ids == 200
    assert set(np.unique(work.reading.object_ids)) == {0, 200}
    assert inside.sum() == 10 * 24
    assert np.array_equal(work.mask == 255, inside)
    assert np.array_equal(np.isinf(work.reading.depth_m), ~inside)


@pytest.mark.parametrize("aspect", ["crop", "pad", "fit"])
@pytest.mark.parametrize("size", [(96, 48), (48, 48), (31, 77), (64, 48)])
def test_a_point_keeps_its_ray_at_a_size_of_another_ratio(
    aspect: str, size: tuple[int, int]
) -> None:
    """The spot is where the new intrinsics see it, whatever is cut off or added."""
    wide, high = size
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[18:26, 28:38] = 255
    ids = np.where(image[:, :, 0] > 0, 7, 0).astype(np.uint8)
    depth_m = np.full((HEIGHT, WIDTH), 4.0, np.float32)
    work = Masked(reading(image, object_ids=ids, depth_m=depth_m))
    target = {"width_px": wide, "height_px": high}
    done = build("resize", to=target, aspect=aspect)(work, None)
    made = done.reading
    new, old = made.intrinsics, work.reading.intrinsics
    assert made.image_bgr.shape == (high, wide, 3)
    assert made.object_ids.shape == made.depth_m.shape == (high, wide)
    found, before = moments_px(made.image_bgr), moments_px(image)
    for at, was, name in ((0, 0, "x"), (1, 1, "y")):
        focal = {"x": (new.fx_px, old.fx_px), "y": (new.fy_px, old.fy_px)}[name]
        middle = {"x": (new.cx_px, old.cx_px), "y": (new.cy_px, old.cy_px)}[name]
        ray = (found[at] - middle[0]) / focal[0], (before[was] - middle[1]) / focal[1]
        assert ray[0] == pytest.approx(ray[1], abs=0.6 / focal[0])
    if aspect != "fit":
        assert new.fx_px / old.fx_px == pytest.approx(new.fy_px / old.fy_px, rel=0.03)
    if aspect == "pad" and wide * HEIGHT != high * WIDTH:
        assert (made.depth_m[done.mask == 0] == np.inf).all()
        assert done.mask[0, 0] == 0 != done.mask[high // 2, wide // 2]
    else:
        assert done.mask is None


def moments_px(image: Any) -> tuple[float, float]:
    found = cv2.moments(image[:, :, 0])
    return found["m10"] / found["m00"], found["m01"] / found["m00"]


def test_resize_takes_the_size_of_the_other_side_and_leaves_an_equal_one() -> None:
    resize = build("resize", to="real")
    same = Masked(reading(picture()))
    assert resize(same, Masked(reading(picture(), "real"))) is same
    larger = reading(np.zeros((96, 128, 3), np.uint8), "real")
    assert resize(same, Masked(larger)).reading.image_bgr.shape == (96, 128, 3)
    with pytest.raises(CannotMixError) as caught:
        resize(same, None)
    assert caught.value.reason == "no_real"


def test_the_last_of_the_priorities_is_the_ground() -> None:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[:5] = 255
    top = Masked(reading(picture((1, 1, 1)), "real"), mask)
    ground = Masked(reading(picture((2, 2, 2))), np.zeros_like(mask))
    mixed = overlay("real", "twin")({"real": top, "twin": ground})
    assert (mixed.image_bgr[:5] == 1).all()
    assert (mixed.image_bgr[5:] == 2).all()


def test_an_overlay_writes_to_neither_picture() -> None:
    twin, real = picture((9, 9, 9)), picture((5, 5, 5))
    for image in (twin, real):
        image.setflags(write=False)
    mixed = overlay("twin", "real")(
        {"twin": Masked(reading(twin)), "real": Masked(reading(real, "real"))}
    )
    assert (mixed.image_bgr == 9).all()


def test_images_that_do_not_fit_are_refused() -> None:
    real = Masked(reading(picture(), "real"))
    small = Masked(reading(np.zeros((24, 32, 3), np.uint8)))
    with pytest.raises(CannotMixError, match=r"32 x 24 .* over 64 x 48 .*resize"):
        overlay("twin", "real")({"twin": small, "real": real})
    wide = Masked(reading(picture(), intrinsics=Intrinsics.from_fov(WIDTH, HEIGHT, 1.4)))
    with pytest.raises(CannotMixError, match="field of view"):
        overlay("twin", "real")({"twin": wide, "real": real})


def test_disagreement_of_cameras_is_that_at_the_worst_corner() -> None:
    assert camera_disagreement_px(CAMERA, CAMERA) == 0.0
    shifted = replace(CAMERA, cx_px=CAMERA.cx_px + 3.0)
    assert camera_disagreement_px(CAMERA, shifted) == pytest.approx(3.0)
    longer = replace(CAMERA, fy_px=CAMERA.fy_px * 1.1)
    assert camera_disagreement_px(CAMERA, longer) == pytest.approx(0.1 * CAMERA.cy_px)
    both = replace(shifted, cy_px=CAMERA.cy_px - 4.0)
    assert camera_disagreement_px(CAMERA, both) == pytest.approx(5.0)
    assert camera_disagreement_px(CAMERA, replace(CAMERA, distortion=(0.1, 0, 0, 0))) == np.inf
    assert camera_disagreement_px(CAMERA, replace(CAMERA, distortion=(0, 0, 0, 0))) == 0.0


def test_parameters_of_a_step_are_frozen_and_know_their_sides() -> None:
    kind = find_step("isolate_color")
    assert kind is not None
    parameters: Any = kind.parameters
    assert parameters(name="red").sides() == ("twin",)
    assert parameters(name="red", on="both").sides() == ("real", "twin")
    assert StepParameters().sides() == ()
