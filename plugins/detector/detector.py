"""Detects objects with an ONNX network of the YOLO family, run by OpenCV.

Output layouts, each with a leading batch of one: v5 (Ultralytics YOLOv5, v7): rows of cx, cy, w, h,
objectness, a score per class. v8 (v8, v9, v11): the same without objectness, transposed, one
column per candidate. end2end (v10 and exports with NMS): rows of left, top, right, bottom, score,
class. Boxes are in pixels of the network's input. A network of instance segmentation (-seg) adds
coefficients to each candidate, and a second output with prototypes of masks (`instance_masks`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.foundation.files.lfs import LFS_POINTER, is_lfs_file
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.plugins.detector.instance_masks import instance_mask, prototypes_of
from wil_campaign.plugins.detector.network_trial import network_refusal, short_network_error
from wil_campaign.plugins.detector.onnx_names import class_names
from wil_campaign.vehicles.readings import BgrImage, Mask

Layout = Literal["auto", "v5", "v8", "end2end"]

_PAD_GRAY = 114
"""The grey of the padding that YOLO networks are trained with (Ultralytics letterbox)."""


_SHOWN = 4
"""Class names in a message."""


class DetectorError(Exception):
    """A file is not a usable detector, or its output is not that of a detector."""


@dataclass(frozen=True, slots=True)
class Detection:
    """A detection in an image. left_px to bottom_px: edges of its box; score: 0 to 1.

    mask: (height, width) uint8 of the image, 255 is the object; None of a network without masks.
    """

    name: str
    score: float
    left_px: float
    top_px: float
    right_px: float
    bottom_px: float
    mask: Mask | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class LetterboxFit:
    """How an image was letterboxed into the detector's input: scaled alike, then moved."""

    scale: float
    left_px: float
    top_px: float


class OnnxDetector:
    """Detects objects in images. Not thread-safe: the network has buffers.

    names: of the classes, in the order of the network's output; empty for those that the file
    states itself, which others may translate and not contradict. input_px: (width, height) of the
    network's input. threshold: least score. overlap: of two boxes of one class whose intersection
    over union is above it, the one with the higher score stays. Raises DetectorError for an
    unusable file, which is loaded and run in a process of its own first, and as `detect` does.
    """

    def __init__(
        self,
        path: Path,
        *,
        names: Sequence[str] = (),
        input_px: tuple[int, int] = (640, 640),
        threshold: float = 0.25,
        overlap: float = 0.45,
        layout: Layout = "auto",
    ) -> None:
        self._net = _network(path, input_px)
        self._outputs = self._net.getUnconnectedOutLayersNames()
        self._path = path
        self._names = _names_of(path, tuple(names))
        self._input_px = input_px
        self._threshold = threshold
        self._overlap = overlap
        self._layout = layout
        # What its output has is known before a flight, too.
        self.detect(np.zeros((input_px[1], input_px[0], 3), np.uint8))

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the detector's classes, in the order of its output."""
        return self._names

    def detect(self, image_bgr: BgrImage) -> tuple[Detection, ...]:
        """Return the detections in a (height, width, 3) uint8 image, the highest score first.

        Raises DetectorError when the network cannot run on the input, when its output fits no
        layout or several, and for a class without a name.
        """
        laid, how = letterboxed_image(image_bgr, self._input_px)
        blob = cv2.dnn.blobFromImage(laid, 1.0 / 255.0, swapRB=True)
        try:
            self._net.setInput(blob)
            outputs = [np.asarray(one) for one in self._net.forward(self._outputs)]
        except cv2.error as error:
            raise DetectorError(
                f"'{self._path.name}' cannot run on {self._input_px}: {short_network_error(error)}"
            ) from error
        index, prototypes = prototypes_of(outputs)
        extra = 0 if prototypes is None else len(prototypes)
        found = decoded_candidates(outputs[index], len(self._names), self._layout, extra)
        height_px, width_px = image_bgr.shape[:2]
        detections = []
        for one in surest_candidates(found, self._threshold, self._overlap):
            box = _to_image(found.boxes[one], how, width_px, height_px)
            mask = None
            if prototypes is not None:
                mask = instance_mask(
                    found.coefficients[one],
                    prototypes,
                    box_px=box,
                    placed_px=(how.left_px, how.top_px, how.scale),
                    input_px=self._input_px,
                    image_px=(width_px, height_px),
                )
            name = self._name(int(found.kinds[one]))
            detections.append(Detection(name, float(found.scores[one]), *box, mask))
        return tuple(detections)

    def _name(self, kind: int) -> str:
        """Return the name of a class. Raises DetectorError for one beyond the names."""
        if not 0 <= kind < len(self._names):
            count = len(self._names)
            raise DetectorError(
                f"'{self._path.name}' found class {kind}, but has {count} names (classes 0 to "
                f"{count - 1}); name all classes of the network, in order"
            )
        return self._names[kind]


