"""Grabs images from any input that FFmpeg opens, and holds back those damaged by lost data.

Detects lost H.264 frames by their frame numbers; pure.

A decoder that misses a whole frame continues from the one before without an error: all that
follows looks right and is wrong until the next key frame. Every reference frame carries
frame_num, one more than that of the reference frame before it, modulo a power of two.

ITU-T H.264: 7.3.1 (emulation prevention), 7.3.2.1.1 (sequence parameters), 7.3.3 (slice header),
7.4.3 (frame_num), 9.1 (Exp-Golomb codes), Annex B (start codes).
"""

import io
import time
from collections.abc import Callable, Iterator
from typing import Any

import av

from wil_campaign.foundation.files.problems import without_passwords
from wil_campaign.plugins.cameras.av_input import (
    EXPLODE,
    AvInput,
    all_damaged_error,
    grey_bits_fault,
    no_image_error,
    no_key_frame_error,
    opening_error,
)
from wil_campaign.plugins.cameras.live_camera import GrabbedImage
from wil_campaign.vehicles.sources.camera_source import SourceError

_SLICE, _IDR, _SPS = 1, 5, 7
_ALONE = frozenset({"mjpeg", "rawvideo"})
"""Codecs each of whose images is coded alone."""
_WITH_CHROMA = frozenset({100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135})
_HEADER_BYTES = 64
"""Enough of a unit for all fields that are read, but for scaling lists, which are rare."""


class LossFinder:
    """Finds lost H.264 reference frames in one stream's access units."""

    def __init__(self) -> None:
        self._frame_num_bits: int | None = None
        self._separate_planes = False
        self._previous: int | None = None

    def lost_before(self, access_unit: bytes) -> bool:
        """Return whether an H.264 frame that this one may build on was lost.

        access_unit: a whole frame with start codes (Annex B). False for one that cannot be read.
        """
        for unit in _units(access_unit):
            kind = unit[0] & 0x1F
            try:
                if kind == _SPS:
                    self._take_parameters(unit)
                elif kind in {_SLICE, _IDR}:
                    return self._slice_after_loss(unit, is_key=kind == _IDR)
            except _EndError:
                continue
        return False

    def _take_parameters(self, unit: bytes) -> None:
        bits = _Bits(_unescape(unit[1 : 4 * _HEADER_BYTES]))
        profile = bits.number(8)
        bits.number(16)
        bits.golomb()
        self._separate_planes = False
        if profile in _WITH_CHROMA:
            self._separate_planes = _skip_chroma(bits)
        self._frame_num_bits = bits.golomb() + 4

    def _slice_after_loss(self, unit: bytes, *, is_key: bool) -> bool:
        if self._frame_num_bits is None:
            return False
        bits = _Bits(_unescape(unit[1:_HEADER_BYTES]))
        for _ in range(3):  # first_mb_in_slice, slice_type, pic_parameter_set_id
            bits.golomb()
        if self._separate_planes:
            bits.number(2)
        frame_num = bits.number(self._frame_num_bits)
        previous = self._previous
        if unit[0] & 0x60:  # nal_ref_idc: others may build on this one
            self._previous = frame_num
        if is_key or previous is None:
            return False
        return frame_num not in {previous, (previous + 1) % (1 << self._frame_num_bits)}


class _EndError(Exception):
    """The H.264 data ended within a number."""


class _Bits:
    """The bits of an H.264 unit."""

    def __init__(self, data: bytes) -> None:
        self._value = int.from_bytes(data, "big")
        self._left = 8 * len(data)

    def number(self, count: int) -> int:
        """Return the next bits of the H.264 unit as an unsigned number."""
        if count > self._left:
            raise _EndError
        self._left -= count
        return self._value >> self._left & ((1 << count) - 1)

    def golomb(self) -> int:
        """Return the next unsigned Exp-Golomb code of the H.264 unit."""
        zeros = 0
        while not self.number(1):
            zeros += 1
            if zeros > 32:
                raise _EndError
        return (1 << zeros) - 1 + self.number(zeros)


