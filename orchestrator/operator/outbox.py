"""What waits to be published: news that must arrive, and of all else only the newest."""

import asyncio
from collections import deque

from orchestrator.operator.mqtt_reports import Publication

_MOST_KEPT = 10_000
_LEAST_BETWEEN_S = 0.2


class Outbox:
    """The outbox of MQTT publications; never blocks a writer; `dropped` had no room.

    Of what is not important only the newest of each topic is kept, and it is given out at most
    five times a second: under virtual time there is far more than anybody can read.
    """

    def __init__(self) -> None:
        self._kept: deque[Publication] = deque()
        self._newest: dict[str, Publication] = {}
        self._given_s: dict[str, float] = {}
        self._filled = asyncio.Event()
        self.dropped = 0

    def put(self, publication: Publication) -> None:
        """Put a publication into the outbox."""
        if not publication.important:
            self._newest[publication.topic] = publication
        elif len(self._kept) >= _MOST_KEPT:
            self.dropped += 1
        else:
            self._kept.append(publication)
        self._filled.set()

    def put_back(self, publication: Publication) -> None:
        """Put unsent publications back into the outbox; unimportant ones are dropped."""
        if publication.important:
            self._kept.appendleft(publication)
            self._filled.set()

    @property
    def empty(self) -> bool:
        """Return whether the outbox holds nothing that must arrive."""
        return not self._kept

    async def take(self) -> Publication:
        """Return the outbox's next publication; waits until there is one."""
        loop = asyncio.get_running_loop()
        while True:
            if self._kept:
                return self._kept.popleft()
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
            if now_s - self._given_s.get(topic, -1.0) >= _LEAST_BETWEEN_S:
                del self._newest[topic]
                self._given_s[topic] = now_s
                return publication
        return None
