"""External motion capture inputs, for the vehicles whose pose they measure."""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field

from wil_campaign.campaigns.values.external_setups import MocapSetup
from wil_campaign.orchestrator.model.external_results import CaptureResult
from wil_campaign.vehicles.readings import PoseReading, Source
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.mocap.capture_inputs import UdpCapture, ZmqCapture
from wil_campaign.vehicles.sources.mocap.motion_capture import MotionCapture

Listener = Callable[[PoseReading], None]
Input = UdpCapture | ZmqCapture

_FIRST_S = 5.0
"""How long to wait for the first pose of a body: every system sends many per second."""
_POLL_S = 0.05


@dataclass(slots=True)
class _Feed:
    """The motion capture feed of one vehicle, with its listeners."""

    setup: MocapSetup
    capture: MotionCapture
    listeners: list[Listener] = field(default_factory=list)
    last_s: float | None = None


class MotionCaptures:
    """A run's motion capture inputs; vehicles with one address share one input."""

    def __init__(self, setups: Mapping[Source, MocapSetup]) -> None:
        self._feeds: dict[Source, _Feed] = {}
        self._inputs: list[Input] = []
        groups: dict[tuple[object, ...], dict[Source, MocapSetup]] = {}
        for vehicle, setup in setups.items():
            more = (setup.topic, setup.latency_s, setup.sender)
            key = (setup.kind, setup.host, setup.port, *more)
            groups.setdefault(key, {})[vehicle] = setup
        for group in groups.values():
            self._add_input(group)

    async def open(self, stack: AsyncExitStack) -> None:
        """Open all motion capture inputs. Raises SourceError."""
        for one in self._inputs:
            await stack.enter_async_context(one)

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
        udp = [one for one in self._inputs if isinstance(one, UdpCapture)]
        return tuple(text for one in udp for text in one.others.values())

    def refuse_rivals(self) -> None:
        """Refuse two senders of poses to one port, of which the campaign names neither.

        Which of them is the system is not known. Raises SourceError.
        """
        for one in self._inputs:
            if isinstance(one, UdpCapture) and one.rivals:
                raise SourceError(
                    f"{one.rivals}: which of them is your system is not known; end the other, or "
                    "name its address by mocap.sender"
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
        setup = next(iter(group.values()))
        capture = MotionCapture(
            bodies={one.body: vehicle for vehicle, one in group.items()},
            latency_s=setup.latency_s,
        )
        for vehicle, one in group.items():
            self._feeds[vehicle] = _Feed(one, capture)
        self._inputs.append(self._make_input(setup, capture))

    def _make_input(self, setup: MocapSetup, capture: MotionCapture) -> Input:
        if setup.kind == "udp":
            return UdpCapture(
                host=setup.host,
                port=setup.port,
                capture=capture,
                deliver=self._deliver,
                sender=setup.sender,
            )
        return ZmqCapture(
            address=setup.address,
            capture=capture,
            deliver=self._deliver,
            topic=setup.topic.encode(),
        )

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
