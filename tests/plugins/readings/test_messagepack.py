"""Headers from strangers."""

from contextlib import suppress

import msgpack  # type: ignore[import-untyped]  # ships no types
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.readings.messagepack import (
    MAX_HEADER_BYTES,
    BadMessageError,
    MessageHeader,
    pack_header,
)

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=10,
)


def test_each_reader_returns_its_kind() -> None:
    header = MessageHeader.unpack(
        pack_header(
            {
                "word": "gate",
                "seq": 7,
                "yes": True,
                "t_s": 1,
                "q": [1, 0.5],
                "list": [{"a": 1}],
                "map": {"start": 2.5},
                "names": ["a", "b"],
                "nothing": None,
            }
        )
    )
    assert header.text("word") == "gate"
    assert header.whole("seq") == 7
    assert header.flag("yes", default=False) is True
    assert header.flag("missing", default=True) is True
    assert header.number("t_s") == 1.0
    assert header.numbers("q", 2) == (1.0, 0.5)
    assert header.headers("list")[0].whole("a") == 1
    assert header.table("map") == {"start": 2.5}
    assert header.texts("names") == ("a", "b")
    assert "word" in header
    assert "nothing" not in header


@given(value=VALUES)
def test_no_value_gets_through_as_another_kind(value: object) -> None:
    header = MessageHeader({"key": value})
    for read, kind in (
        (header.text, str),
        (header.whole, int),
        (header.number, float),
        (header.texts, tuple),
        (header.headers, tuple),
        (header.table, dict),
        (lambda key: header.numbers(key, None), tuple),
    ):
        with suppress(BadMessageError):
            assert type(read("key")) is kind


@given(st.binary(max_size=200))
def test_garbage_is_refused(data: bytes) -> None:
    try:
        MessageHeader.unpack(data)
    except BadMessageError:
        return
    assert isinstance(msgpack.unpackb(data), dict)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        pack_header({"a": 1})[:-1],
        pack_header({"a": 1}) + b"\x00",
        msgpack.packb([1, 2]),
        msgpack.packb({1: 2}),
        b"\x91" * 20_000 + b"\xc0",
        b"\x81\xa1a" * 5_000 + b"\xc0",
        b"\xdf\xff\xff\xff\xff",
        b"\0" * (MAX_HEADER_BYTES + 1),
    ],
)
def test_known_kinds_of_garbage_are_refused(data: bytes) -> None:
    with pytest.raises(BadMessageError):
        MessageHeader.unpack(data)


@pytest.mark.parametrize("number", [float("nan"), float("inf"), True, "1", None, 10**400])
def test_a_value_that_is_no_finite_number_is_refused(number: object) -> None:
    with pytest.raises(BadMessageError, match="finite"):
        MessageHeader({"t_s": number}).number("t_s")
    with pytest.raises(BadMessageError, match="finite"):
        MessageHeader({"q": [0.0, number]}).numbers("q", 2)
