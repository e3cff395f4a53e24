"""Live cameras: what the thread grabs reaches the loop, and what goes wrong is said."""

import asyncio
import queue
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.plugins.cameras.pumping import pump
from wil_campaign.plugins.cameras.live_camera import GrabbedImage, LiveCamera
from wil_campaign.vehicles.sources.camera_source import (
    CameraSource,
    ImageChangedError,
    SourceError,
    SourceStalledError,
)
from wil_campaign.worlds.camera import Intrinsics

SMALL = Intrinsics.from_fov(8, 6, 1.0)


def picture(
    level: int, height: int = 6, width: int = 8
) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    return np.full((height, width, 3), level, np.uint8)


class FakeGrabber:
    """Gives what a test puts in; None ends `grab` without a picture."""

    def __init__(self, opening: Callable[[], None] = lambda: None) -> None:
        self.things: queue.Queue[GrabbedImage | Exception] = queue.Queue()
        self.opening = opening
        self.closed = threading.Event()
        self.idle = threading.Event()

    def put(self, level: int, stamp_s: float | None) -> None:
        self.things.put(GrabbedImage(picture(level), stamp_s))

    def open(self) -> None:
        self.opening()

    def grab(self) -> GrabbedImage | None:
        try:
            thing = self.things.get(timeout=0.01)
        except queue.Empty:
            self.idle.set()
            return None
        if isinstance(thing, Exception):
            raise thing
        return thing

    def close(self) -> None:
        self.closed.set()

    def all_taken(self) -> None:
        # Nothing was there at two looks, one of which began after the last thing was handed on.
        for _ in range(2):
            self.idle.clear()
            assert self.idle.wait(10.0)


def camera(grabber: FakeGrabber, **more: Any) -> LiveCamera:
    return LiveCamera(name="camera 1", grabber=grabber, intrinsics=SMALL, **more)


async def test_images_come_in_order_with_their_times() -> None:
    grabber = FakeGrabber()
    async with camera(grabber, latency_s=0.02) as source:
        assert isinstance(source, CameraSource)
        before_s = asyncio.get_running_loop().time()
        for k in range(3):
            grabber.put(k, 100.0 + 0.001 * k)
            reading = await anext(source)
            now_s = asyncio.get_running_loop().time()
            assert reading.seq == k
            assert int(reading.image_bgr[0, 0, 0]) == k
            assert before_s - 0.02 <= reading.t_s <= reading.arrived_s - 0.02 + 1e-9
            assert reading.arrived_s <= now_s
            assert reading.rendered is False
        assert source.counts.delivered == 3
    assert grabber.closed.is_set()


async def test_a_slow_reader_gets_the_newest_and_the_rest_is_counted() -> None:
    grabber = FakeGrabber()
    async with camera(grabber, depth=2) as source:
        for k in range(6):
            grabber.put(k, 100.0 + 0.001 * k)
        await asyncio.to_thread(grabber.all_taken)
        readings = [await anext(source), await anext(source)]
    assert [int(r.image_bgr[0, 0, 0]) for r in readings] == [4, 5]
    assert [r.seq for r in readings] == [4, 5]
    assert source.counts.dropped == 4


async def test_a_broken_picture_is_counted_and_leaves_a_gap() -> None:
    grabber = FakeGrabber()
    async with camera(grabber) as source:
        grabber.put(0, 1.0)
        first = await anext(source)
        grabber.things.put(GrabbedImage(None, 1.1))
        grabber.put(2, 1.2)
        second = await anext(source)
    assert (first.seq, second.seq) == (0, 2)
    assert source.counts.damaged == 1


async def test_a_camera_that_stalls_says_so() -> None:
    grabber = FakeGrabber()
    async with camera(grabber, stall_timeout_s=0.1) as source:
        grabber.put(0, 1.0)
        await asyncio.to_thread(grabber.all_taken)
        await anext(source)
        with pytest.raises(SourceStalledError, match=r"camera 1: no image for 0\.1 s after 1"):
            await anext(source)
        grabber.put(1, 1.5)
        await asyncio.to_thread(grabber.all_taken)
        assert (await anext(source)).seq == 1


