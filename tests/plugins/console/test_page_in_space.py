"""The view in space of the console's page, in a browser that has WebGL, over a recorded run."""

import asyncio
import hashlib
import re
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from aiohttp.test_utils import TestServer

from tests.orchestrator.report import recorded_campaign
from tests.orchestrator.report.browser import Page, browser, chromium
from tests.orchestrator.report.recorded_campaign import write_campaign
from tests.ports import free_port
from wil_campaign.plugins.console.console_access import ConsoleAccess
from wil_campaign.plugins.console.console_address import ConsoleAddress, RequestRules
from wil_campaign.plugins.console.console_hub import ConsoleHub
from wil_campaign.plugins.console.console_server import ConsoleServer
from wil_campaign.plugins.console.flight_scope import FlightScope
from wil_campaign.plugins.console.page_commands import CommandSender
from wil_campaign.plugins.console.playback import Playback
from wil_campaign.plugins.console.recorded_run import RecordedRun

PATIENCE_S = 60.0
PAUSE = "document.getElementById('playback-pause').textContent"
TIME = "document.getElementById('playback-time').textContent"
LAST = f"{TIME}.split(' of ')[1].replace(' s', '')"
TO_ITS_END = (
    "(() => { const line = document.getElementById('playback-line'); line.value = line.max;"
    "line.dispatchEvent(new Event('change')); })()"
)
JOIN = "document.querySelector('#join-form button').click()"
NOTE = "document.getElementById('space-note').textContent"
LOSE = "document.getElementById('space').getContext('webgl2').getExtension('WEBGL_lose_context')"
COLOURS = {"real": (0x15, 0x65, 0xC0), "twin": (0xC2, 0x18, 0x5B), "fence": (0x8A, 0x5A, 0x00)}
ORANGE = (0xE0, 0x7B, 0x00)
LEAST_PX = 25
POST_PX = 14


def seen(image: Any, rgb: tuple[int, int, int], within: int = 40) -> int:
    """Return how many pixels have about this colour."""
    return int((np.abs(image.astype(int) - rgb[::-1]).max(axis=2) < within).sum())


def width_of(image: Any, rgb: tuple[int, int, int], least_px: int = 1) -> float:
    """Return how much of the image's width what has about this colour takes.

    least_px: in a column, to count; with more than a letter has, labels are left out.
    """
    is_of_colour = np.abs(image.astype(int) - rgb[::-1]).max(axis=2) < 40
    columns = (is_of_colour.sum(axis=0) >= least_px).nonzero()[0]
    return float(np.ptp(columns)) / image.shape[1] if len(columns) else 0.0


def space_image(page: Page, path: Path, canvas: str = "space") -> Any:
    """Return what the canvas of the view in space shows."""
    page.settle()
    page.screenshot(path)
    box = page.value(
        "(({x, y, width, height}) => [x, y, width, height])"
        f"(document.getElementById('{canvas}').getBoundingClientRect())"
    )
    x, y, width, height = (round(one) for one in box)
    image = cv2.imread(str(path))
    assert image is not None
    return image[y : y + height, x : x + width]


async def serve_and_look(folder: Path, look: Callable[[str], None]) -> None:
    """Serve a recorded run, and look at it from a thread. look: is given the link."""
    access = ConsoleAccess()
    port = free_port()
    hub = ConsoleHub(about={"mode": "recorded"}, access=access)
    sender = CommandSender(FlightScope())
    time = asyncio.get_running_loop().time
    playback = Playback(2.0, time=time, show=hub.show_playback)
    server = ConsoleServer(
        access=access,
        rules=RequestRules.of(ConsoleAddress("127.0.0.1", port), tls=False),
        hub=hub,
        sender=sender,
        cookie="session",
        time=time,
        playback=playback,
    )

    async def beat() -> None:
        """Send statuses, without which a page takes its server for gone and darkens."""
        while True:
            hub.show_status({"campaigns": [], "guards": [], "problem": ""})
            await asyncio.sleep(0.5)

    playing = RecordedRun(folder, playback).play(hub.receive)
    tasks = {asyncio.create_task(playing), asyncio.create_task(beat())}
    try:
        async with TestServer(server.application(), port=port):
            link = f"http://127.0.0.1:{port}/#{access.invite('operator')}"
            await asyncio.to_thread(look, link)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        sender.close()


