"""Sends setpoints to a vehicle, and streams zero velocity until the first one."""

import asyncio
from typing import Any

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget
from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.session.repeater import Repeater
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint

_ZERO_VELOCITY = VelocitySetpoint((0.0, 0.0, 0.0))


class SetpointSender:
    """Sends setpoints in the autopilot's local frame, stamped in the vehicle's time.

    A setpoint is sent once: the autonomy renews it, so that the autopilot's own time-out acts
    when the autonomy dies. Only zero velocity is repeated, from `keep_still` to the next `send`.
    """

    def __init__(
        self,
        *,
        session: MavlinkSession,
        clock: VehicleClock,
        autopilot: Autopilot,
        target: MavlinkTarget,
    ) -> None:
        self._session = session
        self._clock = clock
        self._autopilot = autopilot
        self._target = target
        period_s = 1.0 / autopilot.setpoint_rate_hz
        self._zero_velocity_stream = Repeater(
            period_s=period_s, action=lambda: self._send_once(_ZERO_VELOCITY)
        )

    def send(self, setpoint: Setpoint) -> None:
        """Send a setpoint, and end streaming of zero velocity."""
        self._zero_velocity_stream.stop()
        self._send_once(setpoint)

    def keep_still(self) -> None:
        """Stream setpoints of zero velocity until `send` or `stop`."""
        self._zero_velocity_stream.start()

    def stop(self) -> None:
        """Stop sending setpoints."""
        self._zero_velocity_stream.stop()

    def _send_once(self, setpoint: Setpoint) -> None:
        now_s = asyncio.get_running_loop().time()
        t_boot_ms = max(0, int(self._clock.boot_time(now_s) * 1e3))
        message: Any
        if isinstance(setpoint, PositionSetpoint):
            message = self._autopilot.position_setpoint(
                self._target,
                t_boot_ms=t_boot_ms,
                position_ned_m=setpoint.position_ned_m,
                yaw_rad=setpoint.yaw_rad,
            )
        else:
            message = self._autopilot.velocity_setpoint(
                self._target,
                t_boot_ms=t_boot_ms,
                velocity_ned_m_s=setpoint.velocity_ned_m_s,
                yaw_rad=setpoint.yaw_rad,
                yaw_rate_rad_s=setpoint.yaw_rate_rad_s,
            )
        self._session.send(message)
