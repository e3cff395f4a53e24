"""A pilot's sticks, and the behaviour that flies by them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    GuidanceBehaviour,
    GuidanceSpeeds,
    HoldBehaviour,
)
from wil_campaign.vehicles.embedded.control.target import ControlTarget
from wil_campaign.vehicles.embedded.physics.states import BodyMotion

_CENTRED = 0.05
"""A stick nearer to its centre than this counts as centred."""
_UNKNOWN_AXIS = 32767
_PWM_UNCHANGED, _PWM_RELEASED = 65535, 0


@dataclass(frozen=True, slots=True)
class Sticks:
    """The pilot's sticks, -1 to 1: forward, right, up, turn right. at_s: the vehicle's clock."""

    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    turn: float = 0.0
    at_s: float = 0.0

    @property
    def centred(self) -> bool:
        """Return whether the sticks are centred."""
        return max(map(abs, (self.forward, self.right, self.up, self.turn))) < _CENTRED


class StickLimits(NamedTuple):
    """The demand of fully deflected sticks: m/s across, up and down, rad/s of turn."""

    speeds: GuidanceSpeeds
    turn_rad_s: float


def sticks_of_manual(x: int, y: int, z: int, r: int, *, at_s: float) -> Sticks:
    """Return the sticks in a MANUAL_CONTROL: -1000 to 1000, z 0 to 1000; INT16_MAX is unknown."""
    return Sticks(_share(x), _share(y), _share(2 * z - 1000, unknown=z), _share(r), at_s)


def sticks_of_pulses(
    pulses_us: tuple[int, int, int, int], before: Sticks | None, *, at_s: float
) -> Sticks | None:
    """Return the sticks in RC_CHANNELS_OVERRIDE: roll, pitch, throttle, yaw.

    UINT16_MAX leaves a channel as it was; None when all are released (0).
    """
    if all(pulse_us == _PWM_RELEASED for pulse_us in pulses_us):
        return None
    last = before or Sticks()
    right, back, up, turn = (
        old
        if pulse_us in {_PWM_UNCHANGED, _PWM_RELEASED}
        else _clamp_share((pulse_us - 1500) / 500.0)
        for pulse_us, old in zip(
            pulses_us, (last.right, -last.forward, last.up, last.turn), strict=True
        )
    )
    return Sticks(-back, right, up, turn, at_s)


class FlyBySticks(GuidanceBehaviour):
    """The behaviour that flies the sticks' velocity in the heading's frame; centred: hold."""

    def __init__(
        self, *, sticks: Callable[[], Sticks | None], limits: StickLimits, yaw_rad: float
    ) -> None:
        super().__init__()
        self._sticks = sticks
        self._limits = limits
        self._hold = HoldBehaviour(speeds=limits.speeds, yaw_rad=yaw_rad)

    @property
    def lifts(self) -> bool:
        """Return whether the sticks demand a climb."""
        sticks = self._sticks()
        return sticks is not None and sticks.up > _CENTRED

    @property
    def descends(self) -> bool:
        """Return whether the sticks demand a descent."""
        sticks = self._sticks()
        return sticks is not None and sticks.up < -_CENTRED

    def update(self, now: BodyMotion, t_s: float) -> ControlTarget:
        """Return the sticks' velocity, or the position to hold."""
        sticks = self._sticks()
        if sticks is None or sticks.centred:
            return self._hold.update(now, t_s)
        speeds, yaw_rad = self._limits.speeds, now.euler_rad[2]
        self._hold = HoldBehaviour(speeds=speeds, yaw_rad=yaw_rad)
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        forward, right = sticks.forward * speeds.across, sticks.right * speeds.across
        down = -sticks.up * (speeds.up if sticks.up > 0.0 else speeds.down)
        return ControlTarget(
            (None, None, None),
            (forward * cos - right * sin, forward * sin + right * cos, down),
            None,
            sticks.turn * self._limits.turn_rad_s,
            speeds,
        )


def _share(value: int, *, unknown: int | None = None) -> float:
    """Return a stick's MANUAL_CONTROL axis as -1 to 1; 0 for unknown."""
    if _UNKNOWN_AXIS in {value, unknown}:
        return 0.0
    return _clamp_share(value / 1000.0)


def _clamp_share(share: float) -> float:
    """Return a stick's share clamped to -1 to 1."""
    return max(-1.0, min(1.0, share))
