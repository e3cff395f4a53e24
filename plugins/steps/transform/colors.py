"""Transforms of an image's colours: colour space, and matching to the other camera."""

from dataclasses import replace
from typing import Annotated, Literal

import cv2
from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.plugins.steps.operations.photometry import (
    PhotometricCorrection,
    PhotometricCorrector,
    measure_photometry,
    photometric_correction,
    photometry_with_known,
)
from wil_campaign.recipes.model.registry import SidedParameters, Stage, StepContext, step
from wil_campaign.recipes.working import AnyMasked, CannotMixError, Masked, Operator, Side
from wil_campaign.vehicles.readings import BgrImage, CameraReading

Work = Masked[CameraReading]

_TO_BGR: dict[str, int] = {
    "rgb": cv2.COLOR_RGB2BGR,
    "hsv": cv2.COLOR_HSV2BGR,
    "lab": cv2.COLOR_LAB2BGR,
    "ycrcb": cv2.COLOR_YCrCb2BGR,
}


class ColorSpaceParameters(SidedParameters):
    """given: the colour space of the source's channels; shown: in colours, or in shades of grey."""

    shorthand = "given"

    given: Literal["bgr", "rgb", "hsv", "lab", "ycrcb"] = "bgr"
    shown: Literal["color", "gray"] = "color"


_MATCHING: tuple[Stage, ...] = ("transform", "filter")


@step("color_space", stage="transform", sensors=("camera",), parameters=ColorSpaceParameters)
def color_space(parameters: ColorSpaceParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Convert an image's channels into blue, green, red; or its colours into shades of grey.

    image_bgr stays (height, width, 3) uint8. hsv, lab and ycrcb in OpenCV's 8-bit form (hue 0 to
    179). Grey is ITU-R BT.601 luma in all three channels.
    """
    turn = _TO_BGR.get(parameters.given)

    def operator(work: Work, other: AnyMasked | None) -> Work:  # noqa: ARG001 - the interface
        image: BgrImage = work.reading.image_bgr
        if turn is not None:
            image = cv2.cvtColor(image, turn)
        if parameters.shown == "gray":
            image = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
        return work if image is work.reading.image_bgr else _with_image(work, image)

    return operator


def _with_image(work: Work, image_bgr: BgrImage) -> Work:
    """Return the side with its image replaced by one of other colours."""
    return Masked(replace(work.reading, image_bgr=image_bgr), work.mask)


class MatchPhotometryParameters(SidedParameters):
    """Which photometric properties of the other side's camera to match, and known ones.

    gains_bgr, noise_std_dn, blur_sigma_px: known values in place of those measured in the other
    side's images. max_gain: bound of each measured gain and of its inverse. measure_every: frames
    between two measurements. smoothing: weight of the old correction at each measurement. seed: of
    the noise. exposure, white_balance, noise, blur: whether this property is matched.
    """

    exposure: bool = True
    white_balance: bool = True
    noise: bool = True
    blur: bool = True
    gains_bgr: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    noise_std_dn: Annotated[float, Field(ge=0, le=100)] | None = None
    blur_sigma_px: Annotated[float, Field(ge=0, le=20)] | None = None
    max_gain: Annotated[float, Field(ge=1, le=16)] = 3.0
    measure_every: Annotated[int, Field(ge=1, le=10_000)] = 10
    smoothing: Annotated[float, Field(ge=0, lt=1)] = 0.5
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _one_side(self) -> "MatchPhotometryParameters":
        """Require one side whose colours are matched, and positive gains."""
        if self.on == "both":
            raise ValueError("one side is matched to the other: 'on' must be real or twin")
        if self.gains_bgr is not None and min(self.gains_bgr) <= 0:
            raise ValueError("gains_bgr must be positive")
        for key, value, matched in (
            ("noise_std_dn", self.noise_std_dn, self.noise),
            ("blur_sigma_px", self.blur_sigma_px, self.blur),
        ):
            if value is not None and not matched:
                raise KeyFaultError(key, f"has no effect with {key.partition('_')[0]}: false")
        return self

    def like(self) -> Side | None:
        """Return the side whose colours are matched."""
        return "twin" if self.on == "real" else "real"


def match_photometry(parameters: MatchPhotometryParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Give an image the exposure, white balance, noise and blur of the other side's camera.

    image_bgr (height, width, 3) uint8, grey levels 0 to 255. As a filter after the step that
    isolates an object, its blur does not include the object's old background.
    """
    return _Matcher(parameters)


MATCHES = tuple(
    step(
        "match_photometry", stage=stage, sensors=("camera",), parameters=MatchPhotometryParameters
    )(match_photometry)
    for stage in _MATCHING
)
"""The step in both stages that may have it."""


class _Matcher:
    """Matches an image to the other side's camera: measures sometimes, corrects every frame."""

    def __init__(self, parameters: MatchPhotometryParameters) -> None:
        self._p = parameters
        self._corrector = PhotometricCorrector(parameters.seed)
        self._now: PhotometricCorrection | None = None
        self._frame = 0

    def __call__(self, work: Work, other: Work | None) -> Work:
        if other is None:
            missing = "twin" if self._p.on == "real" else "real"
            raise CannotMixError(
                "no_twin" if missing == "twin" else "no_real",
                f"match_photometry: there is no image of {missing}",
            )
        if self._now is None or self._frame % self._p.measure_every == 0:
            wanted = self._wanted_correction(work, other)
            share = 1.0 - self._p.smoothing
            self._now = wanted if self._now is None else self._now.towards(wanted, share)
        self._frame += 1
        reading = work.reading
        image = self._corrector.applied(reading.image_bgr, work.mask, self._now, reading.seq)
        return work if image is reading.image_bgr else _with_image(work, image)

    def _wanted_correction(self, work: Work, other: Work) -> PhotometricCorrection:
        """Return the correction that matches this side's colours to the other camera's."""
        p = self._p
        theirs = photometry_with_known(
            measure_photometry(other.reading.image_bgr),
            noise_std_dn=p.noise_std_dn,
            blur_sigma_px=p.blur_sigma_px,
        )
        wanted = photometric_correction(
            measure_photometry(work.reading.image_bgr),
            theirs,
            max_gain=p.max_gain,
            exposure=p.exposure,
            white_balance=p.white_balance,
        )
        if p.gains_bgr is not None:
            blue, green, red = p.gains_bgr
            wanted = replace(wanted, gains_bgr=(blue, green, red))
        return replace(
            wanted,
            noise_std_dn=wanted.noise_std_dn if p.noise else 0.0,
            blur_sigma_px=wanted.blur_sigma_px if p.blur else 0.0,
        )
