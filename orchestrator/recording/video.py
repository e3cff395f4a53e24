"""Writes images of one size as a video, playable even when cut off."""

from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import av
import cv2

from wil_campaign.foundation.background_file import BackgroundFile
from wil_campaign.vehicles.readings import BgrImage

_TIME_BASE = Fraction(1, 90_000)


class VideoWriter:
    """Writes a video of images of one size as H.264 in fragmented MP4; a context manager.

    Each second is a separate fragment, so that the file of a killed writer is playable up to
    there. One encoder thread: the bytes depend only on the images and their times.
    """

    def __init__(self, *, path: Path, rate_hz: float) -> None:
        self._path = path
        self._rate_hz = rate_hz
        self._stream: Any = None
        self._last_pts = -1

    def __enter__(self) -> Self:
        self._file = BackgroundFile(self._path)
        self._container: Any = av.open(
            self._file,
            "w",
            format="mp4",
            options={
                "movflags": "frag_keyframe+empty_moov+default_base_moof",
                "flush_packets": "1",
            },
        )
        return self

    def write(self, t_s: float, image_bgr: BgrImage) -> None:
        """Append an image (height, width, 3) exposed at t_s to the video; later than the last."""
        if self._stream is None:
            self._open_stream(image_bgr.shape[1], image_bgr.shape[0])
        pts = round(t_s / _TIME_BASE)
        if pts <= self._last_pts:
            return
        self._last_pts = pts
        even = image_bgr[: image_bgr.shape[0] & ~1, : image_bgr.shape[1] & ~1]
        planar = cv2.cvtColor(even, cv2.COLOR_BGR2YUV_I420)
        frame = av.VideoFrame.from_ndarray(planar, format="yuv420p")
        frame.pts, frame.time_base = pts, _TIME_BASE
        self._container.mux(self._stream.encode(frame))
        self._file.flush()

    def _open_stream(self, width_px: int, height_px: int) -> None:
        rate = Fraction(self._rate_hz).limit_denominator(1000)
        stream: Any = self._container.add_stream("libx264", rate=rate)
        stream.width, stream.height = width_px & ~1, height_px & ~1
        stream.pix_fmt = "yuv420p"
        # The encoder's own is 1/rate: two images within one of its ticks could not be written.
        stream.codec_context.time_base = stream.time_base = _TIME_BASE
        stream.codec_context.thread_count = 1
        stream.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "crf": "26",
            "g": str(max(1, round(self._rate_hz))),
        }
        self._stream = stream

    def __exit__(self, *_: object) -> None:
        try:
            if self._stream is not None:
                self._container.mux(self._stream.encode(None))
        finally:
            try:
                self._container.close()
            finally:
                self._file.close()
            if self._stream is None:
                self._path.unlink(missing_ok=True)
