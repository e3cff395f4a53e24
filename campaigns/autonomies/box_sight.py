"""Direction and size of an object from a detector's box, in a level frame ahead."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from wil_campaign.api import CameraReading, Detection, OnnxDetector, shipped_detector

from .gate_sight import GateCameraView

Layout = Literal["auto", "v5", "v8", "end2end"]
"""Of the output of a detector; as OnnxDetector takes it."""


@dataclass(frozen=True, slots=True)
class BoxSight:
    """A box in a level frame: its centre, width and height as slopes (metres per metre ahead).

    area: width times height; for an object of area A at a distance d it is A / d^2.
    """

    right: float
    down: float
    width: float
    height: float

    @property
    def area(self) -> float:
        """Return the area of the box, as a product of slopes."""
        return self.width * self.height


class BoxFinder:
    """Finds the box of one class with the highest score in images.

    model: an ONNX file of the YOLO family beside this file, with the names of its classes (none for
    those that it states itself), the side of its input and the layout of its output; "" is the
    shipped detector. Raises ValueError, DetectorError.
    """

    def __init__(
        self,
        wanted: str,
        *,
        model: str = "",
        names: Sequence[str] = (),
        input_px: int = 640,
        layout: Layout = "auto",
    ) -> None:
        self._wanted = wanted
        if not model:
            self._detector = shipped_detector()
            return
        if names:
            _require(wanted, names, model)
        path = Path(__file__).parent / model
        self._detector = OnnxDetector(
            path, names=names, input_px=(input_px, input_px), layout=layout
        )
        _require(wanted, self._detector.names, model)

    def find(self, reading: CameraReading) -> Detection | None:
        """Return the detection of the class with the highest score; None without any."""
        detections = self._detector.detect(reading.image_bgr)
        return next((detection for detection in detections if detection.name == self._wanted), None)


def _require(wanted: str, names: Sequence[str], model: str) -> None:
    """Raise ValueError for a detector without the wanted class."""
    if wanted not in names:
        raise ValueError(f"the detector '{model}' needs a class '{wanted}' among its names")


def box_sight(box: Detection, view: GateCameraView) -> BoxSight | None:
    """Return the sight of a box in a view; None where a side is not in front of the camera."""
    u_px, v_px = (box.left_px + box.right_px) / 2, (box.top_px + box.bottom_px) / 2
    left, right = view.slopes(box.left_px, v_px), view.slopes(box.right_px, v_px)
    top, bottom = view.slopes(u_px, box.top_px), view.slopes(u_px, box.bottom_px)
    if left is None or right is None or top is None or bottom is None:
        return None
    width, height = right[0] - left[0], bottom[1] - top[1]
    if width <= 0.0 or height <= 0.0:
        return None
    return BoxSight((left[0] + right[0]) / 2, (top[1] + bottom[1]) / 2, width, height)
