"""Queue of MQTT publications: all important ones, and the newest other one of each topic."""

import asyncio
from collections import deque

from wil_campaign.plugins.mqtt.mqtt_reports import Publication

_MOST_IMPORTANT = 10_000
_LEAST_BETWEEN_S = 0.2


class PublicationOutbox:
    """The outbox of MQTT publications; never blocks a writer. dropped: how many found it full.

    Of unimportant publications only the newest of each topic is kept, and it is taken at most
    five times a second: under virtual time there are far more than a person can read.
    """

    def __init__(self) -> None:
        self._important: deque[Publication] = deque()
        self._newest: dict[str, Publication] = {}
        self._last_taken_s: dict[str, float] = {}
        self._filled = asyncio.Event()
        self.dropped = 0

    def put(self, publication: Publication) -> None:
        """Put a publication into the outbox."""
        if not publication.important:
            self._newest[publication.topic] = publication
        elif len(self._important) >= _MOST_IMPORTANT:
            self.dropped += 1
        else:
            self._important.append(publication)
        self._filled.set()

    def put_back(self, publication: Publication) -> None:
        """Put an unsent publication back into the outbox; an unimportant one is dropped."""
        if publication.important:
            self._important.appendleft(publication)
            self._filled.set()

    def keep_newest_status(self) -> None:
        """Drop all but the newest publication that the broker keeps: no time is left for others."""
        kept = [publication for publication in self._important if publication.retain]
        self._important = deque(kept[-1:])

    @property
    def empty(self) -> bool:
        """Return whether the outbox holds nothing that must arrive."""
        return not self._important

    async def take(self) -> Publication:
        """Return the outbox's next publication; waits until there is one."""
        loop = asyncio.get_running_loop()
        while True:
            if self._important:
                return self._important.popleft()
            due = self._due(loop.time())
            if due is not None:
                return due
            self._filled.clear()
            try:
                async with asyncio.timeout(_LEAST_BETWEEN_S if self._newest else None):
                    await self._filled.wait()
            except TimeoutError:
                continue

    def _due(self, now_s: float) -> Publication | None:
        for topic, publication in self._newest.items():
            if now_s - self._last_taken_s.get(topic, -1.0) >= _LEAST_BETWEEN_S:
                del self._newest[topic]
                self._last_taken_s[topic] = now_s
                return publication
        return None
