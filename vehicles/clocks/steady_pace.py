"""Tests whether one steady pace of a vehicle's clock explains its TIMESYNC exchanges; pure."""

import math
from collections.abc import Sequence


class TimesyncExchange:
    """One TIMESYNC exchange: sent and received (run clock, s), and the vehicle's time.

    remote_s: the vehicle's time in seconds. round_trip_s, middle_s: of the run clock.
    """

    __slots__ = ("middle_s", "received_s", "remote_ns", "remote_s", "round_trip_s", "sent_s")

    def __init__(self, sent_s: float, received_s: float, remote_ns: int) -> None:
        self.sent_s = sent_s
        self.received_s = received_s
        self.remote_ns = remote_ns
        self.remote_s = remote_ns * 1e-9
        self.round_trip_s = received_s - sent_s
        self.middle_s = (sent_s + received_s) / 2.0


class SteadyPace:
    """Counts the TIMESYNC exchanges, from the newest back, that one pace explains.

    Each exchange bounds the clock map at its moment; a line through all bounds exists where the
    slopes that each two of them permit have one in common. The slopes that earlier exchanges permit
    are kept: as long as all agree, only the newest is compared with each.
    """

    def __init__(self) -> None:
        self._low, self._high = -math.inf, math.inf
        """The slopes that all exchanges so far permit, dropped ones included.

        Empty (low above high) once they disagreed: then all are compared again.
        """
        self._step_s = 0.0

    def steady(self, exchanges: Sequence[TimesyncExchange], step_s: float) -> int:
        """Return how many of the TIMESYNC exchanges, oldest first, one steady pace explains.

        step_s: by how much stamps may be too old. Call it once for each new exchange; older ones
        may have been dropped since, but none added.
        """
        if step_s == self._step_s:
            slopes, newest = (self._low, self._high), exchanges[-1]
            for each in exchanges:
                slopes = _permitted(each, newest, step_s, slopes)
            if slopes[0] <= slopes[1]:
                self._low, self._high = slopes
                return len(exchanges)
        return self._compare_all(exchanges, step_s)

    def _compare_all(self, exchanges: Sequence[TimesyncExchange], step_s: float) -> int:
        slopes = (-math.inf, math.inf)
        agreeing: list[TimesyncExchange] = []
        for old in reversed(exchanges):
            for new in agreeing:
                slopes = _permitted(old, new, step_s, slopes)
            if slopes[0] > slopes[1]:
                break
            agreeing.append(old)
        self._low, self._high = slopes
        self._step_s = step_s
        return len(agreeing)


def _permitted(
    old: TimesyncExchange, new: TimesyncExchange, step_s: float, slopes: tuple[float, float]
) -> tuple[float, float]:
    span_s = new.remote_s - old.remote_s
    if span_s <= 0.0:
        return slopes
    low, high = slopes
    least = (new.sent_s - step_s - old.received_s) / span_s
    most = (new.received_s - old.sent_s + step_s) / span_s
    return (max(low, least), min(high, most))
