"""The intervals of streamed telemetry messages, and which of them are due."""

from collections.abc import Mapping


class StreamIntervals:
    """The intervals of streamed messages. Times are the vehicle's own clock, s."""

    def __init__(self, rates_hz: Mapping[int, float], *, shortest_s: float) -> None:
        self._defaults = dict(rates_hz)
        self._shortest_s = shortest_s
        self._interval_s: dict[int, float] = {}
        self._due_s: dict[int, float] = {}
        self.next_due_s = 0.0
        """No message is due before; callers compare with it first."""
        for message_id, rate_hz in rates_hz.items():
            self.set_rate(message_id, rate_hz, now_s=0.0)

    def set_rate(self, message_id: int, rate_hz: float, *, now_s: float) -> None:
        """Set the rate of a streamed message; 0 stops it."""
        if rate_hz <= 0.0:
            self._interval_s.pop(message_id, None)
            self._due_s.pop(message_id, None)
            return
        self._interval_s[message_id] = max(1.0 / rate_hz, self._shortest_s)
        self._due_s[message_id] = now_s
        self.next_due_s = min(self.next_due_s, now_s)

    def reset_rate(self, message_id: int, *, now_s: float) -> None:
        """Reset a streamed message to its rate after boot."""
        self.set_rate(message_id, self._defaults.get(message_id, 0.0), now_s=now_s)

    def interval_s(self, message_id: int) -> float | None:
        """Return the interval of a streamed message; None when it is not sent."""
        return self._interval_s.get(message_id)

    def due(self, now_s: float) -> list[int]:
        """Return the stream messages that are due now, and note them as sent."""
        dues = self._due_s
        # A clock that advances in steps may read slightly less than the interval.
        ready = [message_id for message_id, due_s in dues.items() if due_s <= now_s + 1e-6]
        for message_id in ready:
            interval_s = self._interval_s[message_id]
            due_s = dues[message_id] + interval_s
            dues[message_id] = due_s if due_s > now_s else now_s + interval_s
        self.next_due_s = min(dues.values(), default=float("inf")) - 1e-6
        return ready
