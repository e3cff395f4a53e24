"""A live camera is looked through for a time, while motion capture is heard."""

import asyncio
import json
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest

from tests.plugins.calibration.board_images import CHARUCO, LENS, board_views
from tests.ports import free_port
from wil_campaign.campaigns.values.external_setups import MocapSetup, SourceSetup
from wil_campaign.orchestrator.external.motion_captures import MotionCaptures
from wil_campaign.plugins.calibration import live_search
from wil_campaign.plugins.calibration.boards import CalibrationError
from wil_campaign.plugins.calibration.live_search import LiveOrder, search_live
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.sources.camera_source import SourceError

HOST = "127.0.0.1"
SIZE = (LENS.width_px, LENS.height_px)
CAMERA = SourceSetup(kind="rtp", address="rtp://127.0.0.1:5600")


class FakeCamera:
    """Pictures that never end, a tenth of a second apart by their stamps."""

    def __init__(self, image: np.ndarray) -> None:
        self._image = image

    async def __aenter__(self) -> AsyncIterator[CameraReading]:
        return self.readings()

    async def __aexit__(self, *_: object) -> None:
        pass

    def __aiter__(self) -> AsyncIterator[CameraReading]:
        return self.readings()

    async def readings(self) -> AsyncIterator[CameraReading]:
        loop, k = asyncio.get_running_loop(), 0
        while True:
            await asyncio.sleep(0.01)
            yield CameraReading(100.0 + 0.05 * k, loop.time(), k, "real", self._image, LENS)
            k += 1


@asynccontextmanager
async def capture(port: int) -> AsyncIterator[None]:
    """Sends a pose every hundredth of a second."""

    async def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for seq in range(100_000):
                body = {"name": "drone", "position_m": [1, 2, -3], "q_wxyz": [1, 0, 0, 0]}
                frame = {"protocol": "wil/mocap/1", "seq": seq, "t_s": seq / 100, "frame": "ned"}
                out.sendto(json.dumps({**frame, "bodies": [body]}).encode(), (HOST, port))
                await asyncio.sleep(0.01)

    task = asyncio.create_task(send())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.wait([task])


@pytest.fixture
def port() -> int:
    return free_port()


def through(monkeypatch: pytest.MonkeyPatch, image: np.ndarray) -> list[dict[str, Any]]:
    asked: list[dict[str, Any]] = []

    def opened(address: str, **more: Any) -> FakeCamera:
        asked.append({"address": address, **more})
        return FakeCamera(image)

    monkeypatch.setattr(live_search, "live_camera", opened)
    return asked


async def test_board_and_poses_come_together(monkeypatch: pytest.MonkeyPatch, port: int) -> None:
    asked = through(monkeypatch, board_views(CHARUCO)[0])
    mocap = MocapSetup(kind="udp", host=HOST, port=port, body="drone")
    async with capture(port):
        order = LiveOrder(camera=CAMERA, size=SIZE, for_s=3.0, mocap=mocap)
        seen, path = await search_live(order, CHARUCO)
    assert asked[0]["address"] == "rtp://127.0.0.1:5600"
    assert asked[0]["intrinsics"].width_px == 640
    assert seen.size == SIZE
    assert len(seen.sightings) == seen.searched >= 1
    stamps = [sighting.t_s for sighting in seen.sightings]
    assert stamps == sorted(stamps)
    assert np.all(np.diff(stamps) > 0.099)  # every second one at most
    assert path is not None
    assert len(path.t_s) >= 10
    assert path.position_ned_m[0].tolist() == [1.0, 2.0, -3.0]


async def test_a_search_without_motion_capture_has_no_path(monkeypatch: pytest.MonkeyPatch) -> None:
    through(monkeypatch, np.full((480, 640, 3), 90, np.uint8))
    with pytest.raises(CalibrationError, match="was found in none of"):
        await search_live(LiveOrder(camera=CAMERA, size=SIZE, for_s=0.2), CHARUCO)
    through(monkeypatch, board_views(CHARUCO)[0])
    _, path = await search_live(LiveOrder(camera=CAMERA, size=SIZE, for_s=3.0), CHARUCO)
    assert path is None


async def test_motion_capture_that_says_nothing_is_reported(
    monkeypatch: pytest.MonkeyPatch, port: int
) -> None:
    through(monkeypatch, np.zeros((480, 640, 3), np.uint8))
    monkeypatch.setattr(MotionCaptures.ready, "__defaults__", (0.2,))
    mocap = MocapSetup(kind="udp", host=HOST, port=port, body="drone")
    with pytest.raises(SourceError, match="did not show 'drone'"):
        await search_live(LiveOrder(camera=CAMERA, size=SIZE, for_s=1.0, mocap=mocap), CHARUCO)
