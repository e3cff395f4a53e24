"""Depth images in RTP: uncompressed, 16 bits a pixel, millimetres. Wall clock only.

RFC 3550 (the header of a packet) and RFC 4175 (lines of uncompressed video). No codec that FFmpeg
carries in RTP has 16 bits, and its own reader of such lines counts none (read in its source, not
tried): a lost line would show a distance of an image before. What is read here is complete.
"""

import re
import socket
import struct
from collections import deque

import numpy as np

from wil_campaign.plugins.depth_cameras.depth_grabber import (
    GrabbedDepth,
    GrabbedReadings,
    depth_camera_of_request,
)
from wil_campaign.plugins.readings.depth_images import metres_of_depths
from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.source_request import SourceRequest

_CLOCK_HZ = 90_000
_OVERTAKEN = _CLOCK_HZ
"""A packet whose stamp is a second before the newest was not overtaken: its sender restarted."""
_KNOWN = 128
"""So many images of the past are known: their late packets were counted with them."""
_WAIT_S = 0.2
"""How often a thread that waits for a packet checks whether it has to stop."""
_BUFFER_BYTES = 4 * 2**20
_REMEDY = (
    "nothing arrived; let the sender send raw video by RFC 4175 to this port, two bytes a pixel "
    "(millimetres, the higher byte first)"
)


