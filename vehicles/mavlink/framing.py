"""Splits a byte stream into MAVLink frames, without decoding their messages.

Layout: https://mavlink.io/en/guide/serialization.html
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_MAGIC_V1 = 0xFE
_MAGIC_V2 = 0xFD
_SIGNED = 0x01
_SIGNATURE_BYTES = 13

# fastcrc's function, where it is installed; pymavlink's own wrapper takes three times as long.
_crc_in_c: Callable[[bytes, int], int] | None = getattr(mavlink, "mcrf4xx", None)
_new_tuple = tuple.__new__
"""Creates a named tuple from its fields in half the time of its constructor."""


class MavlinkFrame(NamedTuple):
    """A MAVLink frame: its bytes, and the fields of its header."""

    raw: bytes
    message_id: int
    system: int
    component: int
    seq: int
    version: int
    """1 or 2 of MAVLink."""
    signed: bool

    @property
    def payload(self) -> bytes:
        """Return the frame's payload as sent: trailing zeros may be missing."""
        start = 10 if self.version == 2 else 6
        return self.raw[start : start + self.raw[1]]


def frame_checksum(covered: bytes, extra: bytes) -> int:
    """Return a frame's checksum (CRC-16/MCRF4XX) with its message's extra byte."""
    if _crc_in_c is not None:
        return _crc_in_c(covered + extra, 0xFFFF)
    crc: int = mavlink.x25crc(covered + extra).crc
    return crc


def frame_header(raw: bytes) -> MavlinkFrame | None:
    """Return the frame that `raw` starts with, checksum not verified; None if it has none."""
    if len(raw) < 3:
        return None
    length = _frame_length(raw, 0)
    return _frame(raw, 0, length) if 0 < length <= len(raw) else None


def frame_with_payload(frame: MavlinkFrame, payload: bytes) -> bytes:
    """Return a frame of a known message with another payload, same sender, unsigned.

    payload: complete, with its trailing zeros. Raises KeyError for an unknown message.
    """
    raw, extra = frame.raw, _CRC_EXTRAS[frame.message_id]
    if frame.version == 2:
        payload = payload.rstrip(b"\0") or b"\0"
        body = bytes((len(payload), 0)) + raw[3:10] + payload
    else:
        body = bytes((len(payload),)) + raw[2:6] + payload
    return raw[:1] + body + frame_checksum(body, extra).to_bytes(2, "little")


