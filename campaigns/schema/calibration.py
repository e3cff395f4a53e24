"""A camera's calibration, in a file of its own: what `wil-campaign calibrate` writes."""

from typing import Annotated, Literal

from pydantic import Field

from wil_campaign.campaigns.schema.sensors import Distortion, Focal, Pixels
from wil_campaign.foundation.files.documents import Document, Part, check_document
from wil_campaign.vehicles.sensors.sensor_spec import MountPart
from wil_campaign.worlds.camera import Intrinsics


class OpticsPart(Part):
    """The camera model in a calibration file: OpenCV's pinhole with distortion, for one size."""

    width_px: Pixels
    height_px: Pixels
    fx_px: Focal
    fy_px: Focal
    cx_px: float
    cy_px: float
    distortion: Distortion = Field(default_factory=list)

    def intrinsics(self) -> Intrinsics:
        """Return the calibrated camera model."""
        return Intrinsics(
            width_px=self.width_px,
            height_px=self.height_px,
            fx_px=self.fx_px,
            fy_px=self.fy_px,
            cx_px=self.cx_px,
            cy_px=self.cy_px,
            distortion=tuple(self.distortion),
        )


class OpticsQualityPart(Part):
    """The quality of calibrated optics. rms_px: reprojection error of the corners."""

    board: str
    pictures: Annotated[int, Field(ge=1)]
    rms_px: Annotated[float, Field(ge=0)]
    covered: Annotated[float, Field(ge=0, le=1)]


class SpreadPart(Part):
    """The spread of calibrated mounting and latency: one standard deviation."""

    mount_m: Annotated[float, Field(ge=0)] | None = None
    mount_deg: Annotated[float, Field(ge=0)] | None = None
    latency_ms: Annotated[float, Field(ge=0)] | None = None


class CalibrationPart(Part):
    """A calibration file. mount, latency_ms: None until they are measured."""

    schema_: Literal["wil/calibration/1"] = Field(alias="schema")
    camera: OpticsPart
    mount: MountPart | None = None
    latency_ms: Annotated[float, Field(ge=0, le=10_000)] | None = None
    quality: OpticsQualityPart | None = None
    spread: SpreadPart | None = None


def read_calibration(document: Document) -> CalibrationPart:
    """Return the calibration in a document. Raises BadInput."""
    return check_document(document, CalibrationPart)
