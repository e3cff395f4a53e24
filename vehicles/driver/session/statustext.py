"""Joins STATUSTEXTs that arrive in several pieces; pure."""

import unicodedata
from dataclasses import dataclass, field

_PIECE_BYTES = 50
_TEXT_AT, _ID_AT, _CHUNK_AT = 1, 51, 53
_LATE_S = 1.0
"""How long after its last piece a text without an end is awaited. PX4 sends none after a text whose
last piece is full; ArduPilot sends an empty one, which may be lost."""
_GAP = "... "
"""What stands for pieces that were lost."""
_UNPRINTABLE = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Unicode's categories of what is no character to print: controls, formats (directions, marks of no
width), surrogates, private and unassigned ones, and separators of lines."""


@dataclass(frozen=True, slots=True)
class WholeStatustext:
    """A STATUSTEXT as far as it came. t_s: when its last piece arrived (run clock)."""

    t_s: float
    severity: int
    text: str


@dataclass(slots=True)
class _Unfinished:
    """The pieces of one text so far, by their places."""

    severity: int
    text_id: int
    last_s: float
    pieces: dict[int, bytes] = field(default_factory=dict)

    @property
    def is_whole(self) -> bool:
        """Return whether all pieces came, and the last one is short."""
        last = max(self.pieces)
        return len(self.pieces) == last + 1 and len(self.pieces[last]) < _PIECE_BYTES

    @property
    def whole(self) -> WholeStatustext:
        """Return the text of the pieces that came; "... " stands for those that did not."""
        if not any(self.pieces.values()):
            return WholeStatustext(self.last_s, self.severity, "")  # ArduPilot's end of a full text
        runs: list[bytes] = []
        due = 0
        for place, piece in sorted(self.pieces.items()):
            # A character's bytes may be in two pieces: what follows without a gap is one text.
            if place != due or not runs:
                runs.append(b"")
            runs[-1] += piece
            due = place + 1
        text = _GAP.join(map(printable_statustext, runs))
        if min(self.pieces) > 0:
            text = _GAP + text
        return WholeStatustext(self.last_s, self.severity, text.strip())


class StatustextPieces:
    """Joins the pieces of long STATUSTEXTs (fields id and chunk_seq).

    A text is complete with its last, short piece. Without it, it is taken as it is when a text with
    another id comes, or a second after its last piece (`expire`).
    """

    def __init__(self) -> None:
        self._unfinished: _Unfinished | None = None
        self._finished: _Unfinished | None = None

    @property
    def unfinished(self) -> WholeStatustext | None:
        """Return what has come of a text that is not complete; None without one."""
        return None if self._unfinished is None else self._unfinished.whole

    def add(self, payload: bytes, t_s: float) -> list[WholeStatustext]:
        """Add a STATUSTEXT's payload; return the texts that are complete now, in order."""
        payload = payload.ljust(_CHUNK_AT + 1, b"\0")
        text_id = int.from_bytes(payload[_ID_AT:_CHUNK_AT], "little")
        piece = payload[_TEXT_AT:_ID_AT].split(b"\0")[0]
        found = self.expire(t_s)
        if text_id == 0:
            return [*found, WholeStatustext(t_s, payload[0], printable_statustext(piece).strip())]
        if self._is_doubled(text_id, payload[_CHUNK_AT], piece, t_s):
            return found
        if self._unfinished is None or self._unfinished.text_id != text_id:
            found += self._finish()
            self._unfinished = _Unfinished(payload[0], text_id, t_s)
        self._unfinished.pieces.setdefault(payload[_CHUNK_AT], piece)
        self._unfinished.last_s = t_s
        return found + self._finish() if self._unfinished.is_whole else found

    def expire(self, t_s: float) -> list[WholeStatustext]:
        """Return the text that nothing has completed for a second, if there is one."""
        waiting = self._unfinished
        due = waiting is not None and t_s - waiting.last_s >= _LATE_S
        return self._finish() if due else []

    def _finish(self) -> list[WholeStatustext]:
        finished, self._unfinished = self._unfinished, None
        if finished is None:
            return []
        self._finished = finished
        return [finished.whole] if finished.whole.text else []

    def _is_doubled(self, text_id: int, place: int, piece: bytes, t_s: float) -> bool:
        """Return whether a piece of the last complete text came again."""
        last = self._finished
        if last is None or last.text_id != text_id or t_s - last.last_s > _LATE_S:
            return False
        return last.pieces.get(place) == piece


def printable_statustext(raw: bytes) -> str:
    """Return the text of UTF-8 bytes without what is no character to print.

    White space of any kind becomes a space; what else a terminal or a page would obey, and bytes
    that are no UTF-8, become U+FFFD.
    """
    text = raw.decode("utf-8", errors="replace")
    return "".join(
        " " if one in "\t\n\v\f\r" else "\N{REPLACEMENT CHARACTER}" if _is_unprintable(one) else one
        for one in text
    )


def _is_unprintable(character: str) -> bool:
    return unicodedata.category(character) in _UNPRINTABLE
