"""Decoders of the compressed image messages in MCAP files; pure.

foxglove.CompressedImage (protobuf or JSON): https://docs.foxglove.dev/docs/sdk/schemas. Protobuf
wire format: https://protobuf.dev/programming-guides/encoding. sensor_msgs/CompressedImage of
ROS 1, and of ROS 2 in CDR (DDS-RTPS 2.3, 10.2).
"""

import base64
import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from wil_campaign.plugins.readings.messagepack import BadMessageError, MessageHeader

Decode = Callable[[bytes], "CompressedImage"]


@dataclass(frozen=True, slots=True)
class CompressedImage:
    """A compressed image. stamp_s: since 1970, None if unset. format: "jpeg", "png", ..."""

    stamp_s: float | None
    format: str
    data: bytes


def decoder_for(schema: str, encoding: str) -> Decode | None:
    """Return the decoder of compressed image messages; None for other messages."""
    return _DECODERS.get((schema, encoding))


def _guard_decoder(decode: Decode) -> Decode:
    def guarded(message: bytes) -> CompressedImage:
        try:
            return decode(message)
        except (ValueError, KeyError, IndexError, RecursionError, struct.error) as error:
            raise BadMessageError(f"is not a compressed image: {error}") from error

    return guarded


def _protobuf(message: bytes) -> CompressedImage:
    """Decode a compressed image in protobuf (Foxglove)."""
    fields = _fields(message)
    stamp = _fields(_as_bytes(fields.get(1, b"")))
    seconds, nanoseconds = stamp.get(1, 0), stamp.get(2, 0)
    if not isinstance(seconds, int) or not isinstance(nanoseconds, int):
        raise BadMessageError("its stamp is not two numbers")
    return CompressedImage(
        _stamp(seconds, nanoseconds),
        _as_bytes(fields.get(3, b"")).decode(),
        _as_bytes(fields.get(2, b"")),
    )


def _json(message: bytes) -> CompressedImage:
    """Decode a compressed image in JSON (Foxglove)."""
    header = MessageHeader.of(json.loads(message))
    seconds = nanoseconds = 0
    if "timestamp" in header:
        stamp = header.header("timestamp")
        seconds, nanoseconds = stamp.whole("sec"), stamp.whole("nsec")
    data = base64.b64decode(header.text("data"), validate=True)
    return CompressedImage(_stamp(seconds, nanoseconds), header.text("format"), data)


def _ros1(message: bytes) -> CompressedImage:
    """Decode a compressed image in ROS 1 serialisation."""
    _, seconds, nanoseconds, length = struct.unpack_from("<IIII", message)
    name, at = _read_counted(message, 16 + length)
    data, _ = _read_counted(message, at)
    return CompressedImage(_stamp(seconds, nanoseconds), name.decode(), data)


def _ros2(message: bytes) -> CompressedImage:
    """Decode a compressed image in ROS 2 serialisation (CDR)."""
    order = "<" if message[1] & 1 else ">"
    body = message[4:]
    seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", body)
    name, at = _read_counted(body, _align(12 + length), order)
    data, _ = _read_counted(body, _align(at), order)
    return CompressedImage(_stamp(seconds, nanoseconds), name.rstrip(b"\0").decode(), data)


def _read_counted(message: bytes, at: int, order: str = "<") -> tuple[bytes, int]:
    """Return counted bytes of a compressed image message, and their end."""
    (length,) = struct.unpack_from(f"{order}I", message, at)
    end = at + 4 + length
    if end > len(message):
        raise BadMessageError(f"it ends {end - len(message)} bytes too early")
    return message[at + 4 : end], end


def _align(at: int) -> int:
    """Return a CDR offset aligned to 4 bytes, in a compressed image message."""
    return (at + 3) & ~3


def _stamp(seconds: int, nanoseconds: int) -> float | None:
    """Return a compressed image's stamp in seconds; None when it is zero."""
    return seconds + nanoseconds * 1e-9 if seconds or nanoseconds else None


def _fields(message: bytes) -> Mapping[int, int | bytes]:
    """Return the last value of each protobuf field: a number or bytes."""
    found: dict[int, int | bytes] = {}
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        kind = key & 7
        if kind == 0:
            found[key >> 3], at = _varint(message, at)
            continue
        length, at = _varint(message, at) if kind == 2 else ({1: 8, 5: 4}[kind], at)
        if at + length > len(message):
            raise BadMessageError("it ends too early")
        found[key >> 3], at = message[at : at + length], at + length
    return found


def _varint(message: bytes, at: int) -> tuple[int, int]:
    value, shift = 0, 0
    while shift < 70:
        byte = message[at]
        value |= (byte & 0x7F) << shift
        at += 1
        if byte < 0x80:
            return value, at
        shift += 7
    raise BadMessageError("a number in it does not end")


def _as_bytes(value: int | bytes) -> bytes:
    """Return a protobuf value as bytes. Raises BadMessageError for a number."""
    if isinstance(value, int):
        raise BadMessageError("there is a number where bytes are expected")
    return value


_DECODERS: Mapping[tuple[str, str], Decode] = {
    ("foxglove.CompressedImage", "protobuf"): _guard_decoder(_protobuf),
    ("foxglove.CompressedImage", "json"): _guard_decoder(_json),
    ("sensor_msgs/CompressedImage", "ros1"): _guard_decoder(_ros1),
    ("sensor_msgs/msg/CompressedImage", "cdr"): _guard_decoder(_ros2),
}
