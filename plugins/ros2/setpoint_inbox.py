"""The messages of a node: the newest setpoint, what it answers, and what cannot be used."""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from wil_campaign.plugins.ros2.messages.setpoint_messages import (
    setpoint_stamp_in,
    setpoint_stamp_of,
)
from wil_campaign.plugins.ros2.messages.topics import ABORT, DONE, WORDS
from wil_campaign.plugins.ros2.px4.px4_types import PX4_WORDS
from wil_campaign.plugins.ros2.wire import InMessage

_LOOK_S = 0.1
_KEPT = 256
"""How many setpoints are kept: a node may send more than the answer that is awaited."""


@dataclass(slots=True)
class InTopic:
    """A topic of the node. name: by us. type: expected. trouble: why messages are refused.

    Of the received messages some are used, some refused, and the others came before the goal or
    were replaced by newer ones before the vehicle was steered.
    """

    name: str
    type: str
    received: int = 0
    used: int = 0
    refused: int = 0
    trouble: str = ""
    senders: set[str] = field(default_factory=set)


@dataclass(frozen=True, slots=True)
class ReceivedSetpoint:
    """A setpoint message. number: counts up over all topics. stamp_ns: of its header."""

    number: int
    topic: InTopic
    cdr: bytes
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class NodeAnswer:
    """What ends the wait for an answer: a setpoint, or None for a word that ends the flight.

    until: the words that came before this number of a setpoint belong to the answer.
    """

    setpoint: ReceivedSetpoint | None
    until: int


class SetpointInbox:
    """Keeps the newest setpoint of a node; `take` is called in threads of the wire.

    topics: of setpoints and words, by the name on the wire.
    """

    def __init__(self, topics: Mapping[str, InTopic]) -> None:
        self.topics = topics
        self._changed = threading.Condition()
        self._recent: deque[ReceivedSetpoint] = deque(maxlen=_KEPT)
        self._numbers = 0
        self._words: dict[str, deque[tuple[int, bytes]]] = {}
        """By topic, each with the number of the newest setpoint before it."""

    def receive(self, message: InMessage) -> None:
        """Take a message of the node."""
        topic = self.topics[message.topic]
        with self._changed:
            topic.received += message.cdr is not None
            if message.type != topic.type:
                topic.trouble = f"it has {message.type or 'an unknown type'}, not {topic.type}"
                topic.refused += message.cdr is not None
                return
            if message.sender:
                topic.senders.add(message.sender)
            if message.cdr is None:
                return
            if topic.name in WORDS or topic.name in PX4_WORDS:
                topic.used += 1
                words = self._words.setdefault(topic.name, deque(maxlen=_KEPT))
                words.append((self._numbers, message.cdr))
                self._changed.notify_all()
                return
            self._numbers += 1
            stamp_ns = setpoint_stamp_of(message.cdr, topic.type)
            self._recent.append(ReceivedSetpoint(self._numbers, topic, message.cdr, stamp_ns))
            self._changed.notify_all()

    @property
    def newest(self) -> ReceivedSetpoint | None:
        """Return the newest setpoint message; None before the first."""
        with self._changed:
            return self._recent[-1] if self._recent else None

    def word(self, name: str, until: int | None = None) -> bytes | None:
        """Return the newest message of a topic of words, and forget them; None without one."""
        return next(reversed(self.words(name, until)), None)

    def words(self, name: str, until: int | None = None) -> list[bytes]:
        """Return the messages of a topic of words, the newest last, and forget them.

        until: number of a setpoint; what came after it is kept.
        """
        with self._changed:
            words = self._words.get(name, ())
            found = []
            while words and (until is None or words[0][0] < until):
                found.append(words.popleft()[1])
            return found

    def count(self) -> int:
        """Return how many setpoint messages have come: the number of the newest."""
        with self._changed:
            return self._numbers

    def await_answer(
        self, stamp_ns: int, *, after: int, within_s: float, is_gone: Callable[[], bool]
    ) -> NodeAnswer | None:
        """Return what answers a message, waiting in wall time; None where nothing comes in time.

        It is a setpoint with the message's stamp, or a word before it that ends the flight: with
        that a node owes no answer, and whether it gives one is a matter of the machine. after:
        the number of the newest setpoint before the message. is_gone: asked again and again
        whether the node has ended.
        """
        until_s = time.monotonic() + within_s
        with self._changed:
            while True:
                setpoint = self._with_stamp(stamp_ns, after)
                ends = [words[0][0] for name in (ABORT, DONE) if (words := self._words.get(name))]
                if ends and (setpoint is None or min(ends) < setpoint.number):
                    return NodeAnswer(None, min(ends) + 1)
                if setpoint is not None:
                    return NodeAnswer(setpoint, setpoint.number)
                if time.monotonic() >= until_s or is_gone():
                    return None
                self._changed.wait(_LOOK_S)

    def _with_stamp(self, stamp_ns: int, after: int) -> ReceivedSetpoint | None:
        """Return the newest setpoint with a stamp, of those after a number; None without one."""
        for received in reversed(self._recent):
            if received.number <= after:
                return None
            if received.stamp_ns == setpoint_stamp_in(received.topic.type, stamp_ns):
                return received
        return None

    def troubles(self) -> list[str]:
        """Return in words what of the topics cannot be used."""
        found = [f"{one} cannot be used: {of.trouble}" for one, of in self._items() if of.trouble]
        return found + [
            f"{len(of.senders)} publishers publish on {one}: only one can fly the vehicle"
            for one, of in self._items()
            if len(of.senders) > 1
        ]

    def _items(self) -> list[tuple[str, InTopic]]:
        with self._changed:
            return list(self.topics.items())
