"""What ground stations ask for when they connect: modes and files.

The modes' messages are in MAVLink's development dialect; both firmwares send them. That dialect
takes 0.2 s to import, and few ask: it is imported with the first question.
"""

from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

AVAILABLE_MODES = 435
CURRENT_MODE = 436

_OPCODE, _REQUEST, _OFFSET, _DATA = 3, 5, 8, 12
_PAYLOAD_BYTES = 251
_ACK, _NAK = 128, 129
_WITHOUT_ANSWER_DATA = {0, 1, 2}
"""None, TerminateSession, ResetSessions: there is nothing that could fail in them."""
_LISTS, _OPENS = {3}, {4, 11, 14}
"""ListDirectory; OpenFileRO, OpenFileWO and CalcFileCRC32, which name a file."""
_KNOWN = {*range(16)}
_FAIL, _INVALID_SESSION, _END_OF_FILE, _UNKNOWN_COMMAND, _NOT_FOUND = 1, 4, 6, 7, 10


class ModeEntry(NamedTuple):
    """A mode for discovery by AVAILABLE_MODES. standard: MAV_STANDARD_MODE; 0 for none.

    advanced: a mode that is not offered to everybody; selectable: by a user.
    """

    name: str
    custom_mode: int
    standard: int = 0
    advanced: bool = False
    selectable: bool = True


def available_modes(entries: tuple[ModeEntry, ...], index: int) -> list[Any]:
    """Return one AVAILABLE_MODES (index from 1), or all of them for index 0."""
    from pymavlink.dialects.v20 import development  # noqa: PLC0415 - see above

    wanted = range(1, len(entries) + 1) if index == 0 else (index,)
    return [
        development.MAVLink_available_modes_message(
            len(entries),
            number,
            entry.standard,
            entry.custom_mode,
            (1 if entry.advanced else 0) | (0 if entry.selectable else 2),
            entry.name.encode(),
        )
        for number in wanted
        if 1 <= number <= len(entries)
        for entry in (entries[number - 1],)
    ]


def current_mode(entries: tuple[ModeEntry, ...], custom_mode: int) -> Any:
    """Return CURRENT_MODE for discovery."""
    from pymavlink.dialects.v20 import development  # noqa: PLC0415 - see above

    standard = next((e.standard for e in entries if e.custom_mode == custom_mode), 0)
    return development.MAVLink_current_mode_message(standard, custom_mode, custom_mode)


def file_answer(message: Any) -> Any:
    """Return the FILE_TRANSFER_PROTOCOL reply of a vehicle without files, for discovery.

    Sessions are ended, directories are empty, every file is not found.
    """
    payload = bytes(message.payload)
    opcode = payload[_OPCODE]
    error = _file_error(opcode)
    answer = bytearray(_PAYLOAD_BYTES)
    answer[0:2] = ((int.from_bytes(payload[0:2], "little") + 1) & 0xFFFF).to_bytes(2, "little")
    answer[2] = payload[2]
    answer[_OPCODE] = _ACK if error is None else _NAK
    answer[_REQUEST] = opcode
    answer[_OFFSET:_DATA] = payload[_OFFSET:_DATA]
    if error is not None:
        answer[4] = 1
        answer[_DATA] = error
    return mavlink.MAVLink_file_transfer_protocol_message(
        0, message.get_srcSystem(), message.get_srcComponent(), list(answer)
    )


def _file_error(opcode: int) -> int | None:
    """Return the file transfer error of an operation; None for an empty acknowledgement."""
    if opcode in _WITHOUT_ANSWER_DATA:
        return None
    if opcode in _LISTS:
        return _END_OF_FILE
    if opcode in _OPENS:
        return _NOT_FOUND
    if opcode in {5, 7, 15}:
        return _INVALID_SESSION
    return _FAIL if opcode in _KNOWN else _UNKNOWN_COMMAND
