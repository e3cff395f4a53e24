"""Checks whether an autopilot would act on an injected message."""

from collections.abc import Mapping
from functools import cache

from wil_campaign.hooks import autopilots
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.plugins.injection.px4_rules import PX4
from wil_campaign.plugins.injection.rules import (
    IgnoredInjection,
    InjectionKind,
    InjectionSituation,
    Rules,
    broken_injection_rules,
    parameters_in_rules,
)
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.setpoints import Setpoints

_LANDING: frozenset[InjectionKind] = frozenset({"landing_target"})


@cache
def _rules(autopilot: str) -> Rules:
    """Return an autopilot's rules: PX4's, or those that its plugin names; else none."""
    if autopilot == "px4":
        return PX4
    place = plugin_additions(autopilots)[autopilot].injection
    rules: Rules = load_plugin_object(place) if place else {}
    return rules


def matters_in_flight(thing: InjectionKind) -> bool:
    """Return whether an injection matters while the goal is flown, not only at the landing."""
    return thing not in _LANDING


def injection_mode(autopilot: str, thing: InjectionKind) -> str:
    """Return the flight mode in which an injection matters, by the autopilot's own name."""
    return "LAND" if thing in _LANDING else autopilot_named(autopilot).guided_name


def injection_faults(
    autopilot: str,
    thing: InjectionKind,
    parameters: Mapping[str, float],
    mode: str,
    *,
    setpoints: Setpoints = "velocity",
    unbooted: frozenset[str] = frozenset(),
) -> tuple[IgnoredInjection, ...]:
    """Return every reason why the autopilot would ignore an injection; empty when used.

    parameters: all that the autopilot reported. mode: the mode to fly in, by its own name.
    setpoints: what the autonomy sends in guided flight. unbooted: parameters set since it booted.
    """
    rules = _rules(autopilot)
    if not rules:
        return (IgnoredInjection(f"it is not known what {autopilot} does with it", "remove it"),)
    return broken_injection_rules(
        rules, thing, InjectionSituation(parameters, mode, setpoints, unbooted)
    )


def unsupported_injection(autopilot: str, thing: InjectionKind) -> tuple[IgnoredInjection, ...]:
    """Return the reasons against an injection in its mode that no parameter can remove.

    They refuse a campaign file before a vehicle is connected.
    """
    reasons = injection_faults(autopilot, thing, {}, injection_mode(autopilot, thing))
    return tuple(reason for reason in reasons if reason.parameter is None)


def parameters_to_read(autopilot: str, thing: InjectionKind) -> tuple[str, ...]:
    """Return the parameters that decide whether an injection is used, each once."""
    rules = _rules(autopilot)
    return parameters_in_rules(rules, thing) if rules else ()
