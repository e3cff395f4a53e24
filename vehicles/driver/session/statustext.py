"""Joins STATUSTEXTs that arrive in several pieces; pure."""

_PIECE_CHARACTERS = 50


class StatustextPieces:
    """Joins the pieces of long STATUSTEXTs (fields id and chunk_seq)."""

    def __init__(self) -> None:
        self._id = 0
        self._next = 0
        self._text = ""

    def add(self, text: str, text_id: int, chunk_seq: int) -> str | None:
        """Add a piece; return the whole STATUSTEXT once its last, short one has come.

        When a piece was lost, "... " takes its place, or the text starts after it.
        """
        if text_id == 0:
            return text.strip()
        if text_id != self._id or chunk_seq != self._next:
            self._text = "" if text_id != self._id else self._text + "... "
        self._id, self._next = text_id, chunk_seq + 1
        self._text += text
        if len(text) >= _PIECE_CHARACTERS:
            return None
        whole, self._text, self._id = self._text.strip(), "", 0
        return whole