def wait_until(page: Page, holds: Callable[[], bool]) -> None:
    """Wait until something holds, as long as a slow machine needs."""
    for _ in range(int(PATIENCE_S / 0.1)):
        if holds():
            return
        page.send(
            "Runtime.evaluate",
            expression="new Promise((f) => setTimeout(f, 100))",
            awaitPromise=True,
        )
    pytest.fail("it did not come")


@pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
async def test_the_view_in_space_shows_vehicles_fence_and_gate_and_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From everywhere, and as the campaign's observer, who looks north at the gate from near it."""
    observer = {"north_m": 0.9, "east_m": 0.0, "up_m": 1.2, "yaw_deg": 0.0}
    monkeypatch.setitem(recorded_campaign.CAMPAIGN, "observer", observer)
    folder = write_campaign(tmp_path / "gate") / "large" / "wil" / "1"
    shot = tmp_path / "shot.png"

    def look(link: str) -> None:
        with browser(webgl=True) as page:
            page.resize(900, 600)
            page.open(link)
            page.value(JOIN)

            def is_drawn() -> bool:
                image = space_image(page, shot)
                return all(seen(image, one) > LEAST_PX for one in (*COLOURS.values(), ORANGE))

            wait_until(page, is_drawn)
            assert page.value(NOTE) == ""
            before = width_of(space_image(page, shot), ORANGE, POST_PX)
            # Paused, the run stands still at the time that is chosen.
            page.value("document.getElementById('playback-pause').click()")
            wait_until(page, lambda: page.value(PAUSE) == "Play")
            page.value(TO_ITS_END)
            wait_until(page, lambda: page.value(TIME).split(" of ")[0] == page.value(LAST))
            # At its end the verdict is final, in whatever stage the recording ended.
            verdict = "document.getElementById('verdict').textContent"
            wait_until(page, lambda: page.value(verdict) == "FAIL")
            assert (
                page.value("document.getElementById('verdict-label').textContent")
                == "Verdict, final"
            )
            marks = "document.getElementById('playback-marks').childElementCount > 0"
            wait_until(page, lambda: page.value(marks))
            page.value("document.getElementById('space').focus()")
            for _ in range(8):
                page.press("ArrowRight")
            # Seen from beside, a gate is narrower.
            wait_until(
                page,
                lambda: 0 < width_of(space_image(page, shot), ORANGE, POST_PX) < 0.7 * before,
            )
            # Its frame of 1.2 m, 1.1 m away, is as wide as 80 % of the view.
            page.value("document.getElementById('space-observer').click()")
            wait_until(page, lambda: width_of(space_image(page, shot), ORANGE) > 0.6)
            page.value("document.getElementById('space-reset').click()")
            wait_until(page, lambda: 0 < width_of(space_image(page, shot), ORANGE) < 0.5)
            assert page.errors == []
            assert [
                request
                for request in page.requests
                if not request.startswith(link.partition("#")[0])
            ] == []
            page.value("document.getElementById('playback-pause').click()")
            page.value(f"(window.lost = {LOSE}).loseContext()")
            # Without its graphics the view is drawn flat; they may never come back.
            wait_until(page, lambda: "without perspective" in page.value(NOTE))
            assert page.value("document.getElementById('space').hidden")
            wait_until(page, lambda: seen(space_image(page, shot, "space-flat"), ORANGE) > LEAST_PX)
            page.value("window.lost.restoreContext()")
            wait_until(page, lambda: page.value(NOTE) == "")
            wait_until(page, lambda: seen(space_image(page, shot), ORANGE) > LEAST_PX)
            assert page.value("document.getElementById('space-flat').hidden")
            assert [error for error in page.errors if "does not belong" in error] == []

    await serve_and_look(folder, look)


def test_vendored_libraries_are_those_that_are_listed() -> None:
    folder = files("wil_campaign.plugins.console") / "page" / "vendor"
    listed = re.findall(
        r"\| (\S+/\S+\.js) \| ([0-9a-f]{64}) \|", (folder / "README.md").read_text()
    )
    present = {
        f"three/{one.name}" for one in (folder / "three").iterdir() if one.name.endswith(".js")
    }
    assert {path for path, _ in listed} == present
    for path, digest in listed:
        assert hashlib.sha256((folder / path).read_bytes()).hexdigest() == digest
    assert "MIT License" in (folder / "three" / "LICENSE").read_text(encoding="utf-8")
