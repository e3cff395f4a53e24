"""External motion capture inputs, for the vehicles whose pose they measure."""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from typing import Protocol, Self

from wil_campaign.campaigns.values.external_setups import MocapSetup
from wil_campaign.hooks import motion_captures
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.run_results.result_parts import CaptureResult
from wil_campaign.vehicles.readings import PoseReading, Source
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.feed_statistics import FeedStatistics

Listener = Callable[[PoseReading], None]

_FIRST_S = 5.0
"""How long to wait for the first pose of a body: every system sends many per second."""
_POLL_S = 0.05


class CaptureMessages(Protocol):
    """The messages of a motion capture (protocol). garbage: how many could not be read.

    complaint: why the last of those could not.
    """

    garbage: int
    complaint: str

    def statistics(self, name: str) -> FeedStatistics:
        """Return the statistics of a body's feed."""


class CaptureInput(Protocol):
    """A motion capture's input, as a plugin gives it to a run (protocol).

    An async context manager.
    """

    @property
    def capture(self) -> CaptureMessages:
        """Return what is known of the messages."""

    @property
    def others(self) -> Mapping[str, str]:
        """Return messages about senders whose poses are not taken, by their address."""

    @property
    def rivals(self) -> str:
        """Return in words which other senders there are, where none was named; "" without any."""

    async def __aenter__(self) -> Self:
        """Open the input. Raises SourceError."""

    async def __aexit__(self, *_: object) -> None:
        """Close the input; nothing is delivered afterwards."""


@dataclass(slots=True)
class _Feed:
    """The motion capture feed of one vehicle, with its listeners."""

    setup: MocapSetup
    capture: CaptureMessages
    listeners: list[Listener] = field(default_factory=list)
    last_s: float | None = None


class MotionCaptures:
    """A run's motion capture inputs; vehicles with one address share one input."""

    def __init__(self, setups: Mapping[Source, MocapSetup]) -> None:
        self._feeds: dict[Source, _Feed] = {}
        self._inputs: list[CaptureInput] = []
        groups: dict[tuple[object, ...], dict[Source, MocapSetup]] = {}
        for vehicle, setup in setups.items():
            more = (setup.topic, setup.latency_s, setup.sender)
            key = (setup.kind, setup.host, setup.port, *more)
            groups.setdefault(key, {})[vehicle] = setup
        for group in groups.values():
            self._add_input(group)

    async def open(self, stack: AsyncExitStack) -> None:
        """Open all motion capture inputs. Raises SourceError."""
        for capture_input in self._inputs:
            await stack.enter_async_context(capture_input)

    def listen(self, vehicle: Source, listener: Listener) -> bool:
        """Call `listener` with each motion capture pose of a vehicle; False without feed."""
        if vehicle not in self._feeds:
            return False
        self._feeds[vehicle].listeners.append(listener)
        return True

    async def ready(self, within_s: float = _FIRST_S) -> None:
        """Wait until motion capture has a pose of every vehicle. Raises SourceError."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + within_s
        for vehicle, feed in self._feeds.items():
            while feed.last_s is None:
                if loop.time() > deadline_s:
                    raise SourceError(_unseen_text(vehicle, feed, within_s))
                await asyncio.sleep(_POLL_S)

    @property
    def others(self) -> tuple[str, ...]:
        """Return messages about senders whose poses are not taken."""
        return tuple(
            text for capture_input in self._inputs for text in capture_input.others.values()
        )

    def refuse_rivals(self) -> None:
        """Refuse two senders of poses to one port, of which the campaign names neither.

        Which of them is the system is not known. Raises SourceError.
        """
        for capture_input in self._inputs:
            if capture_input.rivals:
                raise SourceError(
                    f"{capture_input.rivals}: which of them is your system is not known; "
                    "end the other, or name its address by mocap.sender"
                )

    def silent(self, now_s: float) -> str:
        """Return in words which vehicle has had no pose for too long; "" for none."""
        for vehicle, feed in self._feeds.items():
            gap_s = now_s - (feed.last_s if feed.last_s is not None else now_s)
            if gap_s > feed.setup.stall_s:
                return (
                    f"motion capture at {feed.setup.address} has not seen '{feed.setup.body}' "
                    f"({vehicle}) for more than {feed.setup.stall_s:g} s"
                )
        return ""

    @property
    def results(self) -> tuple[CaptureResult, ...]:
        """Return the figures of each vehicle's motion capture feed."""
        return tuple(
            CaptureResult(
                vehicle=vehicle,
                address=feed.setup.address,
                feed=feed.capture.statistics(feed.setup.body),
                garbage=feed.capture.garbage,
                trouble="; ".join(filter(None, (feed.capture.complaint, *self.others))),
            )
            for vehicle, feed in self._feeds.items()
        )

    def _add_input(self, group: Mapping[Source, MocapSetup]) -> None:
        kind = next(iter(group.values())).kind
        made: CaptureInput = load_plugin_object(plugin_additions(motion_captures)[kind].open)(
            group, self._deliver
        )
        for vehicle, mocap in group.items():
            self._feeds[vehicle] = _Feed(mocap, made.capture)
        self._inputs.append(made)

    def _deliver(self, reading: PoseReading) -> None:
        feed = self._feeds[reading.source]
        feed.last_s = reading.arrived_s
        for listener in feed.listeners:
            listener(reading)


def _unseen_text(vehicle: Source, feed: _Feed, within_s: float) -> str:
    """Return in words why motion capture has no pose of a vehicle."""
    setup, capture = feed.setup, feed.capture
    figures = capture.statistics(setup.body)
    if capture.garbage:
        cause = f"{capture.garbage} messages cannot be read ({capture.complaint})"
    elif figures.invalid:
        cause = f"{figures.invalid} frames did not contain it; check its name and its markers"
    else:
        cause = "no message arrived; check that they are sent to this host and port"
    return (
        f"motion capture at {setup.address} did not show '{setup.body}' ({vehicle}) within "
        f"{within_s:g} s: {cause}"
    )