class DepthLines:
    """Puts the lines of depth images together; pure.

    width_px, height_px: of each image. rate_hz: of images, to count those that never arrived by the
    gaps in the stamps; None when it varies.
    """

    def __init__(self, *, width_px: int, height_px: int, rate_hz: float | None = None) -> None:
        self._size = (height_px, width_px)
        self._rate_hz = rate_hz
        self._skipped = 0
        self._pixels = np.zeros(self._size, ">u2")
        self._there = np.zeros(self._size, np.bool_)
        self._sender: int | None = None
        self._stamp = 0
        self._stamp_s = 0.0
        self._begun: deque[int] = deque(maxlen=_KNOWN)
        self._is_open = False

    def receive(self, packet: bytes) -> GrabbedDepth | None:
        """Take a packet; return the image that it completes, or ends incomplete."""
        try:
            sender, stamp, is_last, payload = _rtp(packet)
            if sender == self._sender and -_OVERTAKEN <= self._ahead(stamp) < 0:
                return self._late_packet(stamp)
            lost = self._next_image(sender, stamp)
            self._add_lines(payload)
        except (ValueError, struct.error) as error:
            self._is_open = False
            return GrabbedDepth(None, why=str(error))
        if is_last and self._is_open:
            return self._end_image()
        return lost

    def _ahead(self, stamp: int) -> int:
        """Return by how many ticks a stamp is after that of the newest image; it wraps."""
        return (stamp - self._stamp + 2**31) % 2**32 - 2**31

    def _late_packet(self, stamp: int) -> GrabbedDepth | None:
        """Count an image all of whose packets were overtaken, unless the gap there was counted.

        Others were counted as lost lines.
        """
        if stamp in self._begun or self._rate_hz is not None:
            return None
        self._begun.append(stamp)
        return GrabbedDepth(None, why="its packets arrived after those of a later image")

    def _next_image(self, sender: int, stamp: int) -> GrabbedDepth | None:
        """Begin an image when its stamp is new; return the one before where its end was lost."""
        ahead = self._ahead(stamp)
        goes_on = sender == self._sender and ahead >= 0
        if goes_on and not ahead:
            return None
        before = self._end_image() if self._is_open else None
        self._there[:] = False
        if goes_on:
            self._stamp_s += ahead / _CLOCK_HZ
            self._skipped += max(0, round(ahead / _CLOCK_HZ * (self._rate_hz or 0.0)) - 1)
        else:  # it restarted
            self._stamp_s = stamp / _CLOCK_HZ
            self._begun.clear()
            self._skipped = 0
        self._sender, self._stamp, self._is_open = sender, stamp, True
        self._begun.append(stamp)
        return before

    def _end_image(self) -> GrabbedDepth:
        self._is_open = False
        there = int(np.count_nonzero(self._there))
        if there < self._there.size:
            height_px, width_px = self._size
            why = (
                f"{there} of {self._there.size} pixels of an image arrived: packets were lost, or "
                f"the sender's images are smaller than {width_px}x{height_px}"
            )
            return GrabbedDepth(None, why=why)
        skipped, self._skipped = self._skipped, 0
        return GrabbedDepth(metres_of_depths(self._pixels), self._stamp_s, skipped)

    def _add_lines(self, payload: bytes) -> None:
        at, lines, more = 2, [], True  # after the high half of the sequence number
        while more:
            length, line, offset = struct.unpack_from(">HHH", payload, at)
            lines.append((length // 2, line, offset & 0x7FFF))
            more, at = bool(offset & 0x8000), at + 6
        height_px, width_px = self._size
        for count, line, first in lines:
            if line & 0x8000:
                raise BadMessageError(
                    "it is interlaced: send progressive video (FFmpeg: field_order)"
                )
            if line >= height_px or first + count > width_px:
                raise BadMessageError(
                    f"line {line} has pixels up to {first + count}, and the sensor of the campaign "
                    f"has {width_px}x{height_px}: set one to the other"
                )
            values = np.frombuffer(payload, ">u2", count, at) if count else ()
            self._pixels[line, first : first + count] = values
            self._there[line, first : first + count] = True
            at += 2 * count


def _rtp(packet: bytes) -> tuple[int, int, bool, bytes]:
    """Return a packet's sender and time stamp, whether it ends an image, and its payload."""
    first, second, _, stamp, sender = struct.unpack_from(">BBHII", packet)
    if first >> 6 != 2:
        raise BadMessageError("it is no packet of RTP")
    at = 12 + 4 * (first & 0x0F)
    if first & 0x10:
        at += 4 + 4 * struct.unpack_from(">H", packet, at + 2)[0]
    end = len(packet) - (packet[-1] if first & 0x20 else 0)
    return sender, stamp, bool(second & 0x80), packet[at:end]


class RtpDepth:
    """A DepthGrabber that listens on a port of this machine."""

    def __init__(self, request: SourceRequest) -> None:
        camera, self._address = depth_camera_of_request(request), request.address
        self._lines = DepthLines(
            width_px=camera.width_px, height_px=camera.height_px, rate_hz=request.rate_hz
        )
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Bind the port. Raises SourceError."""
        host, _, port = self._address.removeprefix("rtp://").rstrip("/").rpartition(":")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        self._socket.settimeout(_WAIT_S)
        try:
            self._socket.bind((host, int(port)))
        except OSError as error:
            raise SourceError(
                f"{self._address}: cannot listen there: {error.strerror}; name an address of this "
                "machine (0.0.0.0 for all), and a port that no other program has"
            ) from error

    def grab(self) -> GrabbedDepth | None:
        """Return the next image; None where the next packet completes none. Raises OSError."""
        if self._socket is None:
            return None
        try:
            return self._lines.receive(self._socket.recv(65_536))
        except TimeoutError:
            return None

    def close(self) -> None:
        """Close the port."""
        if self._socket is not None:
            self._socket.close()


def open_rtp_depth(request: SourceRequest) -> GrabbedReadings:
    """Return the depth images that arrive at a port."""
    return GrabbedReadings(request=request, grabber=RtpDepth(request), remedy=_REMEDY)


def rtp_depth_fault(address: str, kind: str) -> str:
    """Return what is wrong with an address, or with a sensor that has it; "" for nothing."""
    if kind != "depth":
        return f"RTP has depth images here, and the sensor is a {kind}: use tcp:// or an MCAP file"
    match = re.fullmatch(r"rtp://[^:/@\s]+:(\d{1,5})/?", address)
    if match is None or not 0 < int(match[1]) < 65536:
        return f"'{address}' is not rtp://HOST:PORT, as in rtp://0.0.0.0:5600"
    return ""
