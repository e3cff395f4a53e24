"""Checks whether all vehicles that are to get new fences in flight can have them; pure."""

from collections.abc import Mapping

from wil_campaign.safety.fence.fence_change import refusal_of_change
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.stopping import Motion
from wil_campaign.safety.guard.core.events import GuardSettings


def refusal_of_changes(
    fences: Mapping[str, Fence], motions: Mapping[str, Motion | None], settings: GuardSettings
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
