"""Finds the strategy of an autopilot, by name or by MAV_AUTOPILOT."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.ardupilot import ArduCopter
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, AutopilotName
from wil_campaign.vehicles.autopilots.px4 import Px4

_STRATEGIES: tuple[Autopilot, ...] = (Px4(), ArduCopter())

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
"""MAV_TYPEs that both strategies fly: only the type tells ArduPilot's planes from copters."""


def flies(vehicle_type: int, mav_autopilot: int) -> bool:
    """Return whether a registered autopilot strategy flies what sends such heartbeats."""
    return vehicle_type in MULTICOPTERS and autopilot_of(mav_autopilot) is not None


def autopilot_named(name: AutopilotName) -> Autopilot:
    """Return the registered autopilot strategy of a name in a campaign."""
    return next(strategy for strategy in _STRATEGIES if strategy.name == name)


def autopilot_of(mav_autopilot: int) -> Autopilot | None:
    """Return the registered autopilot strategy for HEARTBEAT.autopilot; None for others."""
    return next((each for each in _STRATEGIES if each.mav_autopilot == mav_autopilot), None)
