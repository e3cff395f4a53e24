"""Reads MessagePack headers of other programs key by key, and checks every value; pure."""

import math
from collections.abc import Mapping
from typing import Any

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np
from numpy.typing import NDArray

MAX_HEADER_BYTES = 65_536


class BadMessageError(ValueError):
    """A message that breaks its protocol; names the key and what is wrong with it."""


class MessageHeader:
    """A MessagePack message's header map, with a reader for each kind of value.

    Every reader raises BadMessageError when the key is missing or its value is of another kind.
    Unknown keys are ignored: a later version of a protocol may add some.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = values

    @classmethod
    def unpack(
        cls, data: bytes | memoryview, *, most_bytes: int = MAX_HEADER_BYTES
    ) -> "MessageHeader":
        """Return the header in MessagePack bytes. Raises BadMessageError."""
        if len(data) > most_bytes:
            raise BadMessageError(f"the header has {len(data)} bytes, more than {most_bytes}")
        try:
            values = msgpack.unpackb(data, raw=False, strict_map_key=True)
        except (ValueError, TypeError, RecursionError) as error:
            raise BadMessageError(f"the header is not MessagePack: {error}") from error
        return cls.of(values)

    @classmethod
    def of(cls, values: object) -> "MessageHeader":
        """Return the header of a decoded value. Raises BadMessageError unless it is a map."""
        if not isinstance(values, dict):
            raise BadMessageError(f"the header is not a map but {type(values).__name__}")
        return cls(values)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the keys."""
        return tuple(map(str, self._values))

    def __contains__(self, key: str) -> bool:
        return self._values.get(key) is not None

    def text(self, key: str) -> str:
        """Return a string of the header."""
        value = self._get(key)
        if not isinstance(value, str):
            raise self._wrong(key, "text")
        return value

    def whole(self, key: str, *, low: int = 0, high: int = 2**63 - 1) -> int:
        """Return an integer of the header within limits."""
        value = self._get(key)
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise self._wrong(key, f"a whole number from {low} to {high}")
        return value

    def flag(self, key: str, *, default: bool) -> bool:
        """Return a boolean of the header; `default` when the key is missing."""
        value = self._values.get(key, default)
        if not isinstance(value, bool):
            raise self._wrong(key, "true or false")
        return value

    def number(self, key: str) -> float:
        """Return a finite number of the header."""
        value = _finite(self._get(key))
        if value is None:
            raise self._wrong(key, "a finite number")
        return value

    def numbers(self, key: str, count: int | None) -> tuple[float, ...]:
        """Return `count` finite numbers of the header; None: any count up to 64."""
        value = self._get(key)
        wanted = f"{count if count is not None else 'some'} finite numbers"
        if not isinstance(value, list | tuple) or len(value) > 64:
            raise self._wrong(key, wanted)
        numbers = tuple(number for each in value if (number := _finite(each)) is not None)
        if len(numbers) != len(value) or (count is not None and len(numbers) != count):
            raise self._wrong(key, wanted)
        return numbers

    def array(self, key: str, dtype: np.dtype[Any], *, most: int) -> NDArray[Any]:
        """Return an array of the header, of at most so many elements.

        It is in bytes of that type, little-endian, or a list of numbers; null is infinity in one
        of floats.
        """
        value = self._get(key)
        if isinstance(value, bytes):
            if len(value) % dtype.itemsize or len(value) > most * dtype.itemsize:
                raise self._wrong(key, f"at most {most} elements of {dtype.itemsize} bytes")
            return np.frombuffer(value, dtype)
        wanted = f"bytes, or a list of at most {most} numbers"
        if not isinstance(value, list | tuple) or len(value) > most:
            raise self._wrong(key, wanted)
        if dtype.kind != "f":
            return self._whole_numbers(key, value, dtype)
        numbers = [math.inf if each is None else _finite(each) for each in value]
        if any(number is None for number in numbers):
            raise self._wrong(key, wanted)
        return np.array(numbers, np.float64).astype(dtype)

    def _whole_numbers(self, key: str, value: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return a list of whole numbers that fit a type. Raises BadMessageError."""
        limits = np.iinfo(dtype)
        whole = all(isinstance(each, int) and limits.min <= each <= limits.max for each in value)
        if not whole:
            raise self._wrong(key, f"whole numbers from {limits.min} to {limits.max}")
        return np.array(value, dtype)

    def headers(self, key: str) -> tuple["MessageHeader", ...]:
        """Return a list of maps in the header."""
        value = self._get(key)
        if not isinstance(value, list | tuple):
            raise self._wrong(key, "a list of maps")
        return tuple(MessageHeader.of(each) for each in value)

    def header(self, key: str) -> "MessageHeader":
        """Return a map in the header."""
        return MessageHeader.of(self._get(key))

    def table(self, key: str) -> dict[str, float]:
        """Return a map of names to finite numbers in the header."""
        value = self._get(key)
        if not isinstance(value, dict):
            raise self._wrong(key, "a map")
        inside = MessageHeader(value)
        return {str(name): inside.number(name) for name in value}

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of strings in the header."""
        value = self._get(key)
        if not isinstance(value, list | tuple) or not all(isinstance(x, str) for x in value):
            raise self._wrong(key, "a list of texts")
        return tuple(value)

    def _get(self, key: str) -> Any:
        """Return the header's value of a key. Raises BadMessageError when it is missing."""
        if key not in self._values:
            raise BadMessageError(f"`{key}` is missing in the header")
        return self._values[key]

    def _wrong(self, key: str, wanted: str) -> BadMessageError:
        return BadMessageError(f"`{key}` must be {wanted}, is {self._values.get(key)!r:.80}")


def pack_header(values: Mapping[str, Any]) -> bytes:
    """Return a header as MessagePack."""
    packed: bytes = msgpack.packb(values, use_bin_type=True)
    return packed


def _finite(value: object) -> float | None:
    """Return a header's value as a finite float; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
