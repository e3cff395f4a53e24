"""The autopilot's own failsafe parameters, for the loss of its ground station or of setpoints.

The guard is the first line of defence; these are the second: the guard and its parent may both
die. Parameters: ArduCopter/Parameters.cpp and events.cpp; PX4's commander_params.c and
rtl_params.c.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from wil_campaign.vehicles.autopilots.autopilot import AutopilotName

OWN_SYSTEM_ID = 245
"""Our system id as a ground station, of driver and guard; its heartbeats prevent the vehicle's GCS
failsafe."""
_ARDUPILOT_LAND, _PX4_LAND = 5, 3
_CONTINUE_WITHOUT_GCS = 1 << 4
"""GCS_CONTINUE_IF_PILOT_CONTROL of FS_OPTIONS, set by default: a lost ground station changes
nothing in modes that are no autopilot's by mode.h, such as BRAKE, in which the guard holds."""
_ARDUPILOT_RETURNS = frozenset({1, 2, 3, 4, 6})
_EXCEPT_HOLD = 1 << 1
"""A bit of PX4's COM_DLL_EXCEPT: a lost ground station changes nothing in Hold."""
_SILENT_S = 5.0
"""Longer than the guard's time-out for a lost vehicle, so that the guard acts first."""

SILENCE_PARAMETERS: Mapping[AutopilotName, Mapping[str, float]] = {
    "ardupilot": {
        "FS_GCS_ENABLE": float(_ARDUPILOT_LAND),
        "FS_GCS_TIMEOUT": _SILENT_S,
        "FS_OPTIONS": 0.0,
        "MAV_GCS_SYSID": float(OWN_SYSTEM_ID),
    },
    "px4": {"NAV_DLL_ACT": float(_PX4_LAND), "COM_DL_LOSS_T": _SILENT_S},
}
"""Parameters of embedded autopilots, so that they land on link loss: by default ArduCopter hovers
and PX4 stays in Hold. A campaign's own `params` override them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FailsafeRule:
    """A rule for the value of a failsafe parameter.

    names: the newest first; firmware knows one of them. wanted: the value to set where we may;
    None leaves it as it is. sound: the accepted values; or longest_s, the longest accepted time; or
    forbidden, bits that must be 0, which are cleared where we may; or least or most, the least or
    largest accepted value. wrong: the consequence of any other value, for messages. is_optional:
    older firmware has no such parameter. where: another parameter, and the values of it with which
    the rule counts.
    """

    names: tuple[str, ...]
    wanted: int | None = None
    sound: frozenset[int] = frozenset()
    longest_s: float | None = None
    forbidden: int = 0
    least: float | None = None
    most: float | None = None
    wrong: str
    is_optional: bool = False
    where: tuple[str, frozenset[int]] | None = None

    def holds(self, value: float, pace: float = 1.0) -> bool:
        """Return whether a failsafe parameter's value is accepted; pace: times real time."""
        if self.longest_s is not None:
            return 0.0 < value <= self.longest_s * max(1.0, pace)
        if self.forbidden:
            return math.isfinite(value) and not int(value) & self.forbidden
        if self.least is not None:
            return value >= self.least
        if self.most is not None:
            return value <= self.most
        return value in self.sound

    def counts(self, values: Mapping[str, float]) -> bool:
        """Return whether the rule counts with a vehicle's parameters."""
        return self.where is None or values.get(self.where[0]) in self.where[1]

    def wanted_instead(self, value: float) -> int | None:
        """Return the value to set in place of a parameter's present one; None to leave it."""
        if self.forbidden and math.isfinite(value):
            cleared = int(value) & ~self.forbidden
            return cleared if cleared != value else None
        return None if value == self.wanted else self.wanted


@dataclass(frozen=True, slots=True)
class AltitudeParameter:
    """The parameter of the return altitude in a failsafe, and its unit in metres."""

    name: str
    metres: float


