"""Looks for a board through a live camera, while motion capture tells where its body is."""

import asyncio
from contextlib import AsyncExitStack
from dataclasses import dataclass

from campaigns.values.external_setups import MocapSetup, SourceSetup
from orchestrator.calibration.board_search import STEP_S, BoardSearch, BoardViews
from orchestrator.calibration.body_paths import TimedPose, body_path
from orchestrator.external.motion_captures import MotionCaptures
from vehicles.calibration.boards import Board
from vehicles.calibration.mounting import BodyPath
from vehicles.readings import CameraReading
from vehicles.sources.cameras.camera_factory import live_camera
from worlds.camera import Intrinsics


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOrder:
    """A live search's input. size: of the images, (width, height). mocap: None: optics alone."""

    camera: SourceSetup
    size: tuple[int, int]
    for_s: float
    mocap: MocapSetup | None = None


async def search_live(order: LiveOrder, board: Board) -> tuple[BoardViews, BodyPath | None]:
    """Return a live camera's views of the board and its body's path; stamps of arrival.

    Raises SourceError, CalibrationError.
    """
    looker = BoardSearch(board)
    poses: list[TimedPose] = []
    captures = MotionCaptures({} if order.mocap is None else {"real": order.mocap})
    captures.listen("real", lambda reading: poses.append((reading.t_s, reading.pose)))
    width_px, height_px = order.size
    camera = live_camera(
        order.camera.address,
        # Its optics are what is sought: only the size is checked by these.
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
                await _search(looker, reading)
    return looker.seen(), body_path(poses) if order.mocap is not None else None


async def _search(looker: BoardSearch, reading: CameraReading) -> None:
    """Search live images in a thread while poses are received; excess images are dropped."""
    await asyncio.to_thread(looker.look, reading.t_s, reading.image_bgr)
