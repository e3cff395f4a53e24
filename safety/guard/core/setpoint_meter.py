"""Limits the setpoint frames of one vehicle, and reports which limits took effect."""

import math
from dataclasses import dataclass

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.stopping import Motion
from wil_campaign.safety.guard.core.setpoint_frames import rewritten
from wil_campaign.safety.guard.core.setpoint_limiter import LimitReport, SetpointLimiter
from wil_campaign.vehicles.mavlink.framing import Frame
from wil_campaign.vehicles.mavlink.names import message_name
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.vehicles.setpoints import Setpoint

_LAPSE_S = 1.0
"""A limit without effect for this time is reported as ended."""


@dataclass(slots=True)
class _LimitingSpell:
    """A time over which one setpoint limit took effect again and again."""

    count: int
    worst: LimitReport
    last_s: float


class SetpointMeter:
    """Forwards one vehicle's setpoint frames within limits; `notes` are for the log.

    Each limit is reported when it begins to take effect; and after a second without effect, how
    often it did and for which largest value.
    """

    def __init__(self, limiter: SetpointLimiter) -> None:
        self._limiter = limiter
        self._spells: dict[str, _LimitingSpell] = {}
        self.notes: list[str] = []

    def change_fence(self, fence: Fence) -> None:
        """Limit setpoints to another fence from now on."""
        self._limiter.change_fence(fence)

    def through(
        self,
        frame: Frame,
        asked: Setpoint | None,
        anchor: Anchor | None,
        motion: Motion | None,
        t_s: float,
    ) -> tuple[bytes | None, Setpoint | None]:
        """Return the frame to forward and its setpoint; None if nothing is forwarded.

        asked: the frame's setpoint in the world frame; None if it cannot be limited.
        """
        if asked is None:
            name = message_name(frame.message_id)
            self._note(LimitReport(f"{name} cannot be limited and is", 1.0, 0.0, ""), t_s)
            return None, None
        given, found = self._limiter.limit(asked, motion, t_s)
        for one in found:
            self._note(one, t_s)
        if given is None or not found:
            return None if given is None else frame.raw, given
        return rewritten(frame, given, anchor), given

    def lapse(self, t_s: float) -> None:
        """Take that time has passed: report the limits that have ended."""
        for what, spell in tuple(self._spells.items()):
            if t_s - spell.last_s > _LAPSE_S:
                del self._spells[what]
                if spell.count > 1:
                    note = f"{_report_text(spell.worst)}: {spell.count} times, this the worst"
                    self.notes.append(note)

    def _note(self, limiting: LimitReport, t_s: float) -> None:
        spell = self._spells.get(limiting.what)
        if spell is None:
            self._spells[limiting.what] = _LimitingSpell(1, limiting, t_s)
            self.notes.append(_report_text(limiting))
            return
        spell.count += 1
        spell.last_s = t_s
        if _excess_of(limiting) > _excess_of(spell.worst):
            spell.worst = limiting


def _excess_of(limiting: LimitReport) -> float:
    return abs(limiting.asked - limiting.given)


def _report_text(limiting: LimitReport) -> str:
    if not limiting.unit:
        return f"{limiting.what} is not forwarded"
    asked = "any" if math.isinf(limiting.asked) else f"{limiting.asked:.2f}"
    return f"{limiting.what} limited from {asked} to {limiting.given:.2f} {limiting.unit}"
