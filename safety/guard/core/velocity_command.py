"""Estimates the velocity that a vehicle follows from its setpoints; pure."""

import math

from wil_campaign.safety.fence.stopping import VehicleMotion
from wil_campaign.vehicles.setpoints import Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Vec3, lerp

_FOLLOWS_S = 0.2
"""Vehicles follow a changed velocity setpoint within some tenths of a second (63 % in 0.2 to 0.5 s,
tests/vehicles/embedded/fidelity): a setpoint that lasts for a moment only moves none of them."""
_HOLDS_S = 1.0
"""How long a setpoint counts: after this time PX4 leaves OFFBOARD (COM_OF_LOSS_T)."""


class VelocityCommand:
    """The velocity commanded by a stream of setpoints, smoothed as a vehicle follows it."""

    def __init__(self) -> None:
        self._begin: Vec3 = (0.0, 0.0, 0.0)
        self._commanded: Vec3 | None = None
        self._t_s = -math.inf

    def note(self, setpoint: Setpoint | None, motion: VehicleMotion | None, t_s: float) -> None:
        """Record a setpoint, world frame; one that is no velocity ends the stream.

        motion: of the vehicle, from which a stream begins; None is taken as standing still.
        """
        if not isinstance(setpoint, VelocitySetpoint):
            self.forget()
            return
        standing = (0.0, 0.0, 0.0)
        now = standing if motion is None else motion.velocity_ned_m_s
        self._begin = self.velocity(t_s) or now
        self._commanded, self._t_s = setpoint.velocity_ned_m_s, t_s

    def velocity(self, t_s: float) -> Vec3 | None:
        """Return the commanded velocity, world frame; None without a setpoint in the last second.

        A setpoint applies until the next one: its velocity is approached as time passes.
        """
        elapsed_s = t_s - self._t_s
        if self._commanded is None or elapsed_s > _HOLDS_S:
            return None
        return lerp(self._begin, self._commanded, -math.expm1(-max(elapsed_s, 0.0) / _FOLLOWS_S))

    def forget(self) -> None:
        """End the stream of setpoints."""
        self._commanded = None
