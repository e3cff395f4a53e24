"""The parts of a driver that exist once its vehicle is identified."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from vehicles.autopilots.autopilot import Autopilot, Mode, Target
from vehicles.clocks.timesync import VehicleClock
from vehicles.driver.estimates import Estimates
from vehicles.driver.session.identity import Identity
from vehicles.driver.setpoint_sender import SetpointSender
from vehicles.driver.status_tracker import StatusTracker
from vehicles.driver.telemetry_streams import TelemetryStreams
from vehicles.driver.vehicle_commands import VehicleCommands

_LEAST_RATE = 0.5
"""Of the position rate that was asked for, what must come."""


@dataclass(frozen=True, slots=True)
class IdentifiedVehicle:
    """An identified vehicle: its identity, its commands, and its state."""

    identity: Identity
    autopilot: Autopilot
    target: Target
    status: StatusTracker
    streams: TelemetryStreams
    orders: VehicleCommands
    setpoints: SetpointSender
    estimates: Estimates
    clock: VehicleClock

    def towards_ready(self) -> Iterator[Any]:
        """Yield what is sent to an identified vehicle that is not ready to arm."""
        autopilot, state = self.autopilot, self.status.state
        if self.status.readiness.prearm_failed:
            yield autopilot.ask_checks(self.target)
        if state.mode is Mode.GUIDED and not state.armed and autopilot.arming_mode is Mode.HOLD:
            # A PX4 that landed in OFFBOARD is in it again, and not ready there without setpoints.
            yield autopilot.set_mode(self.target, Mode.HOLD)

    def reasons(self, position_hz: float) -> tuple[str, ...]:
        """Return what speaks against arming the vehicle: its reasons, and ours.

        position_hz: how often positions were asked for.
        """
        reasons = list(self.status.readiness.reasons())
        now_s = asyncio.get_running_loop().time()
        reasons += [f"{name} does not come" for name in self.streams.missing(now_s)]
        if not self.status.state.link_up:
            reasons.append("it is silent")
        if not self.clock.synchronised:
            reasons.append("it does not answer TIMESYNC")
        if self.autopilot.takeoff_needs_amsl and self.estimates.amsl_m is None:
            reasons.append("its height above sea level is unknown")
        rate_hz = self.estimates.average.rate_hz
        if rate_hz < _LEAST_RATE * position_hz:
            reasons.append(f"positions come at {rate_hz:.0f} Hz instead of {position_hz:.0f} Hz")
        return tuple(reasons)