def _names_of(path: Path, given: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of a detector's classes, as given or as its file states them.

    Raises DetectorError without either, and for names that contradict the file's: another number of
    them, or one at the place of another.
    """
    stated = class_names(path)
    if not given:
        if not stated:
            raise DetectorError(f"'{path.name}' does not state its classes; give names, in order")
        return stated
    has = f"'{path.name}' has the classes {_listed(stated)}"
    if stated and len(given) != len(stated):
        raise DetectorError(
            f"{has} ({len(stated)}), and names has {len(given)}; name all of them in this order, "
            "or leave names out"
        )
    for number, (name, own) in enumerate(zip(given, stated, strict=False)):
        if name != own and name in stated:
            raise DetectorError(
                f"{has}: class {number} is '{own}', and '{name}' in names; name them in this "
                "order, or leave names out"
            )
    return given


def _listed(names: tuple[str, ...]) -> str:
    """Return the first names of a detector's classes as a text."""
    return ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")


def _network(path: Path, input_px: tuple[int, int]) -> Any:
    """Return the detector's network of an ONNX file. Raises DetectorError."""
    if not is_file(path):
        raise DetectorError(f"there is no file '{path.name}'")
    try:
        refused = (
            f"'{path.name}': {LFS_POINTER}"
            if is_lfs_file(path)
            else network_refusal(path, input_px)
        )
        if refused:
            raise DetectorError(refused)
        net = cv2.dnn.readNetFromONNX(str(path))
    except OSError as error:
        raise DetectorError(f"'{path.name}' cannot be read: {error.strerror}") from error
    except cv2.error as error:
        raise DetectorError(
            f"'{path.name}' is not an ONNX network: {short_network_error(error)}"
        ) from error
    if net.empty():
        raise DetectorError(f"'{path.name}' is an empty network")
    return net


def letterboxed_image(
    image_bgr: BgrImage, input_px: tuple[int, int]
) -> tuple[BgrImage, LetterboxFit]:
    """Return the image letterboxed into the detector's input, and how."""
    height_px, width_px = image_bgr.shape[:2]
    scale = min(input_px[0] / width_px, input_px[1] / height_px)
    across, down = max(1, round(width_px * scale)), max(1, round(height_px * scale))
    left, top = (input_px[0] - across) // 2, (input_px[1] - down) // 2
    laid = np.full((input_px[1], input_px[0], 3), _PAD_GRAY, np.uint8)
    kind = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    laid[top : top + down, left : left + across] = cv2.resize(
        image_bgr, (across, down), interpolation=kind
    )
    return laid, LetterboxFit(scale, float(left), float(top))


@dataclass(frozen=True, slots=True)
class DetectorCandidates:
    """A detector's candidates: boxes (n, 4) left, top, right, bottom; scores (n,); kinds (n,).

    coefficients: (n, m) of mask prototypes; m is 0 without masks.
    """

    boxes: NDArray[np.float32]
    scores: NDArray[np.float32]
    kinds: NDArray[np.int64]
    coefficients: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 0), np.float32))


