"""Forwards the live feeds of this user's runs to Foxglove, one run at a time."""

from collections import OrderedDict

from wil_campaign.orchestrator.recording.recording_facts import mounts_in
from wil_campaign.plugins.console.feed.feed_messages import FactsView, FeedMessage, RunView
from wil_campaign.plugins.foxglove.followed_run import FollowedRun
from wil_campaign.plugins.foxglove.foxglove_server import FoxgloveServer
from wil_campaign.plugins.foxglove.live_messages import LiveMessages

_MOST_RUNS = 64
"""Runs whose clocks are kept; a new one replaces the oldest."""
_FIXED_S = 1.0
"""Period of the transforms that do not change, for clients that connect later."""


class FoxgloveBridge:
    """Sends the messages of live feeds to a Foxglove server."""

    def __init__(self, server: FoxgloveServer) -> None:
        self._server = server
        self._followed = FollowedRun()
        self._begun = ""
        self._runs: OrderedDict[str, LiveMessages] = OrderedDict()
        self._fixed_s = 0.0

    def receive(self, message: FeedMessage, now_s: float) -> None:
        """Take a message of a live feed. now_s: of a monotonic clock."""
        if isinstance(message, FactsView):
            epoch_ns = message.facts.get("epoch_ns", "")
            if epoch_ns.isdecimal():
                mounts = mounts_in(message.facts)
                self._runs[message.run] = LiveMessages(int(epoch_ns), mounts)
                self._runs.move_to_end(message.run)
            if len(self._runs) > _MOST_RUNS:
                self._runs.popitem(last=False)
            return
        # Without its facts the epoch of a run's clock is unknown.
        messages = self._runs.get(message.run)
        if messages is None or not self._followed.follows(message, now_s):
            return
        if message.run != self._begun:
            self._begun, self._fixed_s = message.run, now_s
            self._server.begin(message.run)
        if now_s >= self._fixed_s:
            self._fixed_s = now_s + _FIXED_S
            for fixed_transform in messages.fixed_transforms():
                self._server.send(fixed_transform)
        if isinstance(message, RunView):
            self._server.show_time(messages.ns(message.t_s))
        for one in messages.of(message):
            self._server.send(one)
