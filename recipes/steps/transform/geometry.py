"""Transforms of an image's geometry: size, crop, camera model, and `register`.

The worlds are aligned by the pose of the requested reading, not by warping another one, as a warp
cannot show what a nearer object hides.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, Part
from wil_campaign.recipes.model.registry import SidedParameters, StepContext, StepParameters, step
from wil_campaign.recipes.operations.optics import (
    Aspect,
    ImageReading,
    cropped_image,
    image_size_px,
    reframed_image,
    remapped_image,
)
from wil_campaign.recipes.operations.step_parameters import (
    IMAGE_SENSORS,
    IntrinsicsPart,
    RotationPart,
    SizePx,
)
from wil_campaign.recipes.working import (
    Align,
    CannotMixError,
    DropReason,
    Masked,
    Operator,
    PoseRequest,
    Side,
)
from wil_campaign.worlds.frames import IDENTITY

Work = Masked[ImageReading]


class Size(Part):
    """An image size in pixels, the target of a transform.

    width_px, height_px: of the image after the step.
    """

    width_px: SizePx
    height_px: SizePx


def refuse_own_side(parameters: SidedParameters, to: object, what: str) -> None:
    """Raise KeyFaultError when an image transform's target is the side that it works on."""
    if to in parameters.sides():
        message = f"{to} would get its own {what}, as 'on' is {parameters.on}; name the other side"
        raise KeyFaultError("to", message)


def require_other_side(name: str, to: Side, other: Work | None) -> Work:
    """Return the other side, whose geometry is used. Raises CannotMixError if it is missing."""
    if other is None:
        missing: DropReason = "no_real" if to == "real" else "no_twin"
        raise CannotMixError(missing, f"{name} to {to}: there is no reading of {to}")
    return other


class ResizeParameters(SidedParameters):
    """to: the image size: the other side's, or one given. aspect: between sizes of other ratios.

    `fit` scales each axis by itself. `crop` and `pad` scale both alike: `crop` cuts off what is
    over, alike on both edges; `pad` keeps the whole image, between bars that are not kept.
    """

    shorthand = "to"
    reshapes = True

    to: Literal["real", "twin"] | Size
    aspect: Aspect = "fit"

    @model_validator(mode="after")
    def _not_to_itself(self) -> "ResizeParameters":
        """Refuse an image resize to the side's own size."""
        refuse_own_side(self, self.to, "size")
        return self

    def like(self) -> Side | None:
        """Return the side whose image size is taken."""
        return self.to if isinstance(self.to, str) else None


@step("resize", stage="transform", sensors=IMAGE_SENSORS, parameters=ResizeParameters)
def resize(parameters: ResizeParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Scale an image to a size, or to the other side's, with its intrinsics, depth and ids.

    image_bgr (h, w, 3) uint8 to (h', w', 3); depth_m in metres and object_ids take the nearest. A
    point of the scene keeps its ray: `crop` and `pad` move the optical centre.
    """
    to, aspect = parameters.to, parameters.aspect

    def operator(work: Work, other: Work | None) -> Work:
        if isinstance(to, Size):
            return reframed_image(work, to.width_px, to.height_px, aspect)
        return reframed_image(
            work, *image_size_px(require_other_side("resize", to, other).reading), aspect
        )

    return operator


class CropParameters(SidedParameters):
    """left_px, top_px: of the first pixel of the part; None centres the part.

    width_px, height_px: size of the part that is kept.
    """

    reshapes = True

    width_px: SizePx
    height_px: SizePx
    left_px: int | None = None
    top_px: int | None = None


@step("crop", stage="transform", sensors=IMAGE_SENSORS, parameters=CropParameters)
def crop(parameters: CropParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Cut a part out of an image, and adapt its intrinsics.

    image_bgr (h, w, 3) to (height_px, width_px, 3), likewise depth_m and object_ids. A part that
    is not inside the image is a mismatch.
    """
    p = parameters

    def operator(work: Work, other: Work | None) -> Work:  # noqa: ARG001 - the interface
        across, down = image_size_px(work.reading)
        left_px = (across - p.width_px) // 2 if p.left_px is None else p.left_px
        top_px = (down - p.height_px) // 2 if p.top_px is None else p.top_px
        try:
            return cropped_image(work, left_px, top_px, p.width_px, p.height_px)
        except ValueError as error:
            raise CannotMixError("mismatch", f"crop: {error}") from None

    return operator


class CameraModelParameters(SidedParameters):
    """to: the camera to imitate, the other side's or a given one.

    turn: attitude of the camera to imitate in the FRD frame of the one that took the image.
    """

    shorthand = "to"
    reshapes = True

    to: Literal["real", "twin"] | IntrinsicsPart
    turn: RotationPart = RotationPart()

    @model_validator(mode="after")
    def _not_to_itself(self) -> "CameraModelParameters":
        """Refuse imitating the side's own camera."""
        refuse_own_side(self, self.to, "camera")
        return self

    def like(self) -> Side | None:
        """Return the side whose camera is taken."""
        return self.to if isinstance(self.to, str) else None


@step("camera_model", stage="transform", sensors=IMAGE_SENSORS, parameters=CameraModelParameters)
def camera_model(parameters: CameraModelParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Convert an image to another camera's size, intrinsics and lens distortion.

    Each pixel (u, v) of the new image is traced through both models (OpenCV's pinhole with
    Brown distortion). Pixels that the old camera did not see are not kept. depth_m: metres along
    the new optical axis. `turn` rotates the view; the camera's place cannot be changed.
    """
    to, angles = parameters.to, parameters.turn.quaternion()
    turn = IDENTITY if parameters.turn == RotationPart() else angles

    def operator(work: Work, other: Work | None) -> Work:
        if isinstance(to, IntrinsicsPart):
            return remapped_image(work, to.intrinsics(), turn)
        return remapped_image(
            work, require_other_side("camera_model", to, other).reading.intrinsics, turn
        )

    return operator


_FROM_A_PLACE = ("camera", "depth", "lidar", "lidar_points", "rangefinder")
"""Sensors of the surroundings, which a simulator can render from a requested pose."""


class RegisterParameters(StepParameters):
    """pose: of which vehicle. align: see PoseRequest. max_gap_ms: to the nearest pose sample."""

    pose: Side = "real"
    align: Align = "interpolate"
    max_gap_ms: Annotated[float, Field(gt=0, le=1000)] = 100.0


@step("register", stage="transform", sensors=_FROM_A_PLACE, parameters=RegisterParameters)
def register(parameters: RegisterParameters, context: StepContext) -> PoseRequest:  # noqa: ARG001 - the interface of steps
    """Take the twin's reading from a vehicle's pose at the time of the real one's exposure."""
    return PoseRequest(parameters.pose, parameters.align, parameters.max_gap_ms / 1000.0)
