"""Keeps the newest state of runs and campaigns, and sends it to all open pages.

When each vehicle of a run came down, by its states, its events or its guard.
"""

import asyncio
import re
import time
from collections import OrderedDict, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import msgspec

from wil_campaign.plugins.console.console_access import ConsoleAccess
from wil_campaign.plugins.console.feed.feed_messages import (
    EventView,
    FactsView,
    FeedMessage,
    ImageView,
    RunView,
    VehicleView,
)
from wil_campaign.plugins.console.page_client import PageClient, image_packet, page_json
from wil_campaign.plugins.console.scene_document import RunScene

_GUARD_DOWN = re.compile(r": down\b")


class DownTimes:
    """The vehicles of a run that are down: on the ground and disarmed. Times: seconds since 1970.

    A state in which a vehicle is up or armed removes it.
    """

    def __init__(self) -> None:
        self._at_s: dict[str, float] = {}

    @property
    def at_s(self) -> Mapping[str, float]:
        """Return since when each vehicle that is down is known to be."""
        return self._at_s

    def add(self, vehicle: str, at_s: float) -> None:
        """Record that a vehicle is down; an earlier time stays."""
        self._at_s.setdefault(vehicle, at_s)

    def receive_view(self, view: RunView, at_s: float) -> None:
        """Record which vehicles are down in a run's state; one without a message has none."""
        for vehicle in view.vehicles:
            if vehicle.silent_s is None:
                continue
            if _is_down(vehicle):
                self.add(vehicle.name, at_s)
            else:
                self._at_s.pop(vehicle.name, None)

    def receive_event(self, event: EventView, newest: RunView | None, at_s: float) -> float | None:
        """Record a landing by an event; return its time, None for any other event.

        newest: the run's state; an event may arrive after a newer one, and is no news then.
        """
        is_landing = (event.kind == "guard" and _GUARD_DOWN.search(event.text) is not None) or (
            event.kind == "vehicle" and event.word == "disarmed"
        )
        if not is_landing or not event.vehicle or newest is None or event.t_s < newest.t_s:
            return None
        self.add(event.vehicle, at_s)
        return self._at_s[event.vehicle]


def _is_down(vehicle: VehicleView) -> bool:
    """Return whether a vehicle is disarmed, and on the ground as far as it says."""
    return not vehicle.armed and vehicle.landed in {"", "on_ground"}


_MOST_RUNS = 8
"""Runs that are kept; a new one replaces the one that was silent longest."""
_MOST_EVENTS = 1000
_MOST_COMMANDS = 100

Content = TypeVar("Content")


@dataclass(frozen=True, slots=True)
class _Received(Generic[Content]):
    """What the hub received, and when: at_s since 1970; monotonic_s for its age."""

    content: Content
    at_s: float
    monotonic_s: float

    @classmethod
    def now(cls, content: Content) -> "_Received[Content]":
        return cls(content, time.time(), time.monotonic())

    @property
    def age_s(self) -> float:
        """Return the time since the reception."""
        return time.monotonic() - self.monotonic_s


@dataclass(slots=True)
class _RunRecord:
    """The newest messages of one run. down: when each vehicle that is down was received as such."""

    scene: RunScene | None = None
    newest: _Received[RunView] | None = None
    images: dict[str, _Received[ImageView]] = field(default_factory=dict)
    events: deque[str] = field(default_factory=lambda: deque(maxlen=_MOST_EVENTS))
    down: DownTimes = field(default_factory=DownTimes)

    def view_text(self, received: _Received[RunView]) -> str:
        """Return a run's state for the page, with the poses of its moving objects."""
        view = received.content
        moving = {} if self.scene is None else self.scene.moving(view.t_s, view.events)
        moving |= {name: msgspec.structs.asdict(pose) for name, pose in view.flown.items()}
        state = {**msgspec.structs.asdict(view), "flown": sorted(view.flown)}
        when = {"at_s": received.at_s, "age_s": received.age_s, "down_at_s": self.down.at_s}
        return page_json({"type": "run", "moving": moving, **state, **when})

    def event_text(self, event: EventView) -> str:
        """Return an event for the page, with when it was received, and whether it is a landing."""
        at_s = time.time()
        newest = None if self.newest is None else self.newest.content
        down_at_s = self.down.receive_event(event, newest, at_s)
        document = msgspec.structs.asdict(event)
        return page_json({"type": "event", **document, "at_s": at_s, "down_at_s": down_at_s})


