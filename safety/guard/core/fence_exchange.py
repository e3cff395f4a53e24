"""Checks whether all vehicles that are to get new fences in flight can have them; pure."""

from collections.abc import Mapping

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.stopping import VehicleMotion
from wil_campaign.safety.guard.core.events import GuardSettings


def refusal_of_changes(
    fences: Mapping[str, Fence],
    motions: Mapping[str, VehicleMotion | None],
    settings: GuardSettings,
) -> str:
    """Return why the first of the vehicles cannot change its fence now; "" if all can.

    motions: of each, not older than a second; None where there is none.
    """
    for name, fence in fences.items():
        why = refusal_of_change(
            fence,
            motions[name],
            latency_s=settings.latency_s,
            braking_m_s2=settings.braking_m_s2,
            keep_m=settings.keep_m,
        )
        if why:
            return f"{name}: {why}"
    return ""


def refusal_of_change(
    new: Fence,
    motion: VehicleMotion | None,
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
