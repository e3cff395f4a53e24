"""Searches a live camera's images for a board while motion capture records the body's path."""

import asyncio
from contextlib import AsyncExitStack
from dataclasses import dataclass

from wil_campaign.campaigns.values.external_setups import MocapSetup, SourceSetup
from wil_campaign.orchestrator.external.motion_captures import MotionCaptures
from wil_campaign.plugins.calibration.board_search import STEP_S, BoardSearch, BoardViews
from wil_campaign.plugins.calibration.boards import Board
from wil_campaign.plugins.calibration.body_paths import BodyPath, TimedPose, body_path
from wil_campaign.plugins.cameras.camera_factory import live_camera
from wil_campaign.worlds.camera import Intrinsics


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOrder:
    """A live search's input. size: of the images, (width, height). mocap: None for optics only."""

    camera: SourceSetup
    size: tuple[int, int]
    for_s: float
    mocap: MocapSetup | None = None


async def search_live(order: LiveOrder, board: Board) -> tuple[BoardViews, BodyPath | None]:
    """Return a live camera's views of the board and its body's path, stamped on arrival.

    Raises SourceError, CalibrationError.
    """
    search = BoardSearch(board)
    poses: list[TimedPose] = []
    captures = MotionCaptures({} if order.mocap is None else {"real": order.mocap})
    captures.listen("real", lambda reading: poses.append((reading.t_s, reading.pose)))
    width_px, height_px = order.size
    camera = live_camera(
        order.camera.address,
        # The optics are still unknown: these only check the size.
        intrinsics=Intrinsics.from_fov(width_px, height_px, 1.0),
        open_timeout_s=order.camera.open_s,
        stall_timeout_s=order.camera.stall_s,
        rtsp_transport=order.camera.transport,
        v4l2_format=order.camera.device_format,
    )
    async with AsyncExitStack() as stack:
        await captures.open(stack)
        if order.mocap is not None:
            await captures.ready()
        await stack.enter_async_context(camera)
        loop = asyncio.get_running_loop()
        until_s, due_s = loop.time() + order.for_s, float("-inf")
        async for reading in camera:
            if reading.arrived_s >= until_s:
                break
            if reading.t_s >= due_s:
                due_s = reading.t_s + STEP_S
                # In a thread: poses keep arriving, and the camera drops excess images.
                await asyncio.to_thread(search.search, reading.t_s, reading.image_bgr)
    return search.views(), body_path(poses) if order.mocap is not None else None
