"""Finds the strategy of an autopilot, by name or by MAV_AUTOPILOT."""

from collections.abc import Mapping
from functools import cache

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.hooks import autopilots
from wil_campaign.installed_plugins import absent_additions, loaded_additions
from wil_campaign.vehicles.autopilots.autopilot import Autopilot

MULTICOPTERS = frozenset(
    {
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_TYPE_HEXAROTOR,
        mavlink.MAV_TYPE_OCTOROTOR,
        mavlink.MAV_TYPE_TRICOPTER,
        mavlink.MAV_TYPE_DODECAROTOR,
        mavlink.MAV_TYPE_DECAROTOR,
    }
)
"""MAV_TYPEs that all strategies fly: only the type tells ArduPilot's planes from copters."""


@cache
def autopilot_strategies() -> Mapping[str, Autopilot]:
    """Return by name the strategies of all autopilots, the core's and the plugins'."""
    return {name: strategy() for name, strategy in loaded_additions(autopilots, "strategy").items()}


def is_flyable_vehicle(vehicle_type: int, mav_autopilot: int) -> bool:
    """Return whether a registered autopilot strategy flies what sends such heartbeats."""
    return vehicle_type in MULTICOPTERS and autopilot_of(mav_autopilot) is not None


def autopilot_named(name: str) -> Autopilot:
    """Return the registered autopilot strategy of a name in a campaign.

    Raises ValueError for another name, or for that of a plugin that is not installed.
    """
    if name in autopilot_strategies():
        return autopilot_strategies()[name]
    known = ", ".join(autopilot_strategies())
    raise ValueError(
        absent_additions(autopilots).get(name) or f"there is no autopilot '{name}' ({known})"
    )


def autopilot_of(mav_autopilot: int) -> Autopilot | None:
    """Return the registered autopilot strategy for HEARTBEAT.autopilot; None for others."""
    known = autopilot_strategies().values()
    return next((each for each in known if each.mav_autopilot == mav_autopilot), None)
