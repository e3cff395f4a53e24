"""Cameras with pictures from outside: opened early, watched, and never wrong."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.orchestrator.external.rigs import until
from tests.plugins.cameras.conftest import Sender, given_port, sending
from wil_campaign.campaigns.values.external_setups import SourceSetup
from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.external.external_io import ExternalCamera
from wil_campaign.vehicles.readings import CameraReading, Reading
from wil_campaign.vehicles.sources.camera_source import (
    ImageChangedError,
    SourceError,
    SourceStalledError,
)
from wil_campaign.worlds.camera import CameraMount, Intrinsics

__all__ = ["given_port", "sending"]

Sending = Callable[..., Sender]


def camera(source: SourceSetup, width: int = 160, height: int = 120) -> ExternalCamera:
    setup = CameraSetup(
        name="camera",
        rate_hz=50.0,
        intrinsics=Intrinsics.from_fov(width, height, 1.2),
        mount=CameraMount(),
        source=source,
    )
    return ExternalCamera(camera=setup, source=source, side="real")


def live(port: int, **more: float) -> ExternalCamera:
    return camera(SourceSetup(kind="rtp", address=f"rtp://127.0.0.1:{port}", **more))  # type: ignore[arg-type]  # a test's short form


def images(folder: Path, count: int, size: tuple[int, int] = (160, 120)) -> SourceSetup:
    folder.mkdir()
    for k in range(count):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((size[1], size[0], 3), 10 * k, np.uint8))
    return SourceSetup(kind="images", address=str(folder))


def test_a_recording_begins_when_it_is_needed_and_its_end_is_reported(tmp_path: Path) -> None:
    async def play() -> tuple[list[Reading], ExternalCamera]:
        one, seen = camera(images(tmp_path / "i", 5)), list[Reading]()
        async with AsyncExitStack() as stack:
            await one.open(stack)
            await asyncio.sleep(10.0)
            with pytest.raises(SourceError, match="the recording is over"):
                await one.run(seen.append)
        return seen, one

    seen, one = run_virtual(play())
    assert [reading.t_s for reading in seen] == pytest.approx([10.0 + k / 50 for k in range(5)])
    assert not any(reading.rendered for reading in seen if isinstance(reading, CameraReading))
    assert one.result.trouble.endswith("the recording is over")
    assert (one.result.source, one.result.delivered, one.result.sensor) == ("file", 5, "camera")


def test_a_recording_that_cannot_be_had_is_known_before_anything_flies(tmp_path: Path) -> None:
    async def opened(one: ExternalCamera) -> None:
        async with AsyncExitStack() as stack:
            await one.open(stack)

    with pytest.raises(SourceError, match="images are 64x48"):
        run_virtual(opened(camera(images(tmp_path / "i", 2, (64, 48)))))
    (tmp_path / "bad.mp4").write_text("no video")
    bad = camera(SourceSetup(kind="video", address=str(tmp_path / "bad.mp4")))
    with pytest.raises(SourceError, match="video that can be decoded"):
        run_virtual(opened(bad))


async def test_a_live_camera_hands_on_what_is_taken_from_now_on(
    sending: Sending, free_port: int
) -> None:
    sending(free_port)
    one, seen, stalls = live(free_port), list[Reading](), list[str]()
    one.on_stall(stalls.append)
    async with AsyncExitStack() as stack:
        await one.open(stack)
        await asyncio.sleep(0.3)
        since_s = asyncio.get_running_loop().time()
        running = asyncio.create_task(one.run(seen.append))
        await until(lambda: len(seen) >= 5)
        running.cancel()
        await asyncio.wait([running])
    assert all(reading.arrived_s >= since_s for reading in seen)
    assert stalls == []
    assert one.result.source == "live"
    # Images before somebody wanted them are neither delivered nor dropped.
    assert one.result.delivered == len(seen) >= 5
    # Only a machine too busy to take them loses any: of those since the first, two of which may
    # have waited behind the last.
    between = seen[-1].seq - seen[0].seq + 1 + 2
    assert one.result.dropped + one.result.delivered + one.result.missed <= between


async def test_a_live_camera_that_stalls_says_so_and_may_go_on(
    sending: Sending, free_port: int
) -> None:
    sender = sending(free_port)
    one, seen, stalls = live(free_port, stall_s=1.5, open_s=30.0), list[Reading](), list[str]()
    one.on_stall(stalls.append)
    async with AsyncExitStack() as stack:
        await one.open(stack)
        running = asyncio.create_task(one.run(seen.append))
        await until(lambda: len(seen) >= 3)
        await asyncio.to_thread(sender.stop)
        await until(lambda: len(stalls) > 1)
        assert one.result.stalls == 1, "it goes on"
        before = len(seen)
        sending(free_port)
        await until(lambda: len(seen) > before)
        running.cancel()
        await asyncio.wait([running])
    assert stalls[0].startswith("real camera: rtp://127.0.0.1:")
    assert "no image for 1.5 s" in stalls[0]
    assert one.result.stalls >= 1


async def test_a_live_camera_whose_size_changes_is_lost_with_the_reason(
    sending: Sending, free_port: int
) -> None:
    sending(free_port, lambda k: (160, 120) if k < 60 else (320, 240))
    one, seen = live(free_port), list[Reading]()
    async with AsyncExitStack() as stack:
        await one.open(stack)
        async with asyncio.timeout(30.0):
            with pytest.raises(ImageChangedError, match="images are 320x240"):
                await one.run(seen.append)
    shapes = {reading.image_bgr.shape for reading in seen if isinstance(reading, CameraReading)}
    assert shapes <= {(120, 160, 3)}
    assert "images are 320x240" in one.result.trouble


async def test_a_live_camera_of_another_size_is_known_before_anything_flies(
    sending: Sending, free_port: int
) -> None:
    sending(free_port)
    address = SourceSetup(kind="rtp", address=f"rtp://127.0.0.1:{free_port}", open_s=30.0)
    async with AsyncExitStack() as stack:
        with pytest.raises(ImageChangedError, match=r"images are 160x120.*640x480"):
            await camera(address, 640, 480).open(stack)


async def test_a_live_camera_that_died_before_arming_is_known_before_arming(
    sending: Sending, free_port: int
) -> None:
    sender, loop = sending(free_port), asyncio.get_running_loop()
    one = live(free_port, stall_s=1.5, open_s=30.0)

    async def as_long_as_images_come() -> None:
        while True:  # a busy machine takes what was sent before for a while
            await one.ready(since_s=loop.time())

    async with AsyncExitStack() as stack, asyncio.timeout(60.0):
        await one.open(stack)
        await one.ready(since_s=loop.time())
        await asyncio.to_thread(sender.stop)
        with pytest.raises(SourceError, match=r"no image for 1\.5 s"):
            await as_long_as_images_come()


async def test_an_image_that_came_before_is_no_sign_of_life_before_arming() -> None:
    """The newest image is kept until it is taken, also of a camera that has died since."""
    one = live(5600)

    async def kept() -> AsyncIterator[SimpleNamespace]:
        yield SimpleNamespace(arrived_s=9.9)
        raise SourceStalledError("no image for 1 s")

    vars(one)["_source"] = kept()
    with pytest.raises(SourceStalledError):
        await one.ready(since_s=10.0)
