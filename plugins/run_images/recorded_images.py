"""Decodes the images of a recording at given times: what was perceived, and what it was made of."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.records import Message
from numpy.typing import NDArray

from wil_campaign.orchestrator.recording.recorded_images import RecordedImages
from wil_campaign.orchestrator.report.reading.recorded_sights import RecordedSight, read_sights
from wil_campaign.vehicles.perception.depth_colors import color_depth
from wil_campaign.vehicles.readings import BgrImage

_ALONE = {"sim": "twin", "real": "real"}


@dataclass(frozen=True, slots=True)
class ImagesAtTime:
    """The images of a time, by source: real, twin and mixed, or the one that was perceived.

    is_depth: their colours are those of depths.
    """

    t_s: float
    images_bgr: Mapping[str, BgrImage]
    is_depth: bool = False


def read_images(run: Path, *, mode: str, wanted_s: Sequence[float]) -> list[ImagesAtTime]:
    """Return the images of a run's folder at each wanted time, as far as they are recorded.

    Raises NotDrawnAgainError.
    """
    found = read_sights(run / "run.mcap", mode=mode, wanted_s=wanted_s)
    drawn = RecordedImages(found.facts)
    for sights in found.sights.values():
        shown = [_decode_sight(sight, mode, drawn) for sight in sights]
        if any(images_at_time.images_bgr for images_at_time in shown):
            return [images_at_time for images_at_time in shown if images_at_time.images_bgr]
    return []


def most_mixed(images: Sequence[ImagesAtTime]) -> ImagesAtTime | None:
    """Return the images in which the mixture differs most from the real one; the last of equals."""
    return max(reversed(images), key=_difference, default=None)


def _difference(images: ImagesAtTime) -> float:
    real, mixed = images.images_bgr.get("real"), images.images_bgr.get("mixed")
    if real is None or mixed is None or real.shape != mixed.shape:
        return 0.0
    return float(cv2.absdiff(real, mixed).mean())


def _decode_sight(sight: RecordedSight, mode: str, drawn: RecordedImages) -> ImagesAtTime:
    beside = list(_decode(sight.beside, drawn))
    perceived = list(_decode((sight.perceived,), drawn))
    images = {source: image for source, image, _ in beside}
    images |= {_ALONE.get(mode, "mixed"): image for _, image, _ in perceived}
    return ImagesAtTime(sight.wanted_s, images, any(is_depth for *_, is_depth in perceived))


def _decode(
    messages: Sequence[Message], drawn: RecordedImages
) -> Iterator[tuple[str, BgrImage, bool]]:
    """Yield the source and the colours of each image, and whether they are those of depths."""
    for message in messages:
        try:
            document = json.loads(message.data)
            kind = document["wil"]["type"]
            if kind in {"camera", "depth"}:
                is_depth = kind == "depth"
                image = _as_bgr(drawn.image(document), is_depth=is_depth)
                yield str(document["wil"]["source"]), image, is_depth
        except (KeyError, ValueError, TypeError, AttributeError, cv2.error):
            continue  # a reading of another type, or of another program


def _as_bgr(image: NDArray[Any], *, is_depth: bool) -> BgrImage:
    if is_depth:
        return color_depth(image)
    bgr: BgrImage = image
    if image.ndim == 2:
        bgr = cv2.cvtColor(image.astype(np.uint8), cv2.COLOR_GRAY2BGR).astype(np.uint8)
    return bgr
