"""Gets pictures from whatever FFmpeg opens, and keeps back those that lost data damaged."""

import io
import time
from collections.abc import Iterator
from typing import Any

import av

from vehicles.sources.camera_source import SourceError
from vehicles.sources.cameras.av_input import (
    AvInput,
    no_key_frame,
    nothing_came,
    opening_error,
    shown,
)
from vehicles.sources.cameras.h264_loss import LossFinder
from vehicles.sources.cameras.live_camera import Grabbed

_READ_TIMEOUT_S = 0.2
"""So often a thread that waits for data looks whether it is to stop."""


class AvGrabber:
    """A Grabber of camera images by PyAV: RTSP, RTP and V4L2.

    After lost or broken data every picture is held back until the next key picture, since a
    decoder goes on from wrong ones without a word. Who joins a stream waits for its first key
    picture too: what came before it is neither handed on nor counted as damaged.
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
        self._first: Grabbed | None = None

    def open(self) -> None:
        """Open PyAV's address and wait for its first image. Raises SourceError."""
        deadline_s = time.monotonic() + self._open_timeout_s
        self._open_stream(deadline_s)
        joined_late = False
        while self._first is None:
            grabbed = self._next()
            joined_late = joined_late or grabbed is not None
            if grabbed is not None and grabbed.image_bgr is not None:
                self._first = grabbed
            elif time.monotonic() > deadline_s:
                raise (no_key_frame if joined_late else nothing_came)(self._source.url)

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
            # A wait that was broken off shows in many ways, as broken data too.
            if time.monotonic() >= deadline_s:
                raise nothing_came(source.url) from error
            raise opening_error(source.url, error) from error
        if not self._container.streams.video:
            raise SourceError(f"{shown(source.url)}: has no video")
        self._stream = self._container.streams.video[0]
        # More threads decode more pictures at once, each of them later.
        self._stream.codec_context.thread_count = 1
        on_network = source.kind in {"rtp", "rtsp"}
        self._finds_losses = on_network and self._stream.codec_context.name == "h264"
        extradata = self._stream.codec_context.extradata
        if self._finds_losses and extradata:
            self._losses.lost_before(bytes(extradata))

    def grab(self) -> Grabbed | None:
        """Return PyAV's next image; None when none came for a moment. Raises SourceError."""
        first, self._first = self._first, None
        return first or self._next()

    def close(self) -> None:
        """Close PyAV's stream or device."""
        if self._container is not None:
            self._container.close()

    def _next(self) -> Grabbed | None:
        frame = next(self._frames, None)
        if frame is not None:
            return self._check_frame(frame)
        packet = self._packet()
        if packet is None:
            return None
        try:
            self._frames = self._decode_packet(packet)
        except av.error.InvalidDataError:
            self._broken = True
        frame = next(self._frames, None)
        if frame is not None:
            return self._check_frame(frame)
        # A decoder without its references gives nothing; a sound one may only be gathering.
        return Grabbed(None, _stamp_s(packet)) if self._broken else None

    def _packet(self) -> Any | None:
        if self._packets is None:
            self._packets = self._container.demux(self._stream)
        try:
            packet = next(self._packets, None)
        except (av.error.ExitError, av.error.BlockingIOError):
            self._packets = None
            return None
        except av.error.FFmpegError as error:
            raise SourceError(
                f"{shown(self._source.url)}: was lost: {error.strerror}; check cable and network"
            ) from error
        if packet is None or packet.size == 0:
            raise SourceError(
                f"{shown(self._source.url)}: has ended; whoever sends it closed the stream"
            )
        return packet

    def _decode_packet(self, packet: Any) -> Iterator[Any]:
        if self._finds_losses and self._losses.lost_before(bytes(packet)):
            self._broken = True
            self._stream.codec_context.flush_buffers()
        return iter(packet.decode())

    def _check_frame(self, frame: Any) -> Grabbed:
        self._broken = frame.is_corrupt or (self._broken and not frame.key_frame)
        if self._broken:
            return Grabbed(None, frame.time)
        return Grabbed(frame.to_ndarray(format="bgr24"), frame.time)


def _stamp_s(packet: Any) -> float | None:
    """Return the presentation time of PyAV's packet; None without."""
    return None if packet.pts is None else float(packet.pts * packet.time_base)