@pytest.mark.parametrize("what", ["damaged", "with a clock that stands"])
async def test_a_camera_of_which_nothing_is_usable_has_stalled(what: str) -> None:
    grabber = FakeGrabber()

    async def sending() -> None:
        while True:
            pixels = None if what == "damaged" else picture(1)
            grabber.things.put(GrabbedImage(pixels, 1.0))
            await asyncio.sleep(0.01)

    async with camera(grabber, stall_timeout_s=0.3) as source:
        grabber.put(0, 1.0)
        await anext(source)
        task = asyncio.create_task(sending())
        said = r"no image for 0\.3 s after 1 images \(\d+ incomplete, a second late, or with a time"
        for _ in range(2):
            with pytest.raises(SourceStalledError, match=said):
                async with asyncio.timeout(10.0):
                    await anext(source)
        task.cancel()
        await asyncio.wait([task])
        grabber.put(2, 2.0)
        assert (await anext(source)).seq > 10
    assert source.counts.damaged > 10


async def test_another_size_in_flight_is_an_error_and_no_reading() -> None:
    grabber = FakeGrabber()
    seen: list[Any] = []
    async with camera(grabber) as source:
        grabber.put(0, 1.0)
        grabber.things.put(GrabbedImage(picture(1, 12, 16), 1.1))
        with pytest.raises(ImageChangedError, match="images are 16x12"):
            await pump(source, seen.append)
    assert [reading.seq for reading in seen] == [0]


async def test_a_camera_that_dies_says_why() -> None:
    grabber = FakeGrabber()
    async with camera(grabber) as source:
        grabber.put(0, 1.0)
        await anext(source)
        grabber.things.put(SourceError("camera 1: was lost"))
        with pytest.raises(SourceError, match="was lost"):
            await anext(source)


async def test_an_error_of_the_grabber_itself_reaches_the_waiter() -> None:
    grabber = FakeGrabber()
    async with camera(grabber) as source:
        grabber.things.put(ZeroDivisionError("in a driver"))
        with pytest.raises(SourceError, match="camera 1: ZeroDivisionError: in a driver"):
            await anext(source)


async def test_a_camera_that_does_not_open_is_closed_again() -> None:
    def fail() -> None:
        raise SourceError("camera 1: no permission")

    grabber = FakeGrabber(fail)
    with pytest.raises(SourceError, match="no permission"):
        async with camera(grabber):
            pass
    assert grabber.closed.is_set()


async def test_a_device_that_hangs_at_opening_is_given_up() -> None:
    told_to_stop: list[bool] = []
    # Closing waits for the thread: it lets go once the waiting is over.
    grabber = FakeGrabber(lambda: told_to_stop.append(source._stop.wait(10.0)))
    source = camera(grabber, open_timeout_s=-1.9)
    with pytest.raises(SourceError, match="did not open within"):
        async with source:
            pass
    assert told_to_stop == [True]


async def test_the_loop_is_never_held_up() -> None:
    turns = threading.Event()
    waited: list[bool] = []
    # Opening takes until the loop has turned some times: it would wait in vain if it held it up.
    grabber = FakeGrabber(lambda: waited.append(turns.wait(10.0)))

    async def turn() -> None:
        for _ in range(10):
            await asyncio.sleep(0.01)
        turns.set()

    turning = asyncio.create_task(turn(), name="turning")
    async with camera(grabber) as source:
        grabber.put(0, 1.0)
        await anext(source)
    await turning
    assert waited == [True]


async def test_a_device_that_cannot_be_closed_hides_nothing(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def close() -> None:
        raise OSError(19, "No such device")

    grabber = FakeGrabber()
    monkeypatch.setattr(grabber, "close", close)
    async with camera(grabber) as source:
        grabber.things.put(SourceError("unplugged"))
        with pytest.raises(SourceError, match="unplugged"):
            await anext(source)
    assert "Traceback" not in capfd.readouterr().err