class FrameSplitter:
    """Splits a byte stream into MAVLink frames; garbage is skipped and counted.

    Frames are recognised by their checksum, so that a start byte within garbage hides no frame.
    Frames of messages that the dialect does not know cannot be checked: they are accepted in
    MAVLink 2, from a system and component that sent a checked frame before, when they contain no
    checked frame and are followed by a frame or by nothing.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._known: set[tuple[int, int]] = set()
        self.bytes_seen = 0
        self.garbage_bytes = 0

    def feed(self, data: bytes) -> list[MavlinkFrame]:
        """Return the frames that are complete now, in order."""
        self.bytes_seen += len(data)
        if not self._rest:
            frames, senders = _nothing_but_frames(data)
            if frames:
                self._known |= senders
                return list(frames)
        return self._search(self._rest + data)

    def _search(self, buffer: bytes) -> list[MavlinkFrame]:
        """Return the frames among possible garbage; keep an incomplete last one."""
        frames: list[MavlinkFrame] = []
        at, end = 0, len(buffer)
        while end - at >= 3:
            length = _frame_length(buffer, at)
            if length and at + length > end:
                break
            frame = _frame(buffer, at, length) if length else None
            if frame is not None and self._is_frame(frame, buffer[at + length : at + length + 1]):
                frames.append(frame)
                at += length
            else:
                after = _next_magic(buffer, at + 1)
                self.garbage_bytes += after - at
                at = after
        self._rest = buffer[at:]
        return frames

    def _is_frame(self, frame: MavlinkFrame, following: bytes) -> bool:
        """Return whether this is a frame by checksum or, if unknown, by its place.

        following: the byte after it; empty when it is the last one.
        """
        sender = (frame.system, frame.component)
        if frame.message_id in _CRC_EXTRAS:
            is_sound = _is_sound(frame)
            if is_sound:
                self._known.add(sender)
            return is_sound
        return (
            frame.version == 2
            and sender in self._known
            and (not following or following[0] in (_MAGIC_V1, _MAGIC_V2))
            and not _holds_frame(frame.raw)
        )


@lru_cache(maxsize=16)
def _nothing_but_frames(data: bytes) -> tuple[tuple[MavlinkFrame, ...], frozenset[tuple[int, int]]]:
    """Return the frames that bytes consist of, and their senders; none if garbage.

    Cached: bytes that pass a guard in the same process are split there and again at the receiver.
    """
    frames: list[MavlinkFrame] = []
    at, end = 0, len(data)
    while at < end:
        frame = _sound_frame(data, at, end)
        if frame is None:
            return (), frozenset()
        frames.append(frame)
        at += len(frame.raw)
    return tuple(frames), frozenset([(frame.system, frame.component) for frame in frames])


def _sound_frame(buffer: bytes, at: int, end: int) -> MavlinkFrame | None:
    """Return the frame with a valid checksum that starts here; None when there is none."""
    if end - at < 12 or buffer[at] != _MAGIC_V2 or buffer[at + 2]:
        return _rare_frame(buffer, at, end)
    # Nearly all frames are of this kind, and every process of a flight reads hundreds a second:
    # inlined, this takes half the time of the functions below.
    tail = at + 10 + buffer[at + 1]
    if tail + 2 > end:
        return None
    message_id = buffer[at + 7] | buffer[at + 8] << 8 | buffer[at + 9] << 16
    extra = _CRC_EXTRAS.get(message_id)
    if extra is None:
        return None
    if frame_checksum(buffer[at + 1 : tail], extra) != buffer[tail] | buffer[tail + 1] << 8:
        return None
    raw = buffer if at == 0 and tail + 2 == end else buffer[at : tail + 2]
    head = (raw, message_id, buffer[at + 5], buffer[at + 6], buffer[at + 4], 2, False)
    return _new_tuple(MavlinkFrame, head)


def _rare_frame(buffer: bytes, at: int, end: int) -> MavlinkFrame | None:
    """Return a valid frame of MAVLink 1, or a signed one, that starts here; or None."""
    length = _frame_length(buffer, at) if end - at >= 3 else 0
    if not 0 < length <= end - at:
        return None
    frame = _frame(buffer, at, length)
    return frame if _is_sound(frame) else None


def _is_sound(frame: MavlinkFrame) -> bool:
    """Return whether a frame's checksum is valid; False when it cannot be checked."""
    extra = _CRC_EXTRAS.get(frame.message_id)
    if extra is None:
        return False
    raw = frame.raw
    tail = len(raw) - (2 + _SIGNATURE_BYTES if frame.signed else 2)
    return frame_checksum(raw[1:tail], extra) == raw[tail] | raw[tail + 1] << 8


def _holds_frame(raw: bytes) -> bool:
    """Return whether these bytes, after the first, contain a frame with a valid checksum."""
    at, end = _next_magic(raw, 1), len(raw)
    while end - at >= 3:
        length = _frame_length(raw, at)
        if 0 < length <= end - at and _is_sound(_frame(raw, at, length)):
            return True
        at = _next_magic(raw, at + 1)
    return False


def _frame_length(buffer: bytes, at: int) -> int:
    """Return a frame's length by its header; 0 when none starts here."""
    magic = buffer[at]
    if magic == _MAGIC_V2:
        flags = buffer[at + 2]
        if flags & ~_SIGNED:
            return 0
        return 12 + buffer[at + 1] + (_SIGNATURE_BYTES if flags else 0)
    if magic == _MAGIC_V1:
        return 8 + buffer[at + 1]
    return 0


def _frame(buffer: bytes, at: int, length: int) -> MavlinkFrame:
    raw = buffer if at == 0 and length == len(buffer) else buffer[at : at + length]
    if raw[0] == _MAGIC_V2:
        message_id = raw[7] | raw[8] << 8 | raw[9] << 16
        return MavlinkFrame(raw, message_id, raw[5], raw[6], raw[4], 2, raw[2] != 0)
    return MavlinkFrame(raw, raw[5], raw[3], raw[4], raw[2], 1, signed=False)


def _next_magic(buffer: bytes, start: int) -> int:
    """Return the index of the next byte that may start a frame."""
    places = (buffer.find(_MAGIC_V2, start), buffer.find(_MAGIC_V1, start))
    return min((at for at in places if at >= 0), default=len(buffer))


_CRC_EXTRAS: dict[int, bytes] = {
    number: bytes([kind.crc_extra]) for number, kind in mavlink.mavlink_map.items()
}
