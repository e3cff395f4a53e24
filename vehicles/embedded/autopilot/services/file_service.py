"""The MAVLink file transfer service: read-only files, whose content is built when opened.

https://mavlink.io/en/services/ftp.html
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.services.command_registry import on_message

_HEADER_BYTES, _DATA_BYTES = 12, 239
_ACK, _NAK = 128, 129
_TERMINATE, _RESET, _LIST, _OPEN, _READ, _WRITE, _CREATE, _CRC, _BURST = (
    1,
    2,
    3,
    4,
    5,
    7,
    11,
    14,
    15,
)
_WITHOUT_DATA = {0, _TERMINATE, _RESET}
"""These operations cannot fail."""
_KNOWN = range(16)
_FAIL, _INVALID_SESSION, _END_OF_FILE, _UNKNOWN_COMMAND, _NOT_FOUND = 1, 4, 6, 7, 10
_MOST_IN_BURST = 64


class _Request(NamedTuple):
    """A FILE_TRANSFER_PROTOCOL request: its sender and payload."""

    peer: tuple[int, int]
    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes

    @property
    def path(self) -> str:
        """Return the path in the data, without what follows a question mark."""
        text = self.data.split(b"\0")[0].decode(errors="replace")
        return text.split("?")[0].lstrip("/")


class FileService:
    """Serves FILE_TRANSFER_PROTOCOL; one file is open at a time.

    files: builds a file's bytes when it is opened, by path. Without any, sessions are ended,
    directories are empty, and no file is found.
    """

    def __init__(
        self, files: Mapping[str, Callable[[], bytes]], send: Callable[[Any], None]
    ) -> None:
        self._files = files
        self._send = send
        self._open: bytes | None = None

    @on_message("FILE_TRANSFER_PROTOCOL")
    def _on_file_transfer(self, message: Any) -> None:
        for answer in self._answers(_request_of(message)):
            self._send(answer)

    def _answers(self, request: _Request) -> list[Any]:
        """Return the replies to a request: one, or a burst of them."""
        opcode = request.opcode
        if opcode in _WITHOUT_DATA:
            if opcode:
                self._open = None
            return [_reply(request)]
        if opcode == _OPEN and request.path in self._files:
            self._open = self._files[request.path]()
            return [_reply(request, data=len(self._open).to_bytes(4, "little"))]
        if opcode == _READ and self._open is not None:
            return [self._chunk(request, self._open, request.offset, 1)]
        if opcode == _BURST and self._open is not None:
            return self._burst(request, self._open)
        return [_reply(request, error=_error(opcode))]

    def _burst(self, request: _Request, content: bytes) -> list[Any]:
        """Return the rest of the open file in replies, and its end."""
        step = _chunk_bytes(request)
        offsets = range(request.offset, len(content), step)[:_MOST_IN_BURST]
        replies = [
            self._chunk(request, content, offset, number, complete=number == _MOST_IN_BURST)
            for number, offset in enumerate(offsets, 1)
        ]
        if len(replies) < _MOST_IN_BURST:
            replies.append(_reply(request, number=len(replies) + 1, error=_END_OF_FILE))
        return replies

    def _chunk(
        self, request: _Request, content: bytes, offset: int, number: int, *, complete: bool = False
    ) -> Any:
        data = content[offset : offset + _chunk_bytes(request)]
        if not data:
            return _reply(request, error=_END_OF_FILE)
        return _reply(request, number=number, offset=offset, data=data, complete=complete)


def _chunk_bytes(request: _Request) -> int:
    """Return how many bytes of a file one reply carries."""
    return min(request.size or _DATA_BYTES, _DATA_BYTES)


def _request_of(message: Any) -> _Request:
    payload = bytes(message.payload)
    return _Request(
        (message.get_srcSystem(), message.get_srcComponent()),
        int.from_bytes(payload[0:2], "little"),
        payload[2],
        payload[3],
        payload[4],
        int.from_bytes(payload[8:12], "little"),
        payload[_HEADER_BYTES : _HEADER_BYTES + payload[4]],
    )


def _reply(
    request: _Request,
    *,
    number: int = 1,
    offset: int | None = None,
    data: bytes = b"",
    error: int | None = None,
    complete: bool = False,
) -> Any:
    """Return the `number`th FILE_TRANSFER_PROTOCOL reply to a request."""
    body = data if error is None else bytes([error])
    at = request.offset if offset is None else offset
    payload = bytearray(_HEADER_BYTES + _DATA_BYTES)
    payload[0:2] = ((request.sequence + number) & 0xFFFF).to_bytes(2, "little")
    payload[2:7] = (
        request.session,
        _ACK if error is None else _NAK,
        len(body),
        request.opcode,
        complete,
    )
    payload[8:12] = at.to_bytes(4, "little")
    payload[_HEADER_BYTES : _HEADER_BYTES + len(body)] = body
    return mavlink.MAVLink_file_transfer_protocol_message(0, *request.peer, list(payload))


def _error(opcode: int) -> int:
    if opcode == _LIST:
        return _END_OF_FILE
    if opcode in {_OPEN, _CREATE, _CRC}:
        return _NOT_FOUND
    if opcode in {_READ, _WRITE, _BURST}:
        return _INVALID_SESSION
    return _FAIL if opcode in _KNOWN else _UNKNOWN_COMMAND
