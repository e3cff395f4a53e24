"""Decides when a vehicle can arm and take off, by more than the pre-arm bit.

ArduCopter's pre-arm bit turns true long before its estimator uses GPS (23 s and 41 s in a
simulated boot), and arming in GUIDED in between is refused or drifts. So the estimator's own
flags decide, together with the bit, the system status and the landed state.
"""

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_ATTITUDE = mavlink.ESTIMATOR_ATTITUDE
_VELOCITY = mavlink.ESTIMATOR_VELOCITY_HORIZ | mavlink.ESTIMATOR_VELOCITY_VERT
_HORIZONTAL = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_HORIZ_ABS
_VERTICAL = mavlink.ESTIMATOR_POS_VERT_ABS | mavlink.ESTIMATOR_POS_VERT_AGL


@dataclass(frozen=True, slots=True)
class ReadinessRules:
    """How autopilots differ in readiness: sensors, estimator flags, pre-arm texts.

    estimator_message: the name of the message with the estimator's flags. forbidden_flags: none of
    them may be set. needs_home: whether a home position must be known. glitch: the flag of a GPS
    that the estimator rejects, and its name.
    """

    estimator_message: str
    forbidden_flags: int
    needs_home: bool
    glitch: tuple[int, str]


class Readiness:
    """Tracks an autopilot's readiness from its messages; pure."""

    def __init__(self, rules: ReadinessRules) -> None:
        self._rules = rules
        self._system_status: int | None = None
        self._prearm_ok: bool | None = None
        self._flags: int | None = None
        self._landed_state: int | None = None
        self._home_known = False

    @property
    def ready(self) -> bool:
        """Return whether there is no reason against arming."""
        return not self.reasons()

    @property
    def prearm_failed(self) -> bool:
        """Return whether the autopilot's pre-arm checks have failed."""
        return self._prearm_ok is False

    def feed(self, message: Any) -> None:
        """Update the readiness by a message of the autopilot; unrelated messages are ignored."""
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._system_status = message.system_status
        elif kind == "SYS_STATUS":
            # PX4 leaves `present` and `enabled` at 0 until the check has passed once.
            health: int = message.onboard_control_sensors_health
            self._prearm_ok = bool(health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        elif kind == self._rules.estimator_message:
            self._flags = message.flags
        elif kind == "EXTENDED_SYS_STATE":
            self._landed_state = message.landed_state
        elif kind == "HOME_POSITION":
            self._home_known = True

    def reasons(self) -> tuple[str, ...]:
        """Return the reasons against arming, in words; empty when ready."""
        reasons = [
            self._status_reason(),
            self._landed_reason(),
            *self.estimator_faults(),
            self._prearm_reason(),
            "no home position" if self._rules.needs_home and not self._home_known else "",
        ]
        return tuple(reason for reason in reasons if reason)

    def _status_reason(self) -> str:
        status = self._system_status
        if status in {mavlink.MAV_STATE_STANDBY, mavlink.MAV_STATE_ACTIVE}:
            return ""
        if status is None:
            return "no heartbeat"
        entry = mavlink.enums["MAV_STATE"].get(status)
        name = entry.name.removeprefix("MAV_STATE_").lower() if entry else str(status)
        return f"system status is {name}, not standby"

    def _landed_reason(self) -> str:
        if self._landed_state in {mavlink.MAV_LANDED_STATE_ON_GROUND, None}:
            return "" if self._landed_state else "landed state unknown"
        if self._landed_state == mavlink.MAV_LANDED_STATE_UNDEFINED:
            return "landed state unknown"
        return "it is not on the ground"

    def estimator_faults(self) -> tuple[str, ...]:
        """Return what is wrong with the estimator by its flags, in words."""
        flags = self._flags
        if flags is None:
            return (f"no {self._rules.estimator_message}",)
        if flags & self._rules.forbidden_flags & mavlink.EKF_UNINITIALIZED:
            return ("the estimator is not initialised",)
        reasons = []
        if not flags & _ATTITUDE:
            reasons.append("the estimator has no attitude")
        if flags & _VELOCITY != _VELOCITY:
            reasons.append("the estimator has no velocity")
        if not flags & _HORIZONTAL or (
            flags & self._rules.forbidden_flags & mavlink.ESTIMATOR_CONST_POS_MODE
        ):
            reasons.append("the estimator has no horizontal position (GPS or vision not in use)")
        if not flags & _VERTICAL:
            reasons.append("the estimator has no height")
        return tuple(reasons)

    def _prearm_reason(self) -> str:
        if self._prearm_ok is None:
            return "no SYS_STATUS"
        return "" if self._prearm_ok else "pre-arm checks have not passed"
