"""The couplings of a twin to its vehicle, and the control law by which it follows; pure."""

from typing import Literal

from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.frames import Pose, Vec3, add, norm, scale, subtract

Coupling = Literal["follow", "free", "shadow", "placed"]
"""follow: the twin's autopilot gets setpoints from the real vehicle's motion. free: the autonomy
flies both. shadow: the twin gets the setpoints of the real vehicle's autonomy. placed: the twin
does not fly; its sensors are where the real vehicle is."""

LIMITS_M: dict[Coupling, float] = {"follow": 1.0, "free": 10.0, "shadow": 10.0, "placed": 1.0}
"""Default limit of the distance between real and twin. A twin that follows is kept at its vehicle;
where the two only fly alike, the distance is mainly a measurement."""

GAIN_HZ = 1.0
"""Commanded speed per distance, as in the autopilots' own position control (PX4 MPC_XY_P
0.95, ArduCopter PSC_POSXY_P 1.0): the velocity control beneath is several times as fast."""
RESPONSE_S = 0.4
"""How long an autopilot takes to reach a velocity setpoint: the setpoint is the velocity that the
leader is going to have by then."""
_FASTEST_M_S = 2.0
"""The largest velocity that is added in order to catch up."""


def following_setpoint(
    *,
    leader: Pose,
    velocity_ned_m_s: Vec3,
    acceleration_ned_m_s2: Vec3,
    age_s: float,
    own: Pose,
    own_age_s: float,
    asked_ned_m_s: Vec3 | None = None,
) -> VelocitySetpoint:
    """Return the setpoint that has a vehicle follow another one; world frame.

    leader, velocity_ned_m_s, acceleration_ned_m_s2: the other's pose and motion age_s ago. own: the
    vehicle's own pose own_age_s ago. Both poses are extrapolated to now by the leader's velocity,
    which is the vehicle's own as long as it follows, and the velocity to when the vehicle flies it:
    this compensates the latency of both links and of the vehicle. asked_ned_m_s: the velocity
    setpoint of the leader; None when unknown. Each component of the extrapolated velocity stays
    between the leader's present velocity and that setpoint.
    """
    ahead_m = scale(velocity_ned_m_s, age_s - own_age_s)
    behind_m = subtract(add(leader.position_ned_m, ahead_m), own.position_ned_m)
    catch_up_m_s = scale(behind_m, GAIN_HZ)
    fast = norm(catch_up_m_s) / _FASTEST_M_S
    if fast > 1.0:
        catch_up_m_s = scale(catch_up_m_s, 1.0 / fast)
    leads_m_s = add(velocity_ned_m_s, scale(acceleration_ned_m_s2, age_s + RESPONSE_S))
    if asked_ned_m_s is not None:
        ends = zip(leads_m_s, velocity_ned_m_s, asked_ned_m_s, strict=True)
        north, east, down = (min(max(one, min(a, b)), max(a, b)) for one, a, b in ends)
        leads_m_s = (north, east, down)
    return VelocitySetpoint(add(leads_m_s, catch_up_m_s), yaw_rad=leader.yaw_rad)
