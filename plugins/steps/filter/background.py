"""Filter by change: subtract a background that is learned, or given as an image."""

from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.foundation.files.images import ImageError, read_image
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.recipes.model.registry import ParameterFault, SidedParameters, StepContext, step
from wil_campaign.recipes.operations.masks import intersect_masks
from wil_campaign.recipes.working import AnyMasked, CannotMixError, Masked, Operator
from wil_campaign.vehicles.readings import BgrImage, CameraReading, Mask

Work = Masked[CameraReading]


class SubtractBackgroundParameters(SidedParameters):
    """method: `mog2` and `knn` learn the background; `picture` compares with an empty scene.

    picture: an image file beside the recipe. threshold: of the difference from the picture in grey
    levels; of the learning methods, their squared distance. history: frames that learning uses.
    learn: first frames, in which nothing is kept as the background is not known yet.
    remove_specks_px: radius of a morphological opening.
    """

    method: Literal["mog2", "knn", "picture"] = "mog2"
    picture: str | None = None
    threshold: Annotated[float, Field(gt=0, le=10_000)] | None = None
    history: Annotated[int, Field(ge=2, le=100_000)] = 200
    learn: Annotated[int, Field(ge=0, le=100_000)] = 5
    remove_specks_px: Annotated[int, Field(ge=0, le=50)] = 1

    @model_validator(mode="after")
    def _check_image_with_method(self) -> "SubtractBackgroundParameters":
        if (self.picture is None) == (self.method == "picture"):
            raise KeyFaultError(
                "method", "method 'picture' needs the key 'picture', and only that method takes it"
            )
        for key in ("history", "learn") if self.picture is not None else ():
            if key in self.model_fields_set:
                raise KeyFaultError(key, "has no effect with method: picture, which learns nothing")
        return self

    def faults(self, folder: FilePath) -> tuple[ParameterFault, ...]:
        """Return why the background image cannot be used."""
        if self.picture is None:
            return ()
        message = _unreadable_fault(folder / self.picture)
        return (ParameterFault(("picture",), message),) if message else ()


def _unreadable_fault(path: FilePath) -> str:
    """Return why the background image's file cannot be read; "" when it can."""
    if not is_file(path):
        return f"there is no file '{path.name}' beside the recipe"
    try:
        read_image(path)
    except (ImageError, OSError) as error:
        return f"'{path.name}' is not an image that can be read: {error}"
    return ""


@step(
    "subtract_background",
    stage="filter",
    sensors=("camera",),
    parameters=SubtractBackgroundParameters,
)
def subtract_background(parameters: SubtractBackgroundParameters, context: StepContext) -> Operator:
    """Keep pixels that differ from the background, which is learned or given as an image.

    image_bgr (height, width, 3) uint8. Learning: OpenCV's MOG2 (Zivkovic 2004) or KNN; shadows
    are background. An image of another size is a mismatch.
    """
    p = parameters
    if p.picture is not None:
        empty = read_image(context.folder / p.picture)
        return _FixedBackground(
            np.asarray(empty, np.uint8), p.threshold or 30.0, p.remove_specks_px
        )
    return _LearnedBackground(p)


class _FixedBackground:
    def __init__(self, empty: BgrImage, threshold: float, specks_px: int) -> None:
        self._empty = empty
        self._threshold = threshold
        self._specks_px = specks_px

    def __call__(self, work: Work, other: AnyMasked | None) -> Work:  # noqa: ARG002 - the interface
        image = work.reading.image_bgr
        if image.shape != self._empty.shape:
            sizes = f"{image.shape[1]} x {image.shape[0]}", self._empty.shape[1::-1]
            raise CannotMixError(
                "mismatch", f"subtract_background: {sizes[0]}, the background {sizes[1]}"
            )
        apart = cv2.absdiff(image, self._empty)
        largest = cv2.max(cv2.max(apart[:, :, 0], apart[:, :, 1]), apart[:, :, 2])
        mask = _above(largest, self._threshold)
        return Masked(work.reading, intersect_masks(_open_mask(mask, self._specks_px), work.mask))


class _LearnedBackground:
    def __init__(self, p: SubtractBackgroundParameters) -> None:
        kind: Any = (
            cv2.createBackgroundSubtractorMOG2
            if p.method == "mog2"
            else cv2.createBackgroundSubtractorKNN
        )
        threshold = p.threshold or (16.0 if p.method == "mog2" else 400.0)
        self._model = kind(p.history, threshold, True)
        self._learn = p.learn
        self._specks_px = p.remove_specks_px
        self._seen = 0
        self._shape: tuple[int, ...] = ()

    def __call__(self, work: Work, other: AnyMasked | None) -> Work:  # noqa: ARG002 - the interface
        image = work.reading.image_bgr
        if image.shape != self._shape:
            # OpenCV's model begins anew with another size.
            self._shape, self._seen = image.shape, 0
        found = self._model.apply(image)
        mask = _above(found, _SHADOW)
        if self._seen < self._learn:
            mask[:] = 0
        self._seen += 1
        return Masked(work.reading, intersect_masks(_open_mask(mask, self._specks_px), work.mask))


_SHADOW = 127.0


def _above(levels: Mask, threshold: float) -> Mask:
    """Return the foreground mask of levels above a threshold, of an image of any size."""
    return np.asarray(cv2.threshold(levels, threshold, 255, cv2.THRESH_BINARY)[1], np.uint8)


def _open_mask(mask: Mask, radius_px: int) -> Mask:
    """Remove specks from the foreground mask by a morphological opening; works in place."""
    if radius_px:
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius_px + 1,) * 2)
        cv2.morphologyEx(mask, cv2.MORPH_OPEN, disc, dst=mask)
    return mask
