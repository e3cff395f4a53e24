"""Maps a sender's clock to the run clock by the arrival times of its messages alone; pure.

The message with the least delay gives the best estimate of the offset; later ones were delayed.
The minimum is taken over the last seconds, so that the rates of the clocks may differ a little. A
delay that grows more than clocks differ is no clock's: a buffer fills, and its readings are old.
The least delay itself cannot be observed: it is measured once (`calibrate`) and handed in as
`latency_s`.
"""

import math
from collections import deque

_JUMP_S = 1.0
"""A stamp that is early by more than this is no jitter: the sender's clock was set."""
_APART = 1e-3
"""The rates of two clocks differ by less: crystals by 1e-4."""
_STEP_S = 0.1
"""A stamp that goes back by less is that of a sender that stamps unevenly, and no restart."""
_MOST_RESTARTS, _WITHIN_S = 6, 5.0
"""No sender that restarts does so as often: there are two, or its stamps are in another unit."""


class ArrivalClock:
    """Maps a sender's stamps to the run clock by their arrival.

    latency_s: from sampling to arrival of the message with the least delay. window_s: the window
    of the minimum; a drift of 1e-4 causes an error of 1e-4 times this.
    """

    def __init__(self, *, latency_s: float = 0.0, window_s: float = 10.0) -> None:
        self.latency_s = latency_s
        self._window_s = window_s
        self._newest_sender_s = -math.inf
        self._since_s = -math.inf
        self._current_s = math.inf
        self._previous_s = math.inf
        self._ever_s = math.inf
        """The least delay since the sender started, as its clock may have gone since; at a time."""
        self._ever_at_s = -math.inf
        self.resets = 0

    def run_time(self, sender_s: float | None, arrived_s: float) -> float:
        """Return a stamp's time on the run clock; never later than its arrival.

        sender_s: its stamp; None for a message without one, which counts as not delayed. A stamp
        that goes back, or leaps ahead, means that the sender restarted.
        """
        if sender_s is None or not math.isfinite(sender_s):
            return arrived_s - self.latency_s
        delay_s = arrived_s - sender_s
        if sender_s < self._newest_sender_s or delay_s < self._least_s - _JUMP_S:
            is_step = abs(sender_s - self._newest_sender_s) > _STEP_S
            self.resets += is_step and not math.isinf(self._least_s)
            self._reset()
        self._newest_sender_s = sender_s
        self._add_delay(delay_s, arrived_s)
        return sender_s + self._least_s - self.latency_s

    def is_overtaken(self, sender_s: float) -> bool:
        """Return whether a stamp is that of a message which newer ones overtook on the way.

        A message whose number does not advance, and that was not overtaken, is of a sender that
        restarted: its stamp is the newest one, or older than any message that is overtaken.
        """
        return self._newest_sender_s - _JUMP_S <= sender_s <= self._newest_sender_s

    @property
    def _least_s(self) -> float:
        return min(self._current_s, self._previous_s, self._ever_s)

    def _add_delay(self, delay_s: float, arrived_s: float) -> None:
        since_s = max(0.0, arrived_s - self._ever_at_s)
        self._ever_s = min(delay_s, self._ever_s + _APART * since_s)
        self._ever_at_s = arrived_s
        if arrived_s - self._since_s > self._window_s:
            self._since_s, self._previous_s, self._current_s = arrived_s, self._current_s, delay_s
        else:
            self._current_s = min(self._current_s, delay_s)

    def _reset(self) -> None:
        self._since_s = -math.inf
        self._current_s = math.inf
        self._previous_s = math.inf
        self._ever_s = math.inf


class RestartMeter:
    """Whether a sender's clock or its numbers begin anew more often than one sender's can."""

    def __init__(self) -> None:
        self._newest: deque[float] = deque(maxlen=_MOST_RESTARTS)

    def add(self, arrived_s: float) -> None:
        """Count a restart that a message shows which arrived then."""
        self._newest.append(arrived_s)

    def fault(self, arrived_s: float) -> str:
        """Return why a message that arrived then cannot be used, in words; "" for no reason."""
        newest = self._newest
        if len(newest) < _MOST_RESTARTS or arrived_s - newest[0] > _WITHIN_S:
            return ""
        return (
            f"its sender began anew {_MOST_RESTARTS} times within {_WITHIN_S:g} s: there are two "
            "senders, or its stamps are not seconds"
        )
