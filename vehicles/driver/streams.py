"""The telemetry plan: asked of the autopilot, and looked after that it comes."""

from functools import partial

from vehicles.autopilots.base import Autopilot, MessageRate, Target
from vehicles.driver.session import Session
from vehicles.mavlink.names import message_name

_SLACK = 3.0
"""A message counts as away after so many of its periods, and at least a second."""


class Streams:
    """Asks for each line of a plan, and knows which of them do not come.

    The requests go out all at once and their acknowledgements are not awaited: on a slow radio
    that would take seconds, and an acknowledged message that does not come helps nobody.
    """

    def __init__(
        self,
        *,
        session: Session,
        autopilot: Autopilot,
        target: Target,
        plan: tuple[MessageRate, ...],
    ) -> None:
        self._session = session
        self._autopilot = autopilot
        self._target = target
        self._plan = plan
        self._last_s: dict[int, float] = {}
        for line in plan:
            session.on_payload(line.message_id, partial(self._came, line.message_id))

    def ask(self) -> None:
        """Ask for the whole plan."""
        for line in self._plan:
            self._session.send(self._autopilot.ask_interval(self._target, line))

    def ask_missing(self, now_s: float) -> None:
        """Ask again for what does not come."""
        for line in self._plan:
            if self._away(line, now_s):
                self._session.send(self._autopilot.ask_interval(self._target, line))

    def missing(self, now_s: float) -> tuple[str, ...]:
        """Return the names of the required messages that do not come."""
        return tuple(
            message_name(line.message_id)
            for line in self._plan
            if line.required and self._away(line, now_s)
        )

    def rate_hz(self, message_id: int) -> float:
        """Return how often a message was asked for; 0 when it was not."""
        return next((line.rate_hz for line in self._plan if line.message_id == message_id), 0.0)

    def _away(self, line: MessageRate, now_s: float) -> bool:
        last_s = self._last_s.get(line.message_id)
        return last_s is None or now_s - last_s > max(1.0, _SLACK / line.rate_hz)

    def _came(self, message_id: int, _payload: bytes, t_s: float) -> None:
        self._last_s[message_id] = t_s
