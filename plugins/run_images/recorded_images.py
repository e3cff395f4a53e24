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

    far_m: where their colours are those of depths, the end of their scale, metres; else None.
    """

    t_s: float
    images_bgr: Mapping[str, BgrImage]
    far_m: float | None = None


def read_images(run: Path, *, mode: str, wanted_s: Sequence[float]) -> list[ImagesAtTime]:
    """Return the images of a run's folder at each wanted time, as far as they are recorded.

    Raises NotDrawnAgainError.
    """
    found = read_sights(run / "run.mcap", mode=mode, wanted_s=wanted_s)
    drawn = RecordedImages(found.facts)
    for sights in found.sights.values():
        far_m = drawn.far_m(one for sight in sights for one in (sight.perceived, *sight.beside))
        shown = [_decode_sight(sight, mode, drawn, far_m) for sight in sights]
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


def _decode_sight(
    sight: RecordedSight, mode: str, drawn: RecordedImages, far_m: float | None
) -> ImagesAtTime:
    images = dict(_decode(sight.beside, drawn, far_m))
    for _, image in _decode((sight.perceived,), drawn, far_m):
        images[_ALONE.get(mode, "mixed")] = image
    return ImagesAtTime(sight.wanted_s, images, far_m)


def _decode(
    messages: Sequence[Message], drawn: RecordedImages, far_m: float | None
) -> Iterator[tuple[str, BgrImage]]:
    """Yield the source and the colours of each image. far_m: the end of the scale of depths."""
    for message in messages:
        try:
            document = json.loads(message.data)
            kind = document["wil"]["type"]
            if kind in {"camera", "depth"}:
                image = _as_bgr(drawn.image(document), far_m if kind == "depth" else None)
                yield str(document["wil"]["source"]), image
        except (KeyError, ValueError, TypeError, AttributeError, cv2.error):
            continue  # a reading of another type, or of another program


def _as_bgr(image: NDArray[Any], far_m: float | None) -> BgrImage:
    if far_m is not None:
        return color_depth(image, far_m)
    bgr: BgrImage = image
    if image.ndim == 2:
        bgr = cv2.cvtColor(image.astype(np.uint8), cv2.COLOR_GRAY2BGR).astype(np.uint8)
    return bgr
