"""The topics that a run publishes for its node, with what became of their messages."""

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from wil_campaign.orchestrator.run_results.result_parts import TopicResult
from wil_campaign.plugins.ros2.messages.topics import OutTopic
from wil_campaign.plugins.ros2.wire import NodeWire

Build = Callable[[], bytes]
_UNSUBSCRIBED = "nobody subscribed to some of them"


@dataclass(slots=True)
class _Counts:
    offered: int = 0
    delivered: int = 0
    trouble: str = ""


class NodeTopics:
    """Publishes on the topics of a node, by their names here. May be used in any thread.

    rename: the node's names of topics, None for one that it does not get.
    """

    def __init__(
        self, wire: NodeWire, topics: Iterable[OutTopic], rename: Mapping[str, str | None]
    ) -> None:
        self._wire = wire
        self._topics = {out_topic.name: out_topic for out_topic in topics}
        self._names = {name: rename.get(name, name) for name in self._topics}
        self._counts = {name: _Counts() for name, to in self._names.items() if to is not None}
        self._lock = threading.Lock()
        for name, topic in self._topics.items():
            if (to := self._names[name]) is not None:
                wire.advertise(topic, to)

    def publish(self, name: str, stamp_ns: int, build: Build) -> bool:
        """Publish a message, which is built if anybody subscribes; return whether it left."""
        to = self._names.get(name)
        if to is None:
            return False
        is_subscribed = self._wire.is_subscribed(to)
        is_gone = is_subscribed and self._wire.publish(to, build(), stamp_ns)
        with self._lock:
            counts = self._counts[name]
            counts.offered += 1
            counts.delivered += is_gone
            if not is_gone:
                counts.trouble = "the wire refused some of them" if is_subscribed else _UNSUBSCRIBED
        return is_gone

    def wire_trouble(self) -> str:
        """Return why nothing goes over the wire any more; "" while it does."""
        return self._wire.trouble()

    def name_of(self, name: str) -> str:
        """Return the node's name of a topic."""
        return self._names.get(name) or name

    def published(self, given: str) -> str:
        """Return the name here of a topic by either name; "" where it is not published."""
        return next((name for name in self._counts if given in {name, self._names[name]}), "")

    def names(self) -> frozenset[str]:
        """Return the topics, by their names here."""
        return frozenset(self._counts)

    def subscribed(self) -> frozenset[str]:
        """Return the topics, by their names here, that somebody subscribes to."""
        names = ((name, self._names[name]) for name in self._counts)
        return frozenset(name for name, to in names if to and self._wire.is_subscribed(to))

    def sensor_topics(self) -> frozenset[str]:
        """Return the topics of sensors."""
        return frozenset(name for name in self._counts if self._topics[name].is_sensor)

    def counts(self, name: str) -> tuple[int, int]:
        """Return how many messages a topic was offered, and how many left for a subscriber."""
        with self._lock:
            return self._counts[name].offered, self._counts[name].delivered

    def results(self) -> tuple[TopicResult, ...]:
        """Return the results of the topics on which anything was published."""
        with self._lock:
            return tuple(
                TopicResult(
                    self.name_of(name),
                    self._topics[name].type,
                    "out",
                    count.offered,
                    count.delivered,
                    count.trouble,
                )
                for name, count in self._counts.items()
                if count.offered
            )