def decoded_candidates(
    output: NDArray[Any], classes: int, layout: Layout, extra: int = 0
) -> DetectorCandidates:
    """Return the candidates in a detector's output. Raises DetectorError when nothing fits.

    extra: coefficients of masks, the last numbers of each candidate.

    `auto` goes by the shape: (1, n, 5 + classes) is v5, (1, 4 + classes, n) v8, (1, n, 6) end2end.
    An output that fits several, as that of one class with v5 and end2end, needs the layout stated.
    """
    rows = np.asarray(output, np.float32)
    if rows.ndim != 3 or rows.shape[0] != 1:
        raise DetectorError(f"the output is {output.shape}, not (1, n, m)")
    rows = rows[0]
    numbers = rows.shape[0] - extra, rows.shape[1] - extra
    kind = _layout_of(numbers, classes) if layout == "auto" else layout
    if kind == "v8":
        rows = rows.T
    wanted = {"v5": 5 + classes, "v8": 4 + classes, "end2end": 6}[kind]
    if rows.shape[1] != wanted + extra:
        masks = f" and {extra} of masks" if extra else ""
        raise DetectorError(
            f"the output is {output.shape}; layout {kind} with {classes} classes has {wanted} "
            f"numbers{masks} for each candidate"
        )
    finite = np.isfinite(rows).all(axis=1)
    if len(rows) and not finite.any():
        raise DetectorError(
            "the output is no number in any candidate, as that of a network whose half-precision "
            "numbers overflow; export it in single precision"
        )
    rows = rows[finite]
    rows, coefficients = rows[:, :wanted], rows[:, wanted:]
    if kind == "end2end":
        return DetectorCandidates(
            rows[:, :4], rows[:, 4], rows[:, 5].astype(np.int64), coefficients
        )
    half = rows[:, 2:4] / 2.0
    boxes = np.concatenate([rows[:, :2] - half, rows[:, :2] + half], axis=1)
    by_class = rows[:, 5:] * rows[:, 4:5] if kind == "v5" else rows[:, 4:]
    return DetectorCandidates(boxes, by_class.max(axis=1), by_class.argmax(axis=1), coefficients)


def _layout_of(shape: tuple[int, ...], classes: int) -> Literal["v5", "v8", "end2end"]:
    """Return the output layout of a YOLO detector by its shape.

    Raises DetectorError when no layout fits, or several do.
    """
    candidates: list[Literal["v5", "v8", "end2end"]] = []
    if shape[1] == 5 + classes:
        candidates.append("v5")
    if shape[0] == 4 + classes:
        candidates.append("v8")
    if shape[1] == 6:
        candidates.append("end2end")
    if not candidates:
        # There are more candidates than numbers for each.
        layout, there = ("v8", shape[0] - 4) if shape[0] < shape[1] else ("v5", shape[1] - 5)
        fits = f"; as {layout} it has {there} classes: name all of them, in order"
        raise DetectorError(
            f"the output (1, {shape[0]}, {shape[1]}) has an unknown layout for {classes} classes"
            + (fits if there > 0 else "")
        )
    if len(candidates) > 1:
        raise DetectorError(
            f"the output (1, {shape[0]}, {shape[1]}) for {classes} classes fits the layouts "
            f"{' and '.join(candidates)}; state layout: {' or '.join(candidates)}"
        )
    return candidates[0]


def surest_candidates(found: DetectorCandidates, threshold: float, overlap: float) -> list[int]:
    """Return the candidates above the threshold, the surest first, overlaps suppressed."""
    sure = np.flatnonzero(found.scores >= threshold)
    order = sure[np.argsort(-found.scores[sure], kind="stable")]
    kept: list[int] = []
    for index in order:
        same = [one for one in kept if found.kinds[one] == found.kinds[index]]
        if all(_overlap(found.boxes[one], found.boxes[index]) <= overlap for one in same):
            kept.append(int(index))
    return kept


def _overlap(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    """Return the intersection over the union of two detection boxes."""
    # In doubles: corners near the limit of single precision must not overflow.
    (a_left, a_top, a_right, a_bottom), (b_left, b_top, b_right, b_bottom) = a.tolist(), b.tolist()
    width = min(a_right, b_right) - max(a_left, b_left)
    height = min(a_bottom, b_bottom) - max(a_top, b_top)
    common = max(0.0, width) * max(0.0, height)
    whole = (a_right - a_left) * (a_bottom - a_top) + (b_right - b_left) * (b_bottom - b_top)
    whole -= common
    return common / whole if whole > 0.0 else 0.0


def _to_image(
    box: NDArray[np.float32], how: LetterboxFit, width_px: int, height_px: int
) -> tuple[float, float, float, float]:
    """Return a detection's box in the image, cut at its edges."""
    left, top, right, bottom = (float(edge) for edge in box)
    return (
        min(max((left - how.left_px) / how.scale, 0.0), width_px),
        min(max((top - how.top_px) / how.scale, 0.0), height_px),
        min(max((right - how.left_px) / how.scale, 0.0), width_px),
        min(max((bottom - how.top_px) / how.scale, 0.0), height_px),
    )
