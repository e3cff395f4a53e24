"""Decodes recorded readings into images, sized for a page, and what their types draw."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.records import Message

from wil_campaign.orchestrator.recording.recorded_images import (
    NotDrawnAgainError,
    RecordedImages,
)
from wil_campaign.orchestrator.report.model import (
    CameraView,
    PageImage,
    PerceivedSight,
    SketchedReading,
)
from wil_campaign.orchestrator.report.reading.recorded_sights import RecordedSight, RecordedSights
from wil_campaign.orchestrator.report.words import number_text
from wil_campaign.vehicles.perception.depth_colors import color_depth
from wil_campaign.vehicles.readings import BgrImage
from wil_campaign.vehicles.readings.image_messages import camera_of_message
from wil_campaign.vehicles.readings.kinds import traits_named


@dataclass(frozen=True, slots=True)
class ImageSize:
    """Widths of the images in pixels. main: at the moment; strip: around it."""

    main_px: int
    strip_px: int
    quality: int

    @classmethod
    def for_runs(cls, count: int) -> "ImageSize":
        """Return the size that keeps a report of `count` runs below 20 MB."""
        if count <= 12:
            return cls(640, 320, 80)
        return cls(480, 240, 72) if count <= 100 else cls(320, 160, 60)

    def for_failure(self) -> "ImageSize":
        """Return the size for one of a few failed runs: its strip has large frames."""
        return replace(self, strip_px=self.main_px)


def decode_sights(
    found: RecordedSights, size: ImageSize, *, at_s: float | None
) -> list[PerceivedSight]:
    """Return the perceived readings of one sensor: a camera, else one that is drawn.

    at_s: the moment; its sight is larger, and includes the readings it was mixed from. An image
    that cannot be drawn again becomes a problem of `found`.
    """
    decoder = _Decoder(found, size)
    decoded = [
        decoder.decode_sensor(sensor, sights, at_s) for sensor, sights in found.sights.items()
    ]
    best: list[PerceivedSight] = []
    for sights in decoded:
        if sights and (not best or _is_image(sights) > _is_image(best)):
            best = sights
    return best


def _is_image(sights: Sequence[PerceivedSight]) -> bool:
    return isinstance(sights[0].perceived, PageImage)


class _Decoder:
    """Decodes the readings of one recording."""

    def __init__(self, found: RecordedSights, size: ImageSize) -> None:
        self._size = size
        self._epoch_ns = found.epoch_ns
        self._images = RecordedImages(found.facts)
        self._problems = found.problems
        self._has_refused = False
        self._far_m: float | None = None

    def decode_sensor(
        self, sensor: str, sights: Sequence[RecordedSight], at_s: float | None
    ) -> list[PerceivedSight]:
        """Return the sights of a sensor; all depths have one scale of colours."""
        found: list[PerceivedSight] = []
        shown_together = (
            message
            for sight in sights
            for message in (sight.perceived, *(sight.beside if sight.wanted_s == at_s else ()))
        )
        self._far_m = self._images.far_m(shown_together)
        for sight in sights:
            is_main = sight.wanted_s == at_s
            perceived = self._try(sight.perceived, is_main=is_main)
            if perceived is None:
                continue
            if found and found[-1].perceived.t_s == perceived.t_s:
                if not is_main:
                    continue
                found.pop()  # a slow sensor: the moment shows the same reading
            messages = sight.beside if is_main else ()
            beside = [self._try(message, is_main=False) for message in messages]
            shown = tuple(one for one in beside if one is not None)
            figures = tuple(_figures(sight.provenance))
            found.append(PerceivedSight(sight.wanted_s, perceived, shown, figures, sensor))
        return found

    def _try(self, message: Message, *, is_main: bool) -> PageImage | SketchedReading | None:
        """Return a reading as an image, or to be drawn; None for one that cannot be shown."""
        try:
            return self._decode(message, self._size.main_px if is_main else self._size.strip_px)
        except NotDrawnAgainError as error:
            if not self._has_refused:
                self._has_refused = True
                self._problems.append(str(error))
            return None
        except (KeyError, ValueError, TypeError, AttributeError, cv2.error):
            return None  # a reading of another type, or of another program

    def _decode(self, message: Message, width_px: int) -> PageImage | SketchedReading | None:
        """Return a reading as an image, or what is drawn of it; None for other types."""
        document = json.loads(message.data)
        delivered_s = (message.log_time - self._epoch_ns) / 1e9
        wil = document["wil"]
        if wil["type"] in {"camera", "depth"}:
            image = self._images.image(document)
            far_m = self._far_m if wil["type"] == "depth" else None
            bgr = image if far_m is None else color_depth(image, far_m)
            frame = page_image_of(
                bgr,
                source=str(wil["source"]),
                t_s=float(wil["t_s"]),
                delivered_s=delivered_s,
                width_px=width_px,
                quality=self._size.quality,
            )
            return replace(frame, view=_view(document), far_m=far_m)
        if traits_named(wil["type"]).sketch:
            return SketchedReading(str(wil["source"]), float(wil["t_s"]), wil["type"], document)
        return None


def _view(document: Mapping[str, Any]) -> CameraView | None:
    """Return the camera of an image; None where it was not recorded."""
    try:
        intrinsics, pose = camera_of_message(document)
        # A mixture is in the view of the real vehicle's camera.
        vehicle = "twin" if document["wil"]["source"] == "twin" else "real"
        return CameraView(vehicle, intrinsics, pose)
    except (KeyError, ValueError, TypeError):
        return None


def page_image_of(
    image_bgr: BgrImage,
    *,
    source: str,
    t_s: float,
    delivered_s: float,
    width_px: int,
    quality: int,
) -> PageImage:
    """Return an image as WebP, at most width_px wide. Raises ValueError if it is not an image."""
    if image_bgr.ndim == 2:
        image_bgr = cv2.cvtColor(image_bgr.astype(np.uint8), cv2.COLOR_GRAY2BGR).astype(np.uint8)
    height, width = image_bgr.shape[:2]
    if width > width_px:
        height, width = max(1, round(height * width_px / width)), width_px
        image_bgr = cv2.resize(image_bgr, (width, height), interpolation=cv2.INTER_AREA).astype(
            np.uint8
        )
    whole, coded = cv2.imencode(".webp", image_bgr, [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not whole:
        raise ValueError("no image")
    text = base64.b64encode(coded.tobytes()).decode("ascii")
    return PageImage(source, float(t_s), delivered_s, width, height, text)


def _figures(provenance: Mapping[str, Any]) -> list[tuple[str, str]]:
    found = []
    for title, key, unit in (
        ("exposure skew", "skew_ms", "ms"),
        ("latency", "latency_ms", "ms"),
        ("registration error", "registration_error_px", "px"),
        ("registration within", "registration_bound_px", "px"),
    ):
        value = provenance.get(key)
        if isinstance(value, int | float):
            found.append((title, number_text(round(float(value), 1), unit, 1)))
    if provenance.get("dropped"):
        found.append(("left out", f"{provenance['dropped']}: {provenance.get('detail', '')}"))
    return found


def video_sights(path: Path, wanted_s: Sequence[float], size: ImageSize) -> list[PerceivedSight]:
    """Return frames of a video, as far as it is readable."""
    import av  # noqa: PLC0415 - a tenth of a second; most runs have a recording

    due = sorted(wanted_s)
    middle_s = due[len(due) // 2]
    found: list[PerceivedSight] = []
    last: Any = None
    try:
        with av.open(str(path)) as container:
            for frame in container.decode(video=0):
                while due and last is not None and frame.time > due[0]:
                    found.append(_video_sight(last, due.pop(0), middle_s, size))
                last = frame
            found += [_video_sight(last, at_s, middle_s, size) for at_s in due if last is not None]
    except (av.error.FFmpegError, OSError, ValueError, IndexError, TypeError):
        pass  # keep the frames read so far
    return found


def _video_sight(frame: Any, wanted_s: float, middle_s: float, size: ImageSize) -> PerceivedSight:
    width_px = size.main_px if wanted_s == middle_s else size.strip_px
    image = frame.to_ndarray(format="bgr24")
    shown = page_image_of(
        image,
        source="perceived",
        t_s=frame.time,
        delivered_s=frame.time,
        width_px=width_px,
        quality=size.quality,
    )
    return PerceivedSight(wanted_s, shown)
