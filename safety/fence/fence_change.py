"""Whether a fence may take the place of another in flight; pure."""

from safety.fence.geofence import Fence
from worlds.frames import Vec3


def refusal_of_change(
    new: Fence,
    where: tuple[Vec3, Vec3] | None,
    *,
    latency_s: float,
    braking_m_s2: float,
    keep_m: float,
) -> str:
    """Return why a flying vehicle's fence cannot be changed now; empty when it can.

    where: its position and velocity, world frame; None when they were not seen within the last
    second. It has to be inside of the new fence with `keep_m` to spare, and able to stop there: a
    change must not be a breach. (A degenerate fence cannot be made: see FenceError.)
    """
    if where is None:
        return "where it is was not seen within the last second"
    position_ned_m, velocity_ned_m_s = where
    breach = new.breached(
        position_ned_m,
        velocity_ned_m_s,
        latency_s=latency_s,
        braking_m_s2=braking_m_s2,
        keep_m=keep_m,
    )
    if breach is None:
        return ""
    if breach.predicted:
        return f"it {breach}"
    if breach.margin_m < 0.0:
        return f"it is {breach}"
    side = f"{breach.margin_m:.2f} m from the fence's {breach.boundary}"
    return f"it is {side}, nearer than {keep_m:g} m"
