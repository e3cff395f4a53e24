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
_ENDED_IN = frozenset({Mode.GUIDED, Mode.LAND, Mode.RTL})
"""Modes that our flights end in, and guards'."""
_OTHERS_MODES = frozenset({Mode.PILOT, Mode.MISSION, Mode.OTHER})
"""Modes that somebody else chose, and may want."""


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
        if self._arms_in_hold and state.mode in _ENDED_IN:
            # A PX4 that landed in OFFBOARD is in it again, without setpoints; one that was told to
            # land when it was down already stays in LAND. It is ready in neither.
            yield autopilot.set_mode(self.target, Mode.HOLD)

    def reasons(self, position_hz: float) -> tuple[str, ...]:
        """Return what speaks against arming the vehicle: its reasons, and ours.

        position_hz: how often positions were asked for.
        """
        reasons = list(self.status.readiness.reasons())
        now_s = asyncio.get_running_loop().time()
        reasons += [f"{name} does not come" for name in self.streams.missing(now_s)]
        state = self.status.state
        if (
            self._arms_in_hold
            and self.status.readiness.prearm_failed
            and state.mode in _OTHERS_MODES
        ):
            reasons.append(f"it is in {state.mode_name}; switch it to Hold")
        if not state.link_up:
            reasons.append("it is silent")
        if not self.clock.synchronised:
            reasons.append("it does not answer TIMESYNC")
        if self.autopilot.takeoff_needs_amsl and self.estimates.amsl_m is None:
            reasons.append("its height above sea level is unknown")
        rate_hz = self.estimates.average.rate_hz
        if rate_hz < _LEAST_RATE * position_hz:
            reasons.append(f"positions come at {rate_hz:.0f} Hz instead of {position_hz:.0f} Hz")
        return tuple(reasons)

    @property
    def _arms_in_hold(self) -> bool:
        """Return whether it is disarmed, and an autopilot that is not ready in every mode."""
        return self.autopilot.arming_mode is Mode.HOLD and not self.status.state.armed
