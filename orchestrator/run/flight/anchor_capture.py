"""What happens last before arming: what has to be proven, and anchors by motion capture."""

import asyncio

from orchestrator.external.external_io import ExternalIo
from orchestrator.run.vehicles.onboard_configuration import OnboardConfiguration
from orchestrator.state.run_setup import RunSetup
from orchestrator.state.vehicle_context import VehicleContext
from vehicles.errors import AnchorError
from vehicles.poses.anchor import Anchor, PoseAverage

_SPAN_S = 1.0
_SAMPLE_S = 0.05
_STILL_M = 0.1
"""Motion capture sees a standing vehicle to millimetres."""


async def prove_and_anchor(
    setup: RunSetup,
    contexts: tuple[VehicleContext, ...],
    outside: ExternalIo,
    aboard: OnboardConfiguration,
) -> None:
    """Check external inputs and injections before arming, and anchor by motion capture.

    Raises SourceError, NotHonouredError, AnchorError.
    """
    await outside.before_arming(contexts, unbooted=aboard.unbooted)
    captured = [one for one in contexts if setup.vehicle(one.name).anchor == "mocap"]
    await asyncio.gather(*map(anchor_by_mocap, captured))


async def anchor_by_mocap(context: VehicleContext) -> None:
    """Capture the anchor of a vehicle's estimate in motion capture's frame, over a second.

    Raises AnchorError when either says too little, or moves.
    """
    loop = asyncio.get_running_loop()
    local, world = PoseAverage(span_s=_SPAN_S), PoseAverage(span_s=_SPAN_S, still_within_m=_STILL_M)
    until_s = loop.time() + _SPAN_S
    while loop.time() < until_s:
        now_s = loop.time()
        estimate = context.driver.state.local
        if estimate is not None:
            local.add(now_s, estimate.pose)
        # As late as motion capture itself is, so that nothing is predicted.
        seen = context.poses.at(now_s - 2.0 * _SAMPLE_S)
        if seen.pose is not None and seen.kind == "interpolated":
            world.add(now_s, seen.pose)
        await asyncio.sleep(_SAMPLE_S)
    try:
        context.driver.set_anchor(Anchor.of_poses(local=local.mean(), world=world.mean()))
    except AnchorError as error:
        raise AnchorError(
            f"{context.name}, anchored by motion capture: {error}; keep it still and in view"
        ) from error
