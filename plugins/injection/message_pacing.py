"""Paces injected messages to the autopilot at their rates, and drops stale ones; pure."""

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class InjectionPlan:
    """The pacing of an injected message: how often it is sent, how old it may be.

    rate_hz: highest rate; a slower feed is sent as it comes. max_age_s: older messages are not
    sent, so that the autopilot's own time-out detects a dead feed.
    """

    rate_hz: float
    max_age_s: float

    def __post_init__(self) -> None:
        if not (0.0 < self.rate_hz < math.inf and self.max_age_s > 0.0):
            raise ValueError(f"{self}: rate_hz and max_age_s must be positive")


_EARLY = 0.1
"""Tolerated share of a period: a feed of the same rate with jitter is sent whole."""

PLANS: dict[str, InjectionPlan] = {
    # ArduPilot and PX4 forget obstacles after 0.5 s.
    "obstacle_distance": InjectionPlan(10.0, 0.2),
    "distance_sensor": InjectionPlan(20.0, 0.2),
    # Transponders send once a second; ArduPilot forgets after 5 s.
    "adsb_vehicle": InjectionPlan(1.0, 2.0),
    "collision": InjectionPlan(10.0, 0.5),
    # ArduPilot forgets after 1 s, PX4 after PLD_BTOUT.
    "landing_target": InjectionPlan(20.0, 0.2),
    # PX4 requires gaps below 0.2 s, ArduPilot below 0.3 s; both recommend 30 to 50 Hz.
    "vision_position_estimate": InjectionPlan(50.0, 0.1),
    "odometry": InjectionPlan(50.0, 0.1),
}
"""Default plans, by the name of the injected message; see docs/delivery.md."""


class PacedMessages:
    """Paces messages of one kind: holds the newest and returns it when due."""

    def __init__(self, plan: InjectionPlan) -> None:
        self._plan = plan
        self._message: Any = None
        self._t_s = -math.inf
        self._due_s = -math.inf
        self.sent = 0
        self.replaced = 0
        self.stale = 0

    def offer(self, message: Any, t_s: float) -> None:
        """Offer a message of a run-clock time; it replaces an unsent earlier one."""
        self.replaced += self._message is not None
        self._message, self._t_s = message, t_s

    def due(self, now_s: float) -> Any | None:
        """Return the message that is due to be sent now; each at most once."""
        if self._message is None or now_s < self._due_s - _EARLY / self._plan.rate_hz:
            return None
        message, self._message = self._message, None
        if now_s - self._t_s > self._plan.max_age_s:
            self.stale += 1
            return None
        period_s = 1.0 / self._plan.rate_hz
        self._due_s = (now_s if now_s - self._due_s >= period_s else self._due_s) + period_s
        self.sent += 1
        return message
