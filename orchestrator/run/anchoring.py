"""What happens last before arming: what has to be proven, and anchors by motion capture."""

import asyncio

from orchestrator.outside.outside import Outside
from orchestrator.run.aboard import Aboard
from orchestrator.run.setup import RunSetup
from orchestrator.run.station import Station
from vehicles.anchor import Anchor, PoseAverage
from vehicles.errors import AnchorError

_SPAN_S = 1.0
_SAMPLE_S = 0.05
_STILL_M = 0.1
"""Motion capture sees a standing vehicle to millimetres."""


async def prove_and_anchor(
    setup: RunSetup, stations: tuple[Station, ...], outside: Outside, aboard: Aboard
) -> None:
    """Prove that what comes in is there and what goes out is heeded, and anchor by what comes in.

    Raises SourceError, NotHonouredError, AnchorError.
    """
    await outside.before_arming(stations, unbooted=aboard.unbooted)
    captured = [one for one in stations if setup.vehicle(one.name).anchor == "mocap"]
    await asyncio.gather(*map(anchor_by_mocap, captured))


async def anchor_by_mocap(station: Station) -> None:
    """Map the vehicle's own estimate onto where motion capture sees it, both over a second.

    Raises AnchorError when either says too little, or moves.
    """
    loop = asyncio.get_running_loop()
    local, world = PoseAverage(span_s=_SPAN_S), PoseAverage(span_s=_SPAN_S, still_within_m=_STILL_M)
    until_s = loop.time() + _SPAN_S
    while loop.time() < until_s:
        now_s = loop.time()
        estimate = station.driver.state.local
        if estimate is not None:
            local.add(now_s, estimate.pose)
        # As late as motion capture itself is, so that nothing is predicted.
        seen = station.poses.at(now_s - 2.0 * _SAMPLE_S)
        if seen.pose is not None and seen.kind == "interpolated":
            world.add(now_s, seen.pose)
        await asyncio.sleep(_SAMPLE_S)
    try:
        station.driver.set_anchor(Anchor.of_poses(local=local.mean(), world=world.mean()))
    except AnchorError as error:
        raise AnchorError(
            f"{station.name}, anchored by motion capture: {error}; let it stand still, in sight"
        ) from error
