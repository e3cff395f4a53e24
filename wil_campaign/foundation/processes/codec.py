"""MessagePack codec of the typed messages between this program's processes."""

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Generic, TypeVar

import msgspec
import numpy as np

Finite = Annotated[float, msgspec.Meta(ge=-1e300, le=1e300)]
"""A number that is neither NaN nor infinite."""
LONGEST_FRAME_BYTES = 16 << 20
_LENGTH_BYTES = 4


class ProcessMessage(msgspec.Struct, frozen=True, array_like=True, tag=True):
    """The base of messages between our own processes; each kind is a subclass."""


Value = TypeVar("Value")
Plain = Mapping[type, tuple[Callable[[Any], object], Callable[[Any], object]]]
"""For types that are not data classes: the conversions to and from plain values."""


class ProcessMessageError(ValueError):
    """Bytes from another process are not an expected message; says why."""


class MessageCodec(Generic[Value]):
    """The codec of messages between processes: one type, a union of messages or a data class."""

    def __init__(self, kind: Any, *, plain: Plain | None = None) -> None:
        self._plain = dict(plain or {})
        self._encoder = msgspec.msgpack.Encoder(enc_hook=self._to_plain)
        self._decoder: msgspec.msgpack.Decoder[Value] = msgspec.msgpack.Decoder(
            kind, dec_hook=self._from_plain
        )

    def encode(self, value: Any) -> bytes:
        """Return a message's bytes."""
        return self._encoder.encode(value)

    def decode(self, packet: bytes | memoryview) -> Value:
        """Return the message in bytes. Raises MessageError."""
        try:
            return self._decoder.decode(packet)
        except (msgspec.MsgspecError, ValueError, TypeError, KeyError, RecursionError) as error:
            raise ProcessMessageError(f"{len(packet)} bytes cannot be read: {error}") from error

    def _to_plain(self, value: object) -> object:
        if isinstance(value, np.generic):
            return value.item()
        for kind, (to_plain, _) in self._plain.items():
            if isinstance(value, kind):
                return to_plain(value)
        raise NotImplementedError(f"{type(value).__name__} cannot be sent")

    def _from_plain(self, kind: type, value: object) -> object:
        return self._plain[kind][1](value)


def framed_packet(packet: bytes) -> bytes:
    """Return an encoded packet with its length before it, for a stream of bytes."""
    return len(packet).to_bytes(_LENGTH_BYTES, "little") + packet


class FrameReader:
    """Splits a stream of bytes into encoded packets."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield the packets that are whole now. Raises MessageError for an excessive length."""
        self._rest += data
        while len(self._rest) >= _LENGTH_BYTES:
            length = int.from_bytes(self._rest[:_LENGTH_BYTES], "little")
            if length > LONGEST_FRAME_BYTES:
                raise ProcessMessageError(f"a packet of {length} bytes is too long")
            end = _LENGTH_BYTES + length
            if len(self._rest) < end:
                return
            packet, self._rest = self._rest[_LENGTH_BYTES:end], self._rest[end:]
            yield packet
