"""Requests the telemetry of a plan from the autopilot, and finds missing streams."""

import asyncio
from functools import partial

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget, MessageRate
from wil_campaign.vehicles.driver.session.repeater import Repeater
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.mavlink.names import message_name

_SLACK = 3.0
"""A message counts as missing after so many of its periods, and at least a second."""
_LEAST_RATE = 0.5
"""A message that comes at less than this part of its rate is requested again: the request was
lost, and the autopilot sends it at its default rate."""
_SHORTEST_COUNT_S = 1.0
_CHECK_EVERY_S = 2.0


class TelemetryStreams:
    """Requests the telemetry streams of a plan, and finds those that do not arrive.

    All requests go out at once and their acknowledgements are not awaited: on a slow radio that
    would take seconds, and only the arrival of the messages counts.
    """

    def __init__(
        self,
        *,
        session: MavlinkSession,
        autopilot: Autopilot,
        target: MavlinkTarget,
        plan: tuple[MessageRate, ...],
    ) -> None:
        self._session = session
        self._autopilot = autopilot
        self._target = target
        self._plan = plan
        self._last_s: dict[int, float] = {}
        self._counts = dict.fromkeys((line.message_id for line in plan), 0)
        self._earlier_counts = dict(self._counts)
        self._counted_from_s: float | None = None
        self._only_known = False
        self._watch = Repeater(period_s=_CHECK_EVERY_S, action=self._request_missing_now)
        for line in plan:
            session.on_payload(line.message_id, partial(self._on_message, line.message_id))

    def request(self) -> None:
        """Request all telemetry streams of the plan.

        In one packet: an autopilot that counts a stream's periods from its request then sends
        messages of the same rate together, and a relay is woken once for them.
        """
        requests = [self._autopilot.request_interval(self._target, line) for line in self._plan]
        self._session.send_together(requests)

    def watch(self, *, only_known: bool = False) -> None:
        """Request missing or slow streams again every 2 s from now on, until `stop`.

        A ground station at the same autopilot may change them at any time: REQUEST_DATA_STREAM
        overwrites the rates that were requested by SET_MESSAGE_INTERVAL. Rates are counted anew: a
        stream that has just begun is not slow. only_known: see `request_missing`.
        """
        self._counted_from_s = None
        self._only_known = only_known
        self._watch.stop()
        self._watch.start(at_once=False)

    def stop(self) -> None:
        """Stop requesting missing streams; may be called more than once."""
        self._watch.stop()

    def request_missing(self, now_s: float, *, only_known: bool = False) -> None:
        """Request again telemetry streams that are missing or too slow.

        only_known: not those of which nothing has ever come, as a vehicle without GPS has.
        """
        counted_from_s = now_s if self._counted_from_s is None else self._counted_from_s
        for line in self._plan:
            if only_known and line.message_id not in self._last_s:
                continue
            if self._is_missing(line, now_s) or self._is_slow(line, now_s - counted_from_s):
                self._session.send(self._autopilot.request_interval(self._target, line))
        if self._counted_from_s is None or now_s - counted_from_s >= _SHORTEST_COUNT_S:
            self._counted_from_s = now_s
            self._earlier_counts = dict(self._counts)

    def missing(self, now_s: float) -> tuple[str, ...]:
        """Return the required telemetry streams that do not arrive."""
        return tuple(
            message_name(line.message_id)
            for line in self._plan
            if line.required and self._is_missing(line, now_s)
        )

    def rate_hz(self, message_id: int) -> float:
        """Return the requested rate of a telemetry message; 0 when not requested."""
        return next((line.rate_hz for line in self._plan if line.message_id == message_id), 0.0)

    def _request_missing_now(self) -> None:
        self.request_missing(asyncio.get_running_loop().time(), only_known=self._only_known)

    def _is_missing(self, line: MessageRate, now_s: float) -> bool:
        last_s = self._last_s.get(line.message_id)
        return last_s is None or now_s - last_s > max(1.0, _SLACK / line.rate_hz)

    def _is_slow(self, line: MessageRate, elapsed_s: float) -> bool:
        came = self._counts[line.message_id] - self._earlier_counts[line.message_id]
        wanted = line.rate_hz * elapsed_s
        return elapsed_s >= _SHORTEST_COUNT_S and wanted >= 2.0 and came < _LEAST_RATE * wanted

    def _on_message(self, message_id: int, _payload: bytes, t_s: float) -> None:
        self._last_s[message_id] = t_s
        self._counts[message_id] += 1
