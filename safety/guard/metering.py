"""Setpoint frames of one vehicle on their way through the guard: limited, and told of."""

import math
from dataclasses import dataclass

from safety.geofence import Fence
from safety.guard.limiting import Limiting, Motion, SetpointLimiter
from safety.guard.setpoint_frames import read_setpoint, rewritten
from vehicles.anchor import Anchor
from vehicles.mavlink.framing import Frame
from vehicles.mavlink.names import message_name

_LAPSE_S = 1.0
"""A limit that took no effect for so long is told to be over."""


@dataclass(slots=True)
class _Spell:
    """A time over which one limit took effect again and again."""

    count: int
    worst: Limiting
    last_s: float


class Meter:
    """Passes setpoint frames of one vehicle within its limits; `notes` are for the record.

    Each limit is told when it begins to take effect, and, once it has not for a second, how often
    it did and what the most was that was asked.
    """

    def __init__(self, limiter: SetpointLimiter) -> None:
        self._limiter = limiter
        self._spells: dict[str, _Spell] = {}
        self.notes: list[str] = []

    def change_fence(self, fence: Fence) -> None:
        """Hold setpoints to another fence from now on."""
        self._limiter.change_fence(fence)

    def through(
        self, frame: Frame, anchor: Anchor | None, motion: Motion | None, t_s: float
    ) -> bytes | None:
        """Return the frame that may be passed; None when nothing may."""
        asked = read_setpoint(frame, anchor)
        if asked is None:
            name = message_name(frame.message_id)
            self._note(Limiting(f"{name} cannot be limited and", 1.0, 0.0, ""), t_s)
            return None
        given, found = self._limiter.limit(asked, motion, t_s)
        for one in found:
            self._note(one, t_s)
        if given is None or not found:
            return None if given is None else frame.raw
        return rewritten(frame, given, anchor)

    def lapse(self, t_s: float) -> None:
        """Take that time has passed: what took no effect for a while is over."""
        for what, spell in tuple(self._spells.items()):
            if t_s - spell.last_s > _LAPSE_S:
                del self._spells[what]
                if spell.count > 1:
                    said = f"{_said(spell.worst)}: {spell.count} times, this the worst"
                    self.notes.append(said)

    def _note(self, limiting: Limiting, t_s: float) -> None:
        spell = self._spells.get(limiting.what)
        if spell is None:
            self._spells[limiting.what] = _Spell(1, limiting, t_s)
            self.notes.append(_said(limiting))
            return
        spell.count += 1
        spell.last_s = t_s
        if _excess(limiting) > _excess(spell.worst):
            spell.worst = limiting


def _excess(limiting: Limiting) -> float:
    return abs(limiting.asked - limiting.given)


def _said(limiting: Limiting) -> str:
    if not limiting.unit:
        return f"{limiting.what} is not passed"
    asked = "any" if math.isinf(limiting.asked) else f"{limiting.asked:.2f}"
    return f"{limiting.what} limited from {asked} to {limiting.given:.2f} {limiting.unit}"