class ConsoleHub:
    """Forwards live feeds and statuses to all open pages; a new page gets the present state.

    about: the first message to every page. access: knows which session has control.
    """

    def __init__(self, *, about: Mapping[str, Any], access: ConsoleAccess) -> None:
        self._about = dict(about)
        self._is_recorded = about.get("mode") == "recorded"
        self._playback = ""
        self._access = access
        self._pages: set[PageClient] = set()
        self._runs: OrderedDict[str, _RunRecord] = OrderedDict()
        self._status: _Received[dict[str, Any]] | None = None
        self._commands: deque[str] = deque(maxlen=_MOST_COMMANDS)

    def join(self, page: PageClient) -> None:
        """Add a page: send it the present state, and from now on every update."""
        session = page.session
        you = {"number": session.number, "role": session.role, "name": session.name}
        page.order(page_json({"type": "hello", "you": you, **self._about}))
        for text in self._commands:
            page.order(text)
        for key, record in self._runs.items():
            if record.scene is not None:
                page.order(page_json(record.scene.document))
            for text in record.events:
                page.order(text)
            if record.newest is not None:
                page.show(f"run {key}", record.view_text(record.newest))
            for name, image in record.images.items():
                packet = image_packet(image.content, waited_s=image.age_s)
                page.show_image(f"{key} {name}", packet)
        if self._playback:
            page.show("playback", self._playback)
        if self._status is not None:
            page.show("status", _status_text(self._status))
        self._pages.add(page)
        self.show_people()

    def leave(self, page: PageClient) -> None:
        """Remove a closed page."""
        self._pages.discard(page)
        self.show_people()

    def views(self) -> list[RunView]:
        """Return the newest states of all known runs."""
        return [run.newest.content for run in self._runs.values() if run.newest is not None]

    def say_goodbye(self) -> None:
        """Tell all pages that the console ends with its campaign."""
        self._order(page_json({"type": "goodbye"}))

    def show_people(self) -> None:
        """Send all pages the list of open sessions, and which has control."""
        holder = self._access.in_control
        people = {
            session.number: {"number": session.number, "role": session.role, "name": session.name}
            for session in (page.session for page in self._pages)
        }
        text = page_json(
            {
                "type": "people",
                "people": list(people.values()),
                "in_control": None if holder is None else holder.number,
                "holder": "" if holder is None else holder.name,
            }
        )
        self._order(text)

    def show_status(self, document: Mapping[str, Any]) -> None:
        """Send all pages the status of campaigns and guards; also the server's heartbeat."""
        guards = [self._receive_guard(guard) for guard in document["guards"]]
        self._status = _Received.now({**document, "guards": guards})
        text = _status_text(self._status)
        for page in self._pages:
            page.show("status", text)

    def show_playback(self, kind: str, document: Mapping[str, Any]) -> None:
        """Send all pages the playback of a finished run, or the past of the run that it shows."""
        text = page_json({"type": kind, **document})
        if kind == "past":
            self._order(text)
            return
        self._playback = text
        for page in self._pages:
            page.show(kind, text)

    def _receive_guard(self, guard: Mapping[str, Any]) -> dict[str, Any]:
        """Record which vehicles a guard reports down; return its status with the times."""
        record = self._runs.get(guard["folder"])
        if record is None:
            return dict(guard)
        phases = guard.get("vehicles", {})
        down = [name for name, phase in phases.items() if phase == "down"]
        for name in down:
            record.down.add(name, time.time())
        return {**guard, "down_at_s": {name: record.down.at_s[name] for name in down}}

    def show_command(self, document: Mapping[str, Any]) -> None:
        """Send all pages, also later ones, a command of this console and its replies."""
        text = page_json({"type": "command", "at_s": time.time(), **document})
        self._commands.append(text)
        self._order(text)

    async def receive(self, message: FeedMessage) -> None:
        """Take a message of a live feed."""
        record = self._record(message.run)
        match message:
            case RunView():
                record.newest = received = _Received.now(message)
                record.down.receive_view(message, received.at_s)
                text = record.view_text(received)
                for page in self._pages:
                    page.show(f"run {message.run}", text)
            case ImageView():
                record.images[message.name] = _Received.now(message)
                packet = image_packet(message)
                for page in self._pages:
                    page.show_image(f"{message.run} {message.name}", packet)
            case EventView():
                text = record.event_text(message)
                record.events.append(text)
                self._order(text)
            case FactsView():
                # In a thread: reading meshes from files must not delay commands.
                scene = await asyncio.to_thread(RunScene.of, message.run, message.facts)
                if self._is_recorded:
                    record.events.clear()  # The run is played again, or from another time.
                record.scene = scene
                self._order(page_json(scene.document))

    def _order(self, text: str) -> None:
        """Send all pages a message that must arrive."""
        for page in self._pages:
            page.order(text)

    def _record(self, run: str) -> _RunRecord:
        record = self._runs.setdefault(run, _RunRecord())
        self._runs.move_to_end(run)
        if len(self._runs) > _MOST_RUNS:
            self._runs.popitem(last=False)
        return record


def _status_text(status: _Received[dict[str, Any]]) -> str:
    """Return the status of campaigns and guards for the page."""
    sent_s = time.monotonic()  # a command says by it how old what the page shows was
    return page_json({"type": "status", **status.content, "age_s": status.age_s, "sent_s": sent_s})
