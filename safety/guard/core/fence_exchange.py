"""Whether all vehicles that are to get other fences in flight can have them; pure."""

from collections.abc import Mapping

from safety.fence.fence_change import refusal_of_change
from safety.fence.geofence import Fence
from safety.guard.core.events import GuardSettings
from safety.guard.core.setpoint_limiter import Motion


def refusal_of_changes(
    fences: Mapping[str, Fence], motions: Mapping[str, Motion | None], settings: GuardSettings
) -> str:
    """Return why the first of the vehicles cannot exchange its fence now; "" when all can.

    motions: of each, as seen within the last second; None for one that was not.
    """
    for name, fence in fences.items():
        motion = motions[name]
        why = refusal_of_change(
            fence,
            None if motion is None else (motion.position_ned_m, motion.velocity_ned_m_s),
            latency_s=settings.latency_s,
            braking_m_s2=settings.braking_m_s2,
            keep_m=settings.keep_m,
        )
        if why:
            return f"{name}: {why}"
    return ""
