"""The live feed of a run: what a console gets, and that a flight waits for none."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from statistics import median
from types import SimpleNamespace

import numpy as np
import pytest

from tests.plugins.console.test_console_server import view
from wil_campaign.orchestrator.state.mixtures import PreviewImages
from wil_campaign.plugins.console.feed.feed_messages import (
    EventView,
    FactsView,
    FeedMessage,
    ImageView,
    RunView,
    feed_codec,
)
from wil_campaign.plugins.console.feed.feed_publisher import FeedPublisher
from wil_campaign.plugins.console.feed.feed_sockets import feed_receiver
from wil_campaign.vehicles.readings import CameraReading, Source
from wil_campaign.worlds.camera import Intrinsics

PATIENCE_S = 10.0


@pytest.fixture(autouse=True)
def runtime(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    monkeypatch.setenv("HOME", str(short_folder))


def publisher(notes: list[str] | None = None) -> FeedPublisher:
    return FeedPublisher(
        run="/r",
        time=lambda: 2.0,
        facts=lambda: {"case": "large"},
        note=([] if notes is None else notes).append,
    )


def images() -> PreviewImages:
    def reading(source: Source) -> CameraReading:
        image = np.zeros((48, 1280, 3), np.uint8)
        return CameraReading(1.9, 1.95, 3, source, image, Intrinsics.from_fov(1280, 48, 1.2))

    return PreviewImages(
        reading("mixed"), "/mixed/camera", reading("real"), reading("twin"), alone="skew"
    )


def received(end: socket.socket) -> Iterator[FeedMessage]:
    end.settimeout(PATIENCE_S)
    while True:
        yield feed_codec.decode(end.recv(1 << 18))


def wait_for(condition: Callable[[], bool]) -> None:
    give_up_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up_s
        time.sleep(0.01)


def test_a_console_gets_facts_events_views_and_images() -> None:
    with feed_receiver() as end, publisher() as feed:
        for number in range(3):
            feed.event(1.0, "stage", f"stage {number}", "")
        asked: list[bool] = []

        def state() -> RunView:
            asked.append(True)
            return view(2.0)

        def tick() -> bool:
            feed.tick(state)
            return bool(asked)

        wait_for(tick)
        feed.images(images())
        found: list[FeedMessage] = []
        for message in received(end):
            found.append(message)
            if {one.name for one in found if isinstance(one, ImageView)} == {
                *("real", "twin", "mixed")
            }:
                break
    assert isinstance(found[0], FactsView)
    assert [one.number for one in found if isinstance(one, EventView)] == [1, 2, 3]
    assert any(isinstance(one, RunView) for one in found)
    shown = next(one for one in found if isinstance(one, ImageView))
    # Who looks on is told that a mixture is the real image alone.
    assert {one.name: one.alone for one in found if isinstance(one, ImageView)} == {
        "real": "",
        "twin": "",
        "mixed": "skew",
    }
    assert (shown.width_px, round(shown.age_s, 3), shown.jpeg[:2]) == (1280, 0.1, b"\xff\xd8")


def test_no_state_is_requested_and_no_image_kept_without_a_console() -> None:
    with publisher() as feed:
        time.sleep(0.1)
        feed.images(images())
        feed.tick(lambda: pytest.fail("asked for"))


def test_a_console_that_never_reads_holds_up_nothing() -> None:
    with feed_receiver(), publisher() as feed:
        wait_for(lambda: feed._has_consoles)
        rounds_s, shown = list[float](), images()
        for _ in range(2000):
            began_s = time.perf_counter()
            feed.tick(lambda: view(2.0))
            feed.images(shown)
            feed.event(1.0, "vehicle", "text", "x" * 5000)
            rounds_s.append(time.perf_counter() - began_s)
        # The median: what another process takes the core from is no wait for a console.
        assert median(rounds_s) < 0.001
    # It ends by itself: leaving the feed waits for it no longer than two seconds.
    assert not feed._thread.is_alive()


def test_a_console_whose_queue_is_full_at_the_end_gets_the_last_event(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else it shows a run that has ended as one that still lands. It reads while the feed waits."""
    last = 40
    numbers: list[int] = []
    with feed_receiver() as end:

        def read(_: float = 0.0) -> None:
            with suppress(BlockingIOError):
                while True:
                    message = feed_codec.decode(end.recv(1 << 18))
                    if isinstance(message, EventView):
                        numbers.append(message.number)

        waiting = SimpleNamespace(sleep=read, monotonic=time.monotonic)
        monkeypatch.setattr("wil_campaign.plugins.console.feed.feed_publisher.time", waiting)
        with publisher() as feed:
            wait_for(lambda: feed._has_consoles)
            for _ in range(last):
                feed.event(1.0, "vehicle", "text", "")
        read()
    assert numbers == list(range(1, last + 1))


def test_an_exception_of_ours_ends_the_feed_and_no_flight() -> None:
    notes: list[str] = []

    def fail() -> RunView:
        raise RuntimeError("broken")

    with feed_receiver(), publisher(notes) as feed:
        wait_for(lambda: feed._wants_view)
        feed.tick(fail)
        feed.tick(fail)
    assert notes == ["the live feed ended: RuntimeError: broken"]
