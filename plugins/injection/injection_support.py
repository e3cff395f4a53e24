"""Checks whether an autopilot would act on an injected message, for both autopilots; pure."""

from collections.abc import Mapping

from wil_campaign.plugins.injection.ardupilot_rules import ARDUPILOT
from wil_campaign.plugins.injection.px4_rules import PX4
from wil_campaign.plugins.injection.rules import (
    Ignored,
    InjectionKind,
    Rules,
    Situation,
    broken_rules,
    parameters_in,
)
from wil_campaign.vehicles.autopilots.autopilot import AutopilotName
from wil_campaign.vehicles.setpoints import Setpoints

_RULES: Mapping[AutopilotName, Rules] = {"ardupilot": ARDUPILOT, "px4": PX4}
_GUIDED: Mapping[AutopilotName, str] = {"ardupilot": "GUIDED", "px4": "OFFBOARD"}
_LANDING: frozenset[InjectionKind] = frozenset({"landing_target"})


def matters_in_flight(thing: InjectionKind) -> bool:
    """Return whether an injection matters while the goal is flown, not only at the landing."""
    return thing not in _LANDING


def flown_mode(autopilot: AutopilotName, thing: InjectionKind) -> str:
    """Return the flight mode in which an injection matters, by the autopilot's own name."""
    return "LAND" if thing in _LANDING else _GUIDED[autopilot]


def injection_faults(
    autopilot: AutopilotName,
    thing: InjectionKind,
    parameters: Mapping[str, float],
    mode: str,
    *,
    setpoints: Setpoints = "velocity",
    unbooted: frozenset[str] = frozenset(),
) -> tuple[Ignored, ...]:
    """Return every reason why the autopilot would ignore an injection; empty when used.

    parameters: all that the autopilot reported. mode: the mode to fly in, by its own name.
    setpoints: what the autonomy sends in guided flight. unbooted: parameters set since it booted.
    """
    situation = Situation(parameters, mode, setpoints, unbooted)
    return broken_rules(_RULES[autopilot], thing, situation)


def unsupported_injection(autopilot: AutopilotName, thing: InjectionKind) -> tuple[Ignored, ...]:
    """Return the reasons against an injection in its mode that no parameter can remove.

    They refuse a campaign file before a vehicle is connected.
    """
    reasons = injection_faults(autopilot, thing, {}, flown_mode(autopilot, thing))
    return tuple(reason for reason in reasons if reason.parameter is None)


def parameters_to_read(autopilot: AutopilotName, thing: InjectionKind) -> tuple[str, ...]:
    """Return the parameters that decide whether an injection is used, each once."""
    return parameters_in(_RULES[autopilot], thing)
