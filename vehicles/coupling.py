"""How a twin is kept with its vehicle, and the law by which it follows; pure."""

from typing import Literal

from vehicles.setpoints import VelocitySetpoint
from worlds.frames import Pose, Vec3, add, norm, scale, subtract

Coupling = Literal["follow", "free", "shadow", "placed"]
"""follow: the twin's autopilot is given the real vehicle's motion. free: the autonomy flies both.
shadow: the twin is given the setpoints of the real vehicle's autonomy. placed: nothing flies the
twin; its sensors are where the real vehicle is."""

LIMITS_M: dict[Coupling, float] = {"follow": 1.0, "free": 10.0, "shadow": 10.0, "placed": 1.0}
"""How far apart real and twin may be unless the campaign says it. A twin that follows is held to
its vehicle; where the two only fly alike, the distance is first of all a figure."""

GAIN_HZ = 1.0
"""Speed asked per distance, as the position control of the autopilots themselves (PX4 MPC_XY_P
0.95, ArduCopter PSC_POSXY_P 1.0): the velocity control beneath is several times as fast."""
RESPONSE_S = 0.4
"""How long an autopilot takes to fly a velocity that it is asked for: what is asked is the velocity
that the leader is going to have by then."""
_FASTEST_M_S = 2.0
"""The most that is asked in order to catch up."""


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

    leader, velocity_ned_m_s, acceleration_ned_m_s2: where the other was, and how it moved, age_s
    ago. own: where the vehicle itself was own_age_s ago. Both are carried on to now by the leader's
    velocity, which is the vehicle's own as long as it follows, and the velocity to where it is when
    the vehicle flies it: this is what makes up for the latency of both, and for its own.
    asked_ned_m_s: the velocity that the other was asked for; None where nobody knows. It is not
    going to be faster than that, nor turn away from it.
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
