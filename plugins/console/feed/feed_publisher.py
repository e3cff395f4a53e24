"""Publishes a run's live feed in a separate thread, so that the flight never waits.

The flight only sets attributes. A new view or image replaces an unsent one; only events are queued.
A console that does not read loses views.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import msgspec

from wil_campaign.foundation.tasks import FAULTS
from wil_campaign.orchestrator.state.mixtures import PreviewImages
from wil_campaign.plugins.console.feed.feed_images import image_view
from wil_campaign.plugins.console.feed.feed_messages import (
    LONGEST_DATAGRAM_BYTES,
    EventView,
    FactsView,
    FeedMessage,
    RunView,
    feed_codec,
)
from wil_campaign.plugins.console.feed.feed_sockets import FeedSender, find_console_sockets
from wil_campaign.vehicles.readings import CameraReading

_SEARCH_S = 1.0
"""Period of the search for consoles, wall clock."""
_VIEW_S = 1.0 / 15.0
_IMAGE_S = 1.0 / 30.0
_IDLE_S = 0.25
_JOIN_S = 2.0
_LAST_S = 0.5
"""How long the last events wait for a console whose queue is full, wall clock."""
_RETRY_S = 0.01
_MOST_EVENTS = 1000
_LONGEST_TEXT = 2000
_SHORT_FACTS = ("case", "mode", "rep", "seed", "epoch_ns", "clock", "mounts")

Note = Callable[[str], None]


@dataclass(slots=True)
class _Console:
    """A console that receives the feed. sent: the number of its newest event."""

    sender: FeedSender
    knows_facts: bool = False
    sent: int = 0


class FeedPublisher:
    """Publishes the live feed of one run to all consoles; a context manager.

    time: of the run clock. facts: called by the thread for each new console. note: receives the
    reason, when the context is left, if the feed ended early.
    """

    def __init__(
        self,
        *,
        run: str,
        time: Callable[[], float],
        facts: Callable[[], Mapping[str, str]],
        note: Note,
    ) -> None:
        self._run = run
        self._time = time
        self._facts = facts
        self._note = note
        self._fault = ""
        self._has_consoles = False
        self._wants_view = False
        self._view: RunView | None = None
        self._images: dict[str, tuple[CameraReading, float, str]] = {}
        self._events: deque[EventView] = deque(maxlen=_MOST_EVENTS)
        self._count = 0
        self._woken = threading.Event()
        self._is_over = False
        self._consoles: dict[Path, _Console] = {}
        self._due_s: dict[str, float] = {}
        self._thread = threading.Thread(target=self._work, name=f"live feed {run}", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._woken.set()
        self._thread.join(_JOIN_S)
        if self._fault:
            self._note(self._fault)

    def tick(self, view: Callable[[], RunView]) -> None:
        """Publish the run's state, if a view is due for a console."""
        if not self._wants_view:
            return
        self._wants_view = False
        try:
            self._view = view()
        except FAULTS as error:
            self._end(error)
        self._woken.set()

    def images(self, shown: PreviewImages) -> None:
        """Publish the images of a mixture; each replaces an unsent one."""
        if not self._has_consoles:
            return
        readings = {"real": shown.real, "twin": shown.twin, "mixed": shown.perceived}
        if shown.perceived is shown.real:
            del readings["mixed"]
        now_s = self._time()
        alone = {"mixed": shown.alone}
        self._images |= {
            name: (reading, now_s, alone.get(name, ""))
            for name, reading in readings.items()
            if reading is not None
        }
        self._woken.set()

    def event(
        self,
        t_s: float,
        kind: str,
        word: str,
        text: str,
        *,
        vehicle: str = "",
        severity: int | None = None,
    ) -> None:
        """Publish an event; later consoles get it too."""
        self._count += 1
        self._events.append(
            EventView(
                self._run, self._count, t_s, kind, word, vehicle, text[:_LONGEST_TEXT], severity
            )
        )
        if self._has_consoles:
            self._woken.set()

    def _end(self, error: BaseException) -> None:
        """End the feed after an exception; the flight continues without it."""
        self._fault = f"the live feed ended: {type(error).__name__}: {error}"
        self._has_consoles = self._wants_view = False

    def _work(self) -> None:
        """Send to consoles until the run is over (the thread's function)."""
        search_s = 0.0
        try:
            while not self._fault:
                is_last = self._is_over
                if (now_s := time.monotonic()) >= search_s:
                    search_s = now_s + _SEARCH_S
                    self._find_consoles()
                if self._consoles:
                    self._send_all(now_s)
                if is_last:
                    self._send_last_events(now_s + _LAST_S)
                    break
                self._woken.wait(self._sleep_s(now_s, search_s))
                self._woken.clear()
        except FAULTS as error:
            self._end(error)
        finally:
            for console in self._consoles.values():
                console.sender.close()

    def _sleep_s(self, now_s: float, search_s: float) -> float:
        """Return how long the thread may sleep unless it is woken."""
        if not self._consoles:
            return max(0.0, search_s - now_s)
        dues_s = [due_s - now_s for due_s in self._due_s.values() if due_s > now_s]
        return min([_IDLE_S, *dues_s])

    def _find_consoles(self) -> None:
        """Connect to new consoles, and drop those that are gone."""
        found = find_console_sockets()
        for path in self._consoles.keys() - found:
            self._consoles.pop(path).sender.close()
        for path in found - self._consoles.keys():
            try:
                self._consoles[path] = _Console(FeedSender(path))
            except OSError:
                continue  # its process may just have ended
        self._has_consoles = bool(self._consoles)
        if not self._has_consoles:
            self._wants_view = False
            self._images = {}

    def _send_all(self, now_s: float) -> None:
        """Send what is new and due to every console."""
        self._catch_up_all()
        if (view := self._view) is not None and self._is_due("view", now_s, _VIEW_S):
            self._view = None
            self._send(view)
        if self._view is None and self._due_s.get("view", 0.0) <= now_s:
            self._wants_view = True
        for name in tuple(self._images):
            if self._is_due(name, now_s, _IMAGE_S):
                reading, at_s, alone = self._images.pop(name)
                image = image_view(self._run, name, reading, at_s)
                self._send(msgspec.structs.replace(image, alone=alone))

    def _is_due(self, name: str, now_s: float, period_s: float) -> bool:
        if now_s < self._due_s.get(name, 0.0):
            return False
        self._due_s[name] = now_s + period_s
        return True

    def _catch_up_all(self) -> None:
        """Send every console what it lacks; drop those that are gone."""
        for path, console in tuple(self._consoles.items()):
            try:
                self._catch_up(console)
            except OSError:
                self._consoles.pop(path).sender.close()

    def _catch_up(self, console: _Console) -> None:
        """Send a console the facts and events that it lacks, until its queue is full."""
        if not console.knows_facts:
            console.knows_facts = console.sender.send(self._encoded_facts())
            if not console.knows_facts:
                return
        for event in tuple(self._events):
            if event.number > console.sent:
                if not console.sender.send(feed_codec.encode(event)):
                    return
                console.sent = event.number

    def _send_last_events(self, until_s: float) -> None:
        """Send the events that a full queue kept from a console, as long as there is time."""
        while any(console.sent < self._count for console in self._consoles.values()):
            if time.monotonic() >= until_s:
                return
            time.sleep(_RETRY_S)
            self._catch_up_all()

    def _encoded_facts(self) -> bytes:
        """Return the run's facts as a datagram; only the short ones if they are too long."""
        facts = dict(self._facts())
        datagram = feed_codec.encode(FactsView(self._run, facts))
        if len(datagram) > LONGEST_DATAGRAM_BYTES:
            named = {key: facts[key] for key in _SHORT_FACTS if key in facts}
            datagram = feed_codec.encode(FactsView(self._run, named))
        return datagram

    def _send(self, message: FeedMessage) -> None:
        datagram = feed_codec.encode(message)
        if len(datagram) > LONGEST_DATAGRAM_BYTES:
            return
        for path, console in tuple(self._consoles.items()):
            try:
                console.sender.send(datagram)
            except OSError:
                self._consoles.pop(path).sender.close()
