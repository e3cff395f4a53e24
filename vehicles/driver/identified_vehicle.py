"""The parts of a driver that exist once its vehicle is identified."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, FlightMode, MavlinkTarget
from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.estimates import NO_PLACE_REMEDY, Estimates
from wil_campaign.vehicles.driver.session.identity import VehicleIdentity
from wil_campaign.vehicles.driver.setpoint_sender import SetpointSender
from wil_campaign.vehicles.driver.status_tracker import StatusTracker
from wil_campaign.vehicles.driver.telemetry_streams import TelemetryStreams
from wil_campaign.vehicles.driver.vehicle_commands import VehicleCommands
from wil_campaign.vehicles.mavlink.heartbeats import HeartbeatKind
from wil_campaign.worlds.geodesy import LocalFrame

_LEAST_RATE = 0.5
"""The part of the requested position rate that must arrive."""
_END_MODES = frozenset({FlightMode.GUIDED, FlightMode.LAND, FlightMode.RTL})
"""Modes in which our flights and the guard's interventions end."""
_FOREIGN_MODES = frozenset({FlightMode.PILOT, FlightMode.MISSION, FlightMode.OTHER})
"""Modes that a pilot or another program has set, and may want."""


@dataclass(frozen=True, slots=True)
class IdentifiedVehicle:
    """An identified vehicle: its identity, its commands, and its state.

    earth: the origin for an estimator that has none; None for a vehicle with GPS.
    """

    identity: VehicleIdentity
    autopilot: Autopilot
    target: MavlinkTarget
    status: StatusTracker
    streams: TelemetryStreams
    commands: VehicleCommands
    setpoints: SetpointSender
    estimates: Estimates
    clock: VehicleClock
    earth: LocalFrame | None = None

    def messages_to_get_ready(self) -> Iterator[Any]:
        """Yield the messages to send to an identified vehicle that is not ready to arm."""
        autopilot, state = self.autopilot, self.status.state
        if self.status.readiness.prearm_failed:
            yield autopilot.request_checks(self.target)
        if self._arms_in_hold and state.mode in _END_MODES:
            # A PX4 that landed in OFFBOARD returns to it, without setpoints; one that was commanded
            # to land on the ground stays in LAND. PX4 is ready in neither mode.
            yield autopilot.set_mode(self.target, FlightMode.HOLD)
        if self._lacks_origin and self.earth is not None:
            yield set_origin(self.target, self.earth)

    def reasons(self, position_hz: float) -> tuple[str, ...]:
        """Return the reasons against arming the vehicle: the autopilot's, and ours.

        position_hz: the requested rate of positions.
        """
        reasons = list(self.status.readiness.reasons())
        now_s = asyncio.get_running_loop().time()
        reasons += [f"{name} does not arrive" for name in self.streams.missing(now_s)]
        state = self.status.state
        if (
            self._arms_in_hold
            and self.status.readiness.prearm_failed
            and state.mode in _FOREIGN_MODES
        ):
            reasons.append(f"it is in {state.mode_name}; switch it to Hold")
        if not state.link_up:
            reasons.append("nothing is received from it")
        if not self.clock.synchronised:
            reasons.append("it does not answer TIMESYNC")
        if self._lacks_origin:
            reasons.append("its estimator has taken no origin on Earth")
        elif self.autopilot.takeoff_needs_amsl and self.estimates.amsl_m is None:
            reasons.append(f"its height above sea level is unknown: {NO_PLACE_REMEDY}")
        rate_hz = self.estimates.average.rate_hz
        if rate_hz < _LEAST_RATE * position_hz:
            reasons.append(f"positions arrive at {rate_hz:.0f} Hz instead of {position_hz:.0f} Hz")
        return tuple(reasons)

    def describe_other(self, kind: HeartbeatKind) -> str:
        """Return in words that another program sends heartbeats with the vehicle's ids."""
        ids = f"system {self.target.system}, component {self.target.component}"
        return (
            f"another sender of heartbeats has its ids ({ids}): {kind}; they are ignored; give "
            "it a component id of its own"
        )

    @property
    def _lacks_origin(self) -> bool:
        """Return whether it has no GPS, and its estimator no place on Earth."""
        return self.earth is not None and self.estimates.place_deg is None

    @property
    def _arms_in_hold(self) -> bool:
        """Return whether it is disarmed and its autopilot is ready to arm in its hold mode only."""
        return self.autopilot.arming_mode is FlightMode.HOLD and not self.status.state.armed


def set_origin(target: MavlinkTarget, earth: LocalFrame) -> Any:
    """Return SET_GPS_GLOBAL_ORIGIN: latitude, longitude and height above sea level of (0, 0, 0).

    An estimator takes it that has no origin yet (ArduPilot), or at any time (PX4).
    """
    return mavlink.MAVLink_set_gps_global_origin_message(
        target.system,
        round(earth.latitude_deg * 1e7),
        round(earth.longitude_deg * 1e7),
        round(earth.altitude_m * 1e3),
    )
