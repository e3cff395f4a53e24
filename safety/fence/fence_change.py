"""Whether a fence may take the place of another in flight; pure."""

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.stopping import Motion


def refusal_of_change(
    new: Fence,
    motion: Motion | None,
    *,
    latency_s: float,
    braking_m_s2: float,
    keep_m: float,
) -> str:
    """Return why a flying vehicle's fence cannot be changed now; empty when it can.

    motion: None if there is no position of the last second. The vehicle has to be inside the new
    fence by `keep_m`, and able to stop there: the change must not cause a breach.
    """
    if motion is None:
        return "no position was received within the last second"
    breach = new.breached(motion, latency_s=latency_s, braking_m_s2=braking_m_s2, keep_m=keep_m)
    if breach is None:
        return ""
    if breach.predicted:
        return f"it {breach}"
    if breach.margin_m < 0.0:
        return f"it is {breach}"
    side = f"{breach.margin_m:.2f} m from the fence's {breach.boundary}"
    return f"it is {side}, nearer than {keep_m:g} m"
