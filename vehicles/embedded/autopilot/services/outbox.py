"""Queues an autopilot's messages to send: STATUSTEXTs are sent after their cause."""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_TEXT_BYTES = 50
EMERGENCY: int = mavlink.MAV_SEVERITY_EMERGENCY
CRITICAL: int = mavlink.MAV_SEVERITY_CRITICAL
WARNING: int = mavlink.MAV_SEVERITY_WARNING
INFO: int = mavlink.MAV_SEVERITY_INFO


class Outbox:
    """The outbox of the autopilot's messages, in their order.

    `count_all`: number every STATUSTEXT, as PX4 does; otherwise only those of several chunks.
    """

    def __init__(self, *, count_all: bool) -> None:
        self._count_all = count_all
        self._now: list[Any] = []
        self._later: list[Any] = []
        self._texts: list[tuple[int, str]] = []
        self._text_id = 0

    def send(self, message: Any | None) -> None:
        """Queue a message to send; None does nothing."""
        if message is not None:
            self._now.append(message)

    def send_later(self, message: Any | None) -> None:
        """Queue a message to send after the present command's acknowledgement."""
        if message is not None:
            self._later.append(message)

    def send_text(self, severity: int, text: str) -> None:
        """Queue a STATUSTEXT to send in the next turn, after its cause."""
        self._texts.append((severity, text))

    def release(self) -> None:
        """Release messages that waited for an acknowledgement."""
        if self._later:
            self._now.extend(self._later)
            self._later.clear()

    def turn(self, *, send_texts: bool) -> None:
        """Release all queued messages; send_texts: False drops the STATUSTEXTs."""
        self.release()
        texts, self._texts = self._texts, []
        for severity, text in texts if send_texts else ():
            self._now.extend(self._statustexts(severity, text))

    def take(self) -> list[Any]:
        """Return and remove the messages to send now."""
        if not self._now:
            return self._now
        now, self._now = self._now, []
        return now

    def _statustexts(self, severity: int, text: str) -> list[Any]:
        data = text.encode()
        chunks = [data[i : i + _TEXT_BYTES] for i in range(0, len(data), _TEXT_BYTES)]
        number = 0
        if self._count_all:
            number, self._text_id = self._text_id, (self._text_id + 1) % 65536
        elif len(chunks) > 1:
            number = self._text_id = self._text_id % 65535 + 1
        make: Callable[..., Any] = mavlink.MAVLink_statustext_message
        return [make(severity, chunk, number, seq) for seq, chunk in enumerate(chunks)]