FAILSAFES: Mapping[AutopilotName, tuple[FailsafeRule, ...]] = {
    "ardupilot": (
        FailsafeRule(
            names=("FS_GCS_ENABLE",),
            wanted=_ARDUPILOT_LAND,
            sound=frozenset({1, 2, 3, 4, 5, 6}),
            wrong="on link loss it would hover until its battery is empty",
        ),
        FailsafeRule(
            names=("FS_GCS_TIMEOUT",),
            longest_s=30.0,
            wrong="it would take too long to detect a link loss",
        ),
        FailsafeRule(
            names=("FS_OPTIONS",),
            forbidden=_CONTINUE_WITHOUT_GCS,
            wrong="it would ignore a link loss in BRAKE, in which the guard holds; take "
            f"{_CONTINUE_WITHOUT_GCS} (continue in pilot controlled modes) off it",
        ),
        FailsafeRule(
            names=("MAV_GCS_SYSID", "SYSID_MYGCS"),
            wanted=OWN_SYSTEM_ID,
            sound=frozenset({OWN_SYSTEM_ID}),
            wrong=f"it expects another ground station's heartbeats, not ours ({OWN_SYSTEM_ID})",
        ),
        FailsafeRule(
            names=("RTL_ALT_FINAL", "RTL_ALT_FINAL_M"),
            most=0.0,
            wrong="on link loss it would return, and hover there until its battery is empty",
            is_optional=True,
            where=("FS_GCS_ENABLE", _ARDUPILOT_RETURNS),
        ),
        FailsafeRule(
            names=("FS_EKF_ACTION",),
            wanted=1,
            sound=frozenset({1, 3}),
            wrong="without a position it would not land, but wait for a pilot",
            is_optional=True,
        ),
    ),
    "px4": (
        FailsafeRule(
            names=("NAV_DLL_ACT",),
            wanted=_PX4_LAND,
            sound=frozenset({2, 3}),
            wrong="on link loss it would not land, or it would fall",
        ),
        FailsafeRule(
            names=("COM_DLL_EXCEPT",),
            forbidden=_EXCEPT_HOLD,
            wrong="it would ignore a link loss in Hold, in which the guard holds; take "
            f"{_EXCEPT_HOLD} (Hold) off it",
            is_optional=True,
        ),
        FailsafeRule(
            names=("RTL_LAND_DELAY",),
            least=0.0,
            wrong="on link loss it would return, and hover there until its battery is empty",
            is_optional=True,
            where=("NAV_DLL_ACT", frozenset({2})),
        ),
        FailsafeRule(
            names=("COM_DL_LOSS_T",),
            longest_s=30.0,
            wrong="it would take too long to detect a link loss",
        ),
        FailsafeRule(
            names=("COM_OBL_RC_ACT",),
            wanted=4,
            sound=frozenset({0, 1, 2, 3, 4, 5}),
            wrong="it would fall when setpoints stop",
        ),
        FailsafeRule(
            names=("COM_OF_LOSS_T",),
            longest_s=5.0,
            wrong="it would fly on for too long when setpoints stop",
        ),
    ),
}
RETURN_ALTITUDES: Mapping[AutopilotName, tuple[AltitudeParameter, ...]] = {
    "ardupilot": (AltitudeParameter("RTL_ALT", 0.01), AltitudeParameter("RTL_ALT_M", 1.0)),
    "px4": (AltitudeParameter("RTL_RETURN_ALT", 1.0),),
}
"""By all names in use, the most common first: ArduPilot does not answer for unknown names."""


def unsound(
    autopilot: AutopilotName, values: Mapping[str, float], *, pace: float = 1.0
) -> Iterator[str]:
    """Yield in words what is wrong with an autopilot's failsafe parameters.

    pace: the times real time that it was launched with; PX4's startup script multiplies its
    time-outs by it (ROMFS/px4fmu_common/init.d-posix/rcS).
    """
    for rule in FAILSAFES[autopilot]:
        known = [name for name in rule.names if name in values]
        if not rule.counts(values) or (rule.is_optional and not known):
            continue
        if not known:
            yield f"{rule.names[0]} is not known"
        elif not rule.holds(values[known[0]], pace):
            yield f"{known[0]} is {values[known[0]]:g}: {rule.wrong}"


def return_altitude_m(autopilot: AutopilotName, values: Mapping[str, float]) -> float | None:
    """Return the altitude above home of a failsafe's return; None when unknown."""
    for parameter in RETURN_ALTITUDES[autopilot]:
        if parameter.name in values:
            return values[parameter.name] * parameter.metres
    return None
