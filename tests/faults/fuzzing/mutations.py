"""Changes of an input that a fuzzer makes: bytes, numbers, and structure; all of it seeded."""

import random
import re
import struct
from collections.abc import Callable, Sequence

_NUMBERS = (
    b"0", b"-0", b"-1", b"1e999", b"-1e308", b"1e-320", b"NaN", b".nan", b"Infinity", b"-.inf",
    b"255", b"256", b"65536", b"2147483648", b"4294967295", b"9223372036854775808",
    b"1" + b"0" * 400, b"0x10", b"1_0", b"null", b"true", b'""', b"[]", b"{}", b'"\\ud800"',
)  # fmt: skip
_WORDS = tuple(
    struct.pack(form, value)
    for form, values in (
        ("<B", (0, 1, 127, 128, 255)),
        ("<H", (0, 0x7FFF, 0x8000, 0xFFFF)),
        (">H", (1, 0x7FFF, 0xFFFF)),
        ("<I", (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)),
        (">I", (1, 0x7FFFFFFF, 0xFFFFFFFF)),
        ("<Q", (0x7FFFFFFFFFFFFFFF, 0xFFFFFFFFFFFFFFFF, 1 << 40)),
        ("<f", (float("nan"), float("inf"), -1.0, 3e38)),
        ("<d", (float("nan"), float("-inf"), 1e308)),
    )
    for value in values
)
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_BRACKETS = (
    b"[",
    b"{",
    b"]",
    b"}",
    b"<a>",
    b"</a>",
    b"(",
    b")",
    b'"',
    b"'",
    b":",
    b",",
    b"&x ",
    b"*x",
)
_LONGEST = 400_000


def mutated(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Return one of the inputs, changed in one to six places; now and then none, or noise."""
    chance = rng.random()
    if chance < 0.01:
        return rng.randbytes(rng.randrange(300))
    data = rng.choice(seeds)
    if chance < 0.02:
        return data
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        change = rng.choice(_CHANGES)
        data = change(rng, data, seeds)[:_LONGEST]
    return data


def _flip(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    del seeds
    if not data:
        return rng.randbytes(1)
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def _overwrite(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    del seeds
    word, at = rng.choice(_WORDS), rng.randrange(len(data) + 1)
    return data[:at] + word + data[at + len(word) :]


def _insert(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    del seeds
    at = rng.randrange(len(data) + 1)
    given = rng.choice((rng.randbytes(rng.randrange(1, 9)), rng.choice(_WORDS)))
    return data[:at] + given + data[at:]


def _remove(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    del seeds
    begin = rng.randrange(len(data) + 1)
    return data[:begin] + data[begin + rng.choice((1, 2, 4, 16, 200)) :]


def _repeat(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    del seeds
    begin = rng.randrange(len(data) + 1)
    part = data[begin : begin + rng.choice((1, 3, 16, 100))]
    return data[:begin] + part * rng.choice((2, 10, 500)) + data[begin:]


def _truncate(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    del seeds
    return data[: rng.randrange(len(data) + 1)]


def _splice(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    other = rng.choice(seeds)
    at, begin = rng.randrange(len(data) + 1), rng.randrange(len(other) + 1)
    return data[:at] + other[begin : begin + rng.randrange(1, 400)] + data[at:]


def _number(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    begin = rng.randrange(len(data) + 1)
    found = _NUMBER.search(data, begin) or _NUMBER.search(data)
    if found is None:
        return _insert(rng, data, seeds)
    return data[: found.start()] + rng.choice(_NUMBERS) + data[found.end() :]


def _nest(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    del seeds
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(_BRACKETS) * rng.choice((1, 1, 2, 50, 3000)) + data[at:]


_CHANGES: tuple[Callable[[random.Random, bytes, Sequence[bytes]], bytes], ...] = (
    _flip, _flip, _overwrite, _overwrite, _insert, _remove, _repeat, _truncate, _splice,
    _number, _number, _number, _nest,
)  # fmt: skip
