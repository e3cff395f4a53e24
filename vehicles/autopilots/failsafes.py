"""The autopilot's own failsafe parameters, for the loss of its ground station or of setpoints.

The guard is the first line of defence; these are the second: the guard and its parent may both
die. Each autopilot has its own (`Autopilot.failsafes`).
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

OWN_SYSTEM_ID = 245
"""Our system id as a ground station, of driver and guard; its heartbeats prevent the vehicle's GCS
failsafe."""
SILENT_S = 5.0
"""Longer than the guard's time-out for a lost vehicle, so that the guard acts first."""
ReturnsBy = Literal["rally", "landing", "mission"]
"""The closest rally point, a stored mission's landing, or all of the mission's way to it."""


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
class ReturnAltitudeParameter:
    """The parameter of the return altitude in a failsafe, and its unit in metres."""

    name: str
    metres: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotFailsafes:
    """An autopilot's own failsafes.

    on_silence: parameters with which an embedded one lands on link loss; a campaign's own `params`
    override them. return_altitudes: by all names in use, the most common first: ArduPilot does not
    answer for unknown names. returning: by parameter the values with which it returns. ways: the
    places besides home to which it then may return, by its parameters. return_type: the parameter
    that says which of them count. rally_limit: the one that says how far a rally point may be, in
    kilometres; 0 for any distance. None for a parameter that it does not have.
    """

    on_silence: Mapping[str, float]
    rules: tuple[FailsafeRule, ...]
    return_altitudes: tuple[ReturnAltitudeParameter, ...]
    returning: Mapping[str, frozenset[int]]
    ways: Callable[[Mapping[str, float]], frozenset[ReturnsBy]]
    return_type: str | None = None
    rally_limit: str | None = None

    def unsound(self, values: Mapping[str, float], *, pace: float = 1.0) -> Iterator[str]:
        """Yield in words what is wrong with the values of the failsafe parameters.

        pace: the times real time that it was launched with; PX4's startup script multiplies its
        time-outs by it (ROMFS/px4fmu_common/init.d-posix/rcS).
        """
        for rule in self.rules:
            known = [name for name in rule.names if name in values]
            if not rule.counts(values) or (rule.is_optional and not known):
                continue
            if not known:
                yield f"{rule.names[0]} is not known"
            elif not rule.holds(values[known[0]], pace):
                yield f"{known[0]} is {values[known[0]]:g}: {rule.wrong}"

    def return_altitude_m(self, values: Mapping[str, float]) -> float | None:
        """Return the altitude above home of a failsafe's return; None when unknown."""
        for parameter in self.return_altitudes:
            if parameter.name in values:
                return values[parameter.name] * parameter.metres
        return None

    def rally_limit_m(self, values: Mapping[str, float]) -> float:
        """Return how far from a vehicle a rally point may be for it to return there."""
        limit_km = 0.0 if self.rally_limit is None else values.get(self.rally_limit, 0.0)
        return limit_km * 1000.0 if limit_km > 0.0 else math.inf

    def ways_of_return(self, values: Mapping[str, float]) -> frozenset[ReturnsBy]:
        """Return by which places besides home the failsafes may return; empty for none."""
        returns = any(values.get(name) in actions for name, actions in self.returning.items())
        return self.ways(values) if returns else frozenset()
