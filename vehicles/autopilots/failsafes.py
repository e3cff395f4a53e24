"""What an autopilot has to do by itself when nobody tells it anything any more.

The guard is the first line; this is the one behind it: both the guard and who started it may die.
Parameters: ArduCopter/Parameters.cpp and events.cpp; PX4's commander_params.c and rtl_params.c.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from vehicles.autopilots.autopilot import AutopilotName

OWN_SYSTEM_ID = 245
"""Our system id as a ground station, whose heartbeats keep a vehicle from its failsafe."""
_ARDUPILOT_LAND, _PX4_LAND = 5, 3
_SILENT_S = 5.0
"""Longer than the guard takes to call a vehicle lost, so that it acts first."""

SILENCE_PARAMETERS: Mapping[AutopilotName, Mapping[str, float]] = {
    "ardupilot": {"FS_GCS_ENABLE": float(_ARDUPILOT_LAND), "FS_GCS_TIMEOUT": _SILENT_S},
    "px4": {"NAV_DLL_ACT": float(_PX4_LAND), "COM_DL_LOSS_T": _SILENT_S},
}
"""What embedded autopilots start with, so that they land when nobody speaks to them any more: as
they ship, ArduCopter hovers on and PX4 stays in Hold. A campaign's own `params` win."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FailsafeRule:
    """A rule of what a failsafe parameter has to be.

    names: the newest first; firmware knows one of them. wanted: what it is set to where we may;
    None is left as it is. sound: the values that will do; or longest_s, the longest time that
    will. wrong: what is the matter with any other.
    """

    names: tuple[str, ...]
    wanted: int | None = None
    sound: frozenset[int] = frozenset()
    longest_s: float | None = None
    wrong: str

    def holds(self, value: float, pace: float = 1.0) -> bool:
        """Return whether a failsafe parameter's value will do; pace: times real time."""
        if self.longest_s is not None:
            return 0.0 < value <= self.longest_s * max(1.0, pace)
        return value in self.sound


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
            sound=frozenset({1, 2, 3, 4, 5, 6, 7}),
            wrong="on link loss it would hover until its battery is empty",
        ),
        FailsafeRule(
            names=("FS_GCS_TIMEOUT",),
            longest_s=30.0,
            wrong="it would take too long to detect a link loss",
        ),
        FailsafeRule(
            names=("MAV_GCS_SYSID", "SYSID_MYGCS"),
            wanted=OWN_SYSTEM_ID,
            sound=frozenset({OWN_SYSTEM_ID}),
            wrong=f"it heeds another ground station's heartbeats, not ours ({OWN_SYSTEM_ID})",
        ),
    ),
    "px4": (
        FailsafeRule(
            names=("NAV_DLL_ACT",),
            wanted=_PX4_LAND,
            sound=frozenset({1, 2, 3}),
            wrong="on link loss it would not land, or it would fall",
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
"""By the names that firmware knows it by, the usual first: ArduPilot is silent for unknown ones."""


def unsound(
    autopilot: AutopilotName, values: Mapping[str, float], *, pace: float = 1.0
) -> Iterator[str]:
    """Yield in words what is wrong with an autopilot's failsafe parameters.

    pace: how many times real time it was launched to fly; PX4's startup makes its time-outs as many
    times longer (ROMFS/px4fmu_common/init.d-posix/rcS).
    """
    for rule in FAILSAFES[autopilot]:
        known = [name for name in rule.names if name in values]
        if not known:
            yield f"{rule.names[0]} is not known"
        elif not rule.holds(values[known[0]], pace):
            yield f"{known[0]} is {values[known[0]]:g}: {rule.wrong}"


def return_altitude_m(autopilot: AutopilotName, values: Mapping[str, float]) -> float | None:
    """Return the altitude above home of a failsafe's return; None when unknown."""
    for one in RETURN_ALTITUDES[autopilot]:
        if one.name in values:
            return values[one.name] * one.metres
    return None
