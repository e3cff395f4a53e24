"""Grabs images from any input that FFmpeg opens, and holds back those damaged by lost data."""

import io
import time
from collections.abc import Iterator
from typing import Any

import av

from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.cameras.av_input import (
    AvInput,
    no_image_error,
    no_key_frame_error,
    opening_error,
    redacted_address,
)
from wil_campaign.vehicles.sources.cameras.h264_loss import LossFinder
from wil_campaign.vehicles.sources.cameras.live_camera import GrabbedImage

_READ_TIMEOUT_S = 1.0
"""How often a thread that waits for data checks whether it has to stop.

FFmpeg loses the stamp of the image after a read that ended so: one that comes within this time of
the last keeps it.
"""


class AvGrabber:
    """A Grabber of camera images by PyAV: RTSP, RTP and V4L2.

    After lost or broken data every frame is held back until the next key frame, since a decoder
    continues from wrong frames without an error. A stream that is joined late starts with its
    first key frame: earlier frames are neither handed on nor counted as damaged.
    """

    def __init__(self, *, source: AvInput, open_timeout_s: float = 5.0) -> None:
        self._source = source
        self._open_timeout_s = open_timeout_s
        self._container: Any = None
        self._stream: Any = None
        self._frames: Iterator[Any] = iter(())
        self._packets: Iterator[Any] | None = None
        self._losses = LossFinder()
        self._finds_losses = False
        self._broken = True
        self._first: GrabbedImage | None = None

    def open(self) -> None:
        """Open PyAV's address and wait for its first image. Raises SourceError."""
        deadline_s = time.monotonic() + self._open_timeout_s
        self._open_stream(deadline_s)
        joined_late = False
        while self._first is None:
            grabbed = self._next_frame()
            joined_late = joined_late or grabbed is not None
            if grabbed is not None and grabbed.image_bgr is not None:
                self._first = grabbed
            elif time.monotonic() > deadline_s:
                raise (no_key_frame_error if joined_late else no_image_error)(self._source.url)

    def _open_stream(self, deadline_s: float) -> None:
        source = self._source
        session = source.session()
        try:
            self._container = av.open(
                io.BytesIO(session.encode()) if session is not None else source.url,
                format=source.format,
                options=dict(source.options),
                timeout=(self._open_timeout_s, _READ_TIMEOUT_S),
            )
        except (av.error.FFmpegError, OSError, ValueError) as error:
            # An interrupted wait shows as any of many errors, among them invalid data.
            if time.monotonic() >= deadline_s:
                raise no_image_error(source.url) from error
            raise opening_error(source.url, error) from error
        if not self._container.streams.video:
            raise SourceError(f"{redacted_address(source.url)}: has no video")
        self._stream = self._container.streams.video[0]
        # With more threads several frames are decoded at once, and each is later.
        self._stream.codec_context.thread_count = 1
        on_network = source.kind in {"rtp", "rtsp"}
        self._finds_losses = on_network and self._stream.codec_context.name == "h264"
        extradata = self._stream.codec_context.extradata
        if self._finds_losses and extradata:
            self._losses.lost_before(bytes(extradata))

    def grab(self) -> GrabbedImage | None:
        """Return PyAV's next image; None when none came for a moment. Raises SourceError."""
        first, self._first = self._first, None
        return first or self._next_frame()

    def close(self) -> None:
        """Close PyAV's stream or device."""
        if self._container is not None:
            self._container.close()

    def _next_frame(self) -> GrabbedImage | None:
        frame = next(self._frames, None)
        if frame is not None:
            return self._check_frame(frame)
        packet = self._next_packet()
        if packet is None:
            return None
        try:
            self._frames = self._decode_packet(packet)
        except av.error.InvalidDataError:
            self._broken = True
        frame = next(self._frames, None)
        if frame is not None:
            return self._check_frame(frame)
        # A decoder without its reference frames returns none; an intact one may only be buffering.
        return GrabbedImage(None, _stamp_s(packet)) if self._broken else None

    def _next_packet(self) -> Any | None:
        if self._packets is None:
            self._packets = self._container.demux(self._stream)
        try:
            packet = next(self._packets, None)
        except (av.error.ExitError, av.error.BlockingIOError):
            self._packets = None
            return None
        except av.error.FFmpegError as error:
            raise SourceError(
                f"{redacted_address(self._source.url)}: the stream was lost: {error.strerror}; "
                "check cable and network"
            ) from error
        if packet is None or packet.size == 0:
            raise SourceError(
                f"{redacted_address(self._source.url)}: the stream has ended: its sender closed it"
            )
        return packet

    def _decode_packet(self, packet: Any) -> Iterator[Any]:
        if self._finds_losses and self._losses.lost_before(bytes(packet)):
            self._broken = True
            self._stream.codec_context.flush_buffers()
        return iter(packet.decode())

    def _check_frame(self, frame: Any) -> GrabbedImage:
        self._broken = frame.is_corrupt or (self._broken and not frame.key_frame)
        if self._broken:
            return GrabbedImage(None, frame.time)
        return GrabbedImage(frame.to_ndarray(format="bgr24"), frame.time)


def _stamp_s(packet: Any) -> float | None:
    """Return the presentation time of PyAV's packet; None without."""
    return None if packet.pts is None else float(packet.pts * packet.time_base)
