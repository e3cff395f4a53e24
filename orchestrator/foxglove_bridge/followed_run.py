"""Which run Foxglove is shown, where several fly at once; pure."""

from orchestrator.live_feed.feed_messages import EventView, FeedMessage

SILENT_S = 2.0
"""A run that nothing came of for so long yields to one that speaks."""


class FollowedRun:
    """Follows one run until it has ended or fallen silent, then the next that speaks."""

    def __init__(self) -> None:
        self.run = ""
        self._heard_s = 0.0
        self._is_over = False

    def follows(self, message: FeedMessage, now_s: float) -> bool:
        """Return whether a message is of the followed run. now_s: of any clock that goes on."""
        if message.run != self.run:
            if self.run and not self._is_over and now_s - self._heard_s < SILENT_S:
                return False
            self.run, self._is_over = message.run, False
        self._heard_s = now_s
        if isinstance(message, EventView) and (message.kind, message.word) == ("stage", "end"):
            self._is_over = True
        return True
