"""Delivers images to a V4L2 loopback device, for programs that can only read a camera."""

import stat
from fractions import Fraction
from pathlib import Path
from typing import Any

import av

from wil_campaign.plugins.outlets.h264_encoder import to_h264_frame
from wil_campaign.plugins.outlets.image_delivery import DeliveryError
from wil_campaign.plugins.outlets.threaded_delivery import ThreadedDelivery
from wil_campaign.vehicles.readings import CameraReading

_LOAD_MODULE = "load one: modprobe v4l2loopback video_nr=10 exclusive_caps=1"


class V4l2Sink:
    """Writes raw frames (YUV 4:2:0) to a V4L2 loopback device; a Sink."""

    def __init__(self, *, device: Path, width_px: int, height_px: int, rate_hz: float) -> None:
        self.name = str(device)
        self._device = device
        self._size = (width_px, height_px)
        self._rate = Fraction(rate_hz).limit_denominator(1000)
        self._container: Any = None
        self._stream: Any = None
        self._count = 0

    def open(self) -> None:
        """Open the V4L2 device. Raises DeliveryError."""
        self._check_device()
        try:
            self._container = av.open(self.name, "w", format="v4l2")
            self._stream = self._container.add_stream("rawvideo", rate=self._rate)
            self._stream.width, self._stream.height = self._size[0] & ~1, self._size[1] & ~1
            self._stream.pix_fmt = "yuv420p"
            self._container.start_encoding()
        except (av.error.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise DeliveryError(
                f"{self.name}: cannot open for writing: {reason}; check that it is a "
                f"loopback device and not a camera; {_LOAD_MODULE}"
            ) from error

    def write(self, reading: CameraReading) -> None:
        """Write one image to the V4L2 device. Raises DeliveryError."""
        height, width = reading.image_bgr.shape[:2]
        if (width, height) != self._size:
            raise DeliveryError(
                f"{self.name}: image not sent: its size {width}x{height} does not fit the device's "
                f"{self._size[0]}x{self._size[1]}"
            )
        frame = to_h264_frame(reading.image_bgr, self._count)
        frame.time_base = 1 / self._rate
        self._count += 1
        try:
            self._container.mux(self._stream.encode(frame))
        except (av.error.FFmpegError, OSError) as error:
            raise DeliveryError(f"{self.name}: image not sent: {error}") from error

    def close(self) -> None:
        """Close the V4L2 device."""
        if self._container is not None:
            self._container.close()

    def _check_device(self) -> None:
        try:
            is_device = stat.S_ISCHR(self._device.stat().st_mode)
        except OSError as error:
            raise DeliveryError(f"{self.name}: {error.strerror}; {_LOAD_MODULE}") from error
        if not is_device:
            raise DeliveryError(f"{self.name}: is not a device; {_LOAD_MODULE}")


def v4l2_delivery(
    *, device: Path, width_px: int, height_px: int, rate_hz: float
) -> ThreadedDelivery:
    """Return a delivery to a V4L2 loopback device such as /dev/video10.

    width_px, height_px: of all images. rate_hz: frame rate that the device reports.
    """
    sink = V4l2Sink(device=device, width_px=width_px, height_px=height_px, rate_hz=rate_hz)
    return ThreadedDelivery(sink=sink)
