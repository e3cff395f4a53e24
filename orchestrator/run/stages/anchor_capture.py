"""Anchors an autopilot's local frame in the world by motion capture."""

import asyncio

from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.errors import AnchorError
from wil_campaign.vehicles.poses.anchor import Anchor, PoseAverage

_SPAN_S = 1.0
_SAMPLE_S = 0.05
_STILL_M = 0.1
"""Motion capture sees a standing vehicle to millimetres."""


async def anchor_by_mocap(context: VehicleContext) -> Anchor:
    """Anchor a vehicle's estimate in motion capture's frame, over a second; return the anchor.

    Raises AnchorError when either source has too few poses, or moves.
    """
    loop = asyncio.get_running_loop()
    local, world = PoseAverage(span_s=_SPAN_S), PoseAverage(span_s=_SPAN_S, still_within_m=_STILL_M)
    until_s = loop.time() + _SPAN_S
    while loop.time() < until_s:
        now_s = loop.time()
        estimate = context.driver.state.local
        if estimate is not None:
            local.add(now_s, estimate.pose)
        # Looked up as late as motion capture arrives, so that no pose is predicted.
        captured = context.poses.at(now_s - 2.0 * _SAMPLE_S)
        if captured.pose is not None and captured.kind == "interpolated":
            world.add(now_s, captured.pose)
        await asyncio.sleep(_SAMPLE_S)
    try:
        anchor = Anchor.of_poses(local=local.mean(), world=world.mean())
    except AnchorError as error:
        raise AnchorError(
            f"{context.name}, anchored by motion capture: {error}; keep it still and in view"
        ) from error
    context.driver.set_anchor(anchor)
    return anchor
