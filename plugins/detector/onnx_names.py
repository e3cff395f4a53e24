"""The names of the classes that an ONNX file itself states, as exports of Ultralytics do.

They are in its metadata: `metadata_props` of ModelProto (onnx.proto3, field 14), key "names", with
the text of a Python mapping or list. Only this is read: no weights, and no further package.
"""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import IO

_METADATA, _KEY, _VALUE = 14, 1, 2
_VARINT, _EIGHT, _COUNTED, _FOUR = 0, 1, 2, 5
"""Wire types of protobuf: https://protobuf.dev/programming-guides/encoding."""
_MOST_BYTES = 1_000_000
"""Of an entry of the metadata; the names of 10,000 classes have fewer."""


def class_names(path: Path) -> tuple[str, ...]:
    """Return the names of an ONNX file's classes, in the order of its output; empty for none.

    Of a file that is damaged or no ONNX, too. Raises OSError.
    """
    with path.open("rb") as file:
        try:
            for entry in _entries(file):
                fields = dict(_fields(entry))
                if fields.get(_KEY) == b"names":
                    return _names(fields.get(_VALUE, b"").decode())
        except (ValueError, SyntaxError, RecursionError, MemoryError):
            return ()
    return ()


def _names(text: str) -> tuple[str, ...]:
    """Return the class names in a mapping from 0 on, or a list. Raises ValueError, SyntaxError."""
    stated = ast.literal_eval(text)
    if isinstance(stated, dict):
        stated = [stated.get(number) for number in range(len(stated))]
    if not isinstance(stated, list) or not all(isinstance(one, str) for one in stated):
        return ()
    return tuple(stated)


def _entries(file: IO[bytes]) -> Iterator[bytes]:
    """Yield the metadata entries of an ONNX file; the other fields are skipped."""
    while (head := _varint(file)) is not None:
        kind = head & 7
        if kind == _VARINT:
            _varint(file)
            continue
        length = {_EIGHT: 8, _FOUR: 4}.get(kind)
        if length is None:
            length = _varint(file) if kind == _COUNTED else None
        if length is None:
            raise ValueError("not protobuf")
        if head >> 3 == _METADATA and length <= _MOST_BYTES:
            yield file.read(length)
        else:
            file.seek(length, 1)


def _fields(entry: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the counted fields of a metadata entry. Raises ValueError."""
    at = 0
    while at < len(entry):
        head, length = entry[at], 0
        if head & 7 != _COUNTED:
            raise ValueError("not an entry of two texts")
        for shift in range(0, 35, 7):
            at += 1
            if at >= len(entry):
                raise ValueError("it ends too early")
            length |= (entry[at] & 0x7F) << shift
            if entry[at] < 0x80:
                break
        yield head >> 3, entry[at + 1 : at + 1 + length]
        at += 1 + length


def _varint(file: IO[bytes]) -> int | None:
    """Return the next number of a protobuf file; None at its end. Raises ValueError."""
    value = 0
    for shift in range(0, 70, 7):
        byte = file.read(1)
        if not byte:
            return None
        value |= (byte[0] & 0x7F) << shift
        if byte[0] < 0x80:
            return value
    raise ValueError("a number that does not end")
