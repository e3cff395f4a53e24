"""What an estimator had when its vehicle armed, and has lost since; pure."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_HAD = (
    (mavlink.ESTIMATOR_ATTITUDE, "its attitude", "ATTITUDE"),
    (mavlink.ESTIMATOR_VELOCITY_HORIZ, "its horizontal velocity", "VELOCITY_HORIZ"),
    (mavlink.ESTIMATOR_VELOCITY_VERT, "its vertical velocity", "VELOCITY_VERT"),
    (mavlink.ESTIMATOR_POS_VERT_ABS, "its absolute height", "POS_VERT_ABS"),
)
_PLACED_BY = (
    (mavlink.ESTIMATOR_POS_HORIZ_REL, "its relative position", "POS_HORIZ_REL"),
    (mavlink.ESTIMATOR_POS_HORIZ_ABS, "its absolute position", "POS_HORIZ_ABS"),
)
"""Flags of the same bits in ESTIMATOR_STATUS and EKF_STATUS_REPORT. A height above ground
(POS_VERT_AGL) comes and goes with what lies below; nothing is judged by it."""
_RECEIVERS = frozenset({"GPS_RAW_INT", "GPS2_RAW"})


@dataclass(frozen=True, slots=True)
class EstimatorLossReport:
    """What an estimator has lost, in words with its flags.

    others: of what it cannot fly without. position: of what holds its horizontal position in
    place; without that it goes on by dead reckoning.
    """

    others: tuple[str, ...] = ()
    position: tuple[str, ...] = ()


class EstimatorLosses:
    """Tracks an estimator's flags and its GPS receivers' fix from the time of arming on.

    Before arming there is nothing to lose: the readiness says what is missing. A receiver's fix
    counts where the estimator had an absolute position at arming, and of several the best one does.

    estimator_message: the name of the message with the flags. glitch: the flag of a GPS that the
    estimator rejects, with its name.
    """

    def __init__(self, *, estimator_message: str, glitch: tuple[int, str]) -> None:
        self._estimator_message = estimator_message
        self._glitch, self._glitch_name = glitch
        self._flags: int | None = None
        self._fixes: dict[str, int] = {}
        self._had: int | None = None
        self._had_fix = False

    def feed(self, message: Any) -> None:
        """Take a message of the autopilot; unrelated messages are ignored."""
        kind = message.get_type()
        if kind == self._estimator_message:
            self._flags = message.flags
        elif kind in _RECEIVERS:
            self._fixes[kind] = message.fix_type

    def arm(self, *, armed: bool) -> None:
        """Take whether the vehicle is armed."""
        if not armed:
            self._had, self._had_fix = None, False
        elif self._had is None and self._flags is not None:
            self._had = self._flags
            self._had_fix = bool(self._had & mavlink.ESTIMATOR_POS_HORIZ_ABS) and self._has_fix

    @property
    def lost(self) -> EstimatorLossReport:
        """Return what the estimator had when the vehicle armed and does not have now."""
        if self._had is None or self._flags is None:
            return EstimatorLossReport()
        gone = self._had & ~self._flags
        position = _lost_parts(gone, _PLACED_BY)
        if self._flags & ~self._had & self._glitch:
            position.append(f"the estimator rejects its GPS ({self._glitch_name})")
        if self._had_fix and not self._has_fix:
            fixes = ", ".join(f"{name} fix_type {fix}" for name, fix in self._fixes.items())
            position.append(f"its GPS has lost its fix ({fixes})")
        return EstimatorLossReport(tuple(_lost_parts(gone, _HAD)), tuple(position))

    @property
    def _has_fix(self) -> bool:
        best = max(self._fixes.values(), default=0)
        return bool(best >= mavlink.GPS_FIX_TYPE_3D_FIX)


def _lost_parts(gone: int, named: Iterable[tuple[int, str, str]]) -> list[str]:
    """Return in words which of the named flags are among those that are gone; empty for none."""
    lost = [(what, flag) for bit, what, flag in named if gone & bit]
    if not lost:
        return []
    things, flags = (", ".join(texts) for texts in zip(*lost, strict=True))
    return [f"the estimator has lost {things} ({flags})"]
