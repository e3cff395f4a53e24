"""Pieces of STATUSTEXTs: joined whatever is lost, doubled or cut, and harmless to a terminal."""

import unicodedata
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.driver.session.statustext import StatustextPieces, WholeStatustext

SAFETY = "Preflight Fail: Vehicle is in safety configuration"
"""Exactly 50 characters, as PX4 1.18 sends them: with an id, and nothing after it."""


def payload(piece: bytes, text_id: int = 0, place: int = 0, severity: int = 4) -> bytes:
    """Return a STATUSTEXT's payload, trailing zeros cut as in MAVLink 2."""
    whole = bytes([severity]) + piece.ljust(50, b"\0") + text_id.to_bytes(2, "little")
    return (whole + bytes([place])).rstrip(b"\0")


def pieces_of(text: str, text_id: int = 7, *, ends: bool = False) -> list[bytes]:
    """Return the payloads of a text. ends: an empty piece follows a full one (ArduPilot)."""
    raw = text.encode()
    parts = [raw[at : at + 50] for at in range(0, len(raw), 50)]
    if ends and len(parts[-1]) == 50:
        parts.append(b"")
    return [payload(part, text_id, place) for place, part in enumerate(parts)]


def texts(found: Iterable[WholeStatustext]) -> list[str]:
    return [one.text for one in found]


def joined(payloads: Iterable[bytes], *, every_s: float = 0.01) -> list[str]:
    """Return the texts of payloads, and what is taken a second after the last of them."""
    joins, found, t_s = StatustextPieces(), [], 0.0
    for one in payloads:
        t_s += every_s
        found += joins.add(one, t_s)
    return texts([*found, *joins.expire(t_s + 1.0)])


@given(text=st.text(alphabet="abc xyz.\u00e9\u20ac", min_size=1, max_size=240), ends=st.booleans())
def test_long_texts_are_joined_before_they_are_decoded(text: str, *, ends: bool) -> None:
    assert joined(pieces_of(text, ends=ends)) == ([text.strip()] if text.strip() else [])


def test_text_of_50_characters_without_an_end_is_taken_after_a_second() -> None:
    (only,) = pieces_of(SAFETY)
    joins = StatustextPieces()
    assert joins.add(only, 5.0) == []
    assert joins.unfinished == WholeStatustext(5.0, 4, SAFETY)
    assert joins.expire(5.9) == []
    assert joins.expire(6.0) == [WholeStatustext(5.0, 4, SAFETY)]
    assert joins.expire(9.0) == []
    assert joins.unfinished is None
    # ArduPilot's end of it, had it been late, is no text.
    assert joined([only, payload(b"", 7, 1)]) == [SAFETY]
    assert texts(joins.add(payload(b"", 7, 1), 9.0)) == []
    assert joins.expire(11.0) == []


def test_next_id_ends_the_text_before_it() -> None:
    (one,), (other,) = pieces_of(SAFETY, 7), pieces_of("Disarmed", 8)
    joins = StatustextPieces()
    assert joins.add(one, 1.0) == []
    assert texts(joins.add(other, 1.1)) == [SAFETY, "Disarmed"]


def test_text_without_an_id_is_whole_at_once() -> None:
    joins = StatustextPieces()
    assert texts(joins.add(payload(SAFETY.encode()), 1.0)) == [SAFETY]
    assert texts(joins.add(payload(b"Armed by external command\t"), 1.0)) == [
        "Armed by external command"
    ]


@pytest.mark.parametrize(
    ("kept", "said"),
    [
        ((0, 1, 2), "{0}{1}{2}"),
        ((1, 2), "... {1}{2}"),
        ((0, 2), "{0}... {2}"),
        ((0, 1), "{0}{1}"),
        ((1,), "... {1}"),
        ((2,), "... {2}"),
        ((2, 0, 1), "{0}{1}{2}"),
        ((0, 0, 1, 1, 2, 2), "{0}{1}{2}"),
    ],
)
def test_lost_doubled_and_overtaken_pieces(kept: tuple[int, ...], said: str) -> None:
    parts = ["a" * 49 + "-", "b" * 49 + "-", "the end"]
    pieces = pieces_of("".join(parts))
    assert joined(pieces[place] for place in kept) == [said.format(*parts)]


def test_lost_piece_cuts_a_character_and_no_more() -> None:
    text = "x" * 49 + "\u20ac" + "y" * 47 + "end"
    first, second, *_ = pieces_of(text)
    assert joined([first]) == ["x" * 49 + "\ufffd"]
    assert joined([second])[0].startswith("... \ufffd")


def test_ids_that_come_again_later_are_other_texts() -> None:
    joins = StatustextPieces()
    (one,) = pieces_of("Arming denied", 3)
    assert texts(joins.add(one, 1.0)) == ["Arming denied"]
    assert joins.add(one, 1.1) == []
    assert texts(joins.add(one, 30.0)) == ["Arming denied"]


@given(st.binary(max_size=50))
def test_nothing_that_a_terminal_obeys_is_left(raw: bytes) -> None:
    for text in joined([payload(raw)]):
        assert all(unicodedata.category(one)[0] != "C" for one in text)
        assert "\u2028" not in text


def test_escapes_and_directions_become_visible() -> None:
    assert joined([payload(b"\x1b[2J\x1b]0;t\x07 all well\r\nPASS")]) == [
        "\ufffd[2J\ufffd]0;t\ufffd all well  PASS"
    ]
    assert joined([payload("ab\u202edc\u200b\u009b".encode())]) == ["ab\ufffddc\ufffd\ufffd"]
