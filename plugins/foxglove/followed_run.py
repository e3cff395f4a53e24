"""Chooses the run that Foxglove shows, where several fly at once; pure."""

from wil_campaign.plugins.console.feed.feed_messages import EventView, FeedMessage

SILENT_S = 2.0
"""A run that is silent for this long is replaced by one that sends."""


class FollowedRun:
    """Follows one run until it ends or falls silent, then the next that sends."""

    def __init__(self) -> None:
        self.run = ""
        self._last_received_s = 0.0
        self._is_over = False

    def follows(self, message: FeedMessage, now_s: float) -> bool:
        """Return whether a message is of the followed run. now_s: of a monotonic clock."""
        if message.run != self.run:
            if self.run and not self._is_over and now_s - self._last_received_s < SILENT_S:
                return False
            self.run, self._is_over = message.run, False
        self._last_received_s = now_s
        if isinstance(message, EventView) and (message.kind, message.word) == ("stage", "end"):
            self._is_over = True
        return True