def _skip_chroma(bits: _Bits) -> bool:
    """Skip H.264's high-profile fields before frame_num; return separate_colour_planes."""
    chroma = bits.golomb()
    separate = chroma == 3 and bits.number(1) == 1
    bits.golomb()
    bits.golomb()
    bits.number(1)
    if bits.number(1):
        for k in range(12 if chroma == 3 else 8):
            if bits.number(1):
                _skip_scaling_list(bits, 16 if k < 6 else 64)
    return separate


def _skip_scaling_list(bits: _Bits, size: int) -> None:
    last, following = 8, 8
    for _ in range(size):
        if following:
            code = bits.golomb()
            delta = (code + 1) // 2 if code % 2 else -(code // 2)
            following = (last + delta) % 256
        last = following or last


def _units(data: bytes) -> Iterator[bytes]:
    """Return the H.264 units between start codes; a unit has one byte or more."""
    start = data.find(b"\x00\x00\x01")
    while start >= 0:
        start += 3
        end = data.find(b"\x00\x00\x01", start)
        unit = data[start:end] if end >= 0 else data[start:]
        if unit:
            yield unit
        start = end


def _unescape(data: bytes) -> bytes:
    """Return an H.264 unit without emulation prevention bytes."""
    return data.replace(b"\x00\x00\x03", b"\x00\x00")


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

    stall_timeout_s: how long the reader waits for an image.
    """

    def __init__(
        self, *, source: AvInput, open_timeout_s: float = 5.0, stall_timeout_s: float = 0.0
    ) -> None:
        self._source = source
        self._open_timeout_s = open_timeout_s
        # A wait that is given up within a packet of RTSP over TCP leaves FFmpeg between the bytes
        # of that packet, where it finds no other.
        is_tcp = source.options.get("rtsp_transport") == "tcp"
        self._read_timeout_s = max(_READ_TIMEOUT_S, stall_timeout_s if is_tcp else 0.0)
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
                raise self._late_error(joined_late=joined_late)(self._source.url)

    def _late_error(self, *, joined_late: bool) -> Callable[[str], SourceError]:
        if not joined_late:
            return no_image_error
        is_alone = self._stream.codec_context.name in _ALONE
        return all_damaged_error if is_alone else no_key_frame_error

    def _open_stream(self, deadline_s: float) -> None:
        source = self._source
        session = source.session()
        try:
            self._container = av.open(
                io.BytesIO(session.encode()) if session is not None else source.url,
                format=source.format,
                options={} if source.kind == "v4l2" else dict(source.options),
                # PyAV gives `options` to the decoder too, which would take the size asked of a
                # device for the one that it sends.
                container_options=dict(source.options) if source.kind == "v4l2" else {},
                timeout=(self._open_timeout_s, self._read_timeout_s),
            )
        except (av.error.FFmpegError, OSError, ValueError) as error:
            # An interrupted wait shows as any of many errors, among them invalid data.
            if time.monotonic() >= deadline_s:
                raise no_image_error(source.url) from error
            raise opening_error(source.url, error) from error
        if not self._container.streams.video:
            raise SourceError(f"{without_passwords(source.url)}: has no video")
        self._stream = self._container.streams.video[0]
        # With more threads several frames are decoded at once, and each is later.
        self._stream.codec_context.thread_count = 1
        if self._stream.codec_context.name == "mjpeg":
            # Else a JPEG that was cut off shows the image before in its lower part.
            self._stream.codec_context.options = EXPLODE
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
        if packet.size == 0:  # V4L2's way to tell of a damaged or cut off buffer
            return GrabbedImage(None, _stamp_s(packet))
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
                f"{without_passwords(self._source.url)}: the stream was lost: {error.strerror}; "
                "check cable and network"
            ) from error
        if packet is None or (packet.size == 0 and packet.pts is None):
            raise SourceError(
                f"{without_passwords(self._source.url)}: the stream has ended: its sender closed it"
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
        if why := grey_bits_fault(frame.format):
            raise SourceError(f"{without_passwords(self._source.url)}: {why}")
        return GrabbedImage(frame.to_ndarray(format="bgr24"), frame.time)


def _stamp_s(packet: Any) -> float | None:
    """Return the presentation time of PyAV's packet; None without."""
    return None if packet.pts is None else float(packet.pts * packet.time_base)
