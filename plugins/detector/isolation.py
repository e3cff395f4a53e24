"""Filter by detection: the objects that a neural network detects in an image."""

from pathlib import Path as FilePath
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, closest_word
from wil_campaign.plugins.detector.detector import DetectorError, Layout, OnnxDetector
from wil_campaign.recipes.model.registry import ParameterFault, SidedParameters, StepContext, step
from wil_campaign.recipes.operations.masks import intersect_masks
from wil_campaign.recipes.working import AnyMasked, Masked, Operator
from wil_campaign.vehicles.readings import CameraReading, Mask

InputPx = Annotated[int, Field(ge=16, le=4096)]


class IsolateDetectionsParameters(SidedParameters):
    """model: an ONNX file beside the recipe. names: its classes, in order. keep: which of them.

    input_width_px, input_height_px: the network's input. threshold: least score. overlap: of two
    boxes of one class with more (intersection over union) the one with the higher score is kept.
    layout: of the output. grow_px: by how much each box is enlarged on each side; of a network
    with masks (-seg) each mask, by as many pixels.
    """

    model: str
    names: Annotated[list[str], Field(min_length=1)]
    keep: list[str] = Field(default_factory=list)
    input_width_px: InputPx = 640
    input_height_px: InputPx = 640
    threshold: Annotated[float, Field(gt=0, le=1)] = 0.25
    overlap: Annotated[float, Field(ge=0, le=1)] = 0.45
    layout: Layout = "auto"
    grow_px: Annotated[float, Field(ge=-100, le=1000)] = 0.0

    @model_validator(mode="after")
    def _require_known_classes(self) -> "IsolateDetectionsParameters":
        for index, name in enumerate(self.keep):
            if name not in self.names:
                message = f"'{name}' is not a class of the detector"
                raise KeyFaultError(("keep", index), message, closest_word(name, self.names))
        return self

    def detector(self, folder: FilePath) -> OnnxDetector:
        """Return the ONNX detector. Raises DetectorError for an invalid file."""
        return OnnxDetector(
            folder / self.model,
            names=self.names,
            input_px=(self.input_width_px, self.input_height_px),
            threshold=self.threshold,
            overlap=self.overlap,
            layout=self.layout,
        )

    def reference(self) -> str:
        """Return the network's file, which counts as the user's code."""
        return self.model

    def faults(self, folder: FilePath) -> tuple[ParameterFault, ...]:
        """Load the detector and run it once on an empty image; return its faults."""
        empty = np.zeros((self.input_height_px, self.input_width_px, 3), np.uint8)
        try:
            self.detector(folder).detect(empty)
        except DetectorError as error:
            return (ParameterFault(("model",), str(error)),)
        return ()


@step(
    "isolate_detections",
    stage="filter",
    sensors=("camera",),
    parameters=IsolateDetectionsParameters,
)
def isolate_detections(parameters: IsolateDetectionsParameters, context: StepContext) -> Operator:
    """Keep what a detector (an ONNX file of the YOLO family) finds in an image.

    image_bgr (height, width, 3) uint8. Boxes in pixels; of a network of instance segmentation
    (-seg) the pixels of its masks. Classes not in `keep` are not kept; an
    empty `keep` keeps all.
    """
    detector = parameters.detector(context.folder)
    wanted = frozenset(parameters.keep or parameters.names)
    grow = parameters.grow_px

    def operator(
        work: Masked[CameraReading],
        other: AnyMasked | None,  # noqa: ARG001 - the interface
    ) -> Masked[CameraReading]:
        image = work.reading.image_bgr
        mask = np.zeros(image.shape[:2], np.uint8)
        for box in detector.detect(image):
            if box.name in wanted and box.mask is not None:
                mask |= _grown(box.mask, round(grow))
            elif box.name in wanted:
                top, left = (max(0, round(edge - grow)) for edge in (box.top_px, box.left_px))
                bottom, right = (
                    max(0, round(edge + grow)) for edge in (box.bottom_px, box.right_px)
                )
                mask[top:bottom, left:right] = 255
        return Masked(work.reading, intersect_masks(mask, work.mask))

    return operator


def _grown(mask: Mask, grow_px: int) -> Mask:
    """Return a mask with its edge moved out by so many pixels, or in where they are negative."""
    if not grow_px:
        return mask
    size = 2 * abs(grow_px) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    moved: Mask = cv2.dilate(mask, disc) if grow_px > 0 else cv2.erode(mask, disc)
    return moved
