"""Age of the console's page, delay of an abort from it, and its cost, compared with the targets.

    python -m bench.console [--seconds 60] [--trials 50] [--minutes 3]

Chromium shows the page without WebGL, on this machine; three more viewers are connected, one of
them stopped (SIGSTOP) all the time. Three images of 640x480 at 15 Hz are published as in a flight,
each with the time of its exposure in black and white squares along its top; the page reads them
back from its canvas, and takes the time a frame of the screen later. An abort is measured from the
Escape key to the first frame that the guard's process sends to a vehicle. Then the page receives as
much as it can, and the memory of page and server is read at equal intervals; the minutes of flight
are printed with it. The load of the machine is printed first.
"""

import argparse
import asyncio
import contextlib
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiohttp
import cv2
import numpy as np
import psutil

from bench.guard import guarded, p99_ms, tell
from tests.orchestrator.report.browser import Page, browser
from tests.orchestrator.report.recorded_campaign import CAMPAIGN, WORLD
from tests.orchestrator.wall_runs import ROOT
from wil_campaign.orchestrator.state.mixtures import PreviewImages
from wil_campaign.plugins.console.feed.feed_images import image_view
from wil_campaign.plugins.console.feed.feed_messages import (
    EventView,
    RunView,
    VehicleView,
    feed_codec,
)
from wil_campaign.plugins.console.feed.feed_publisher import FeedPublisher
from wil_campaign.plugins.console.feed.feed_sockets import FeedSender, find_console_sockets
from wil_campaign.vehicles.readings import CameraReading, Source
from wil_campaign.worlds.camera import Intrinsics

NAMES: tuple[Source, ...] = ("real", "twin", "mixed")
WIDTH, HEIGHT, SQUARE = 640, 480, 16
BITS = WIDTH // SQUARE
HZ = 15.0
RUN = "/bench/large/wil/1"
MOMENTS = 16
LENS = Intrinsics.from_fov(WIDTH, HEIGHT, 1.2)
FACTS = {
    "world": json.dumps(WORLD),
    "campaign": json.dumps(CAMPAIGN),
    "case": "large",
    "mode": "wil",
}
JOIN = "document.querySelector('#join-form button').click()"
LINK = "document.getElementById('link')"
IS_OPERATOR = "!document.getElementById('abort').disabled"
LOOK = """((width, square, bits) => {
  window.delays = [];
  const last = {}; let fresh = [];
  const row = new OffscreenCanvas(width, 1).getContext('2d', { willReadFrequently: true });
  const look = () => {
    const now = (performance.timeOrigin + performance.now()) * 10 % 2 ** bits;
    for (const stamp of fresh) window.delays.push((now - stamp) / 10);
    fresh = [];
    for (const name of ['real', 'twin', 'mixed']) {
      const canvas = document.getElementById(`image-${name}`);
      if (canvas.width !== width) continue;
      row.drawImage(canvas, 0, square / 2, width, 1, 0, 0, width, 1);
      const { data } = row.getImageData(0, 0, width, 1);
      let stamp = 0;
      for (let bit = 0; bit < bits; bit++) {
        stamp = 2 * stamp + (data[4 * square * (bit + 0.5)] > 127);
      }
      if (last[name] !== stamp) fresh.push(stamp);
      last[name] = stamp;
    }
    requestAnimationFrame(look);
  };
  look();
})"""
WATCH = f"{LOOK}({WIDTH}, {SQUARE}, {BITS})"
COUNT = """(() => {
  window.shown = 0;
  const draw = CanvasRenderingContext2D.prototype.drawImage;
  CanvasRenderingContext2D.prototype.drawImage = function (...given) {
    window.shown += this.canvas.id.startsWith('image-') && this.canvas.id !== 'image-overlay';
    return draw.apply(this, given);
  };
})()"""
"""Counts the images that the page draws; before the page's own scripts."""


class Scenery:
    """Images with the time of their exposure in them, and states of a run."""

    def __init__(self) -> None:
        drawn = cv2.imread(str(ROOT / "docs/images/hall.jpg"))
        self._image: Any = np.ascontiguousarray(cv2.resize(drawn, (WIDTH, HEIGHT)))

    def reading(self, source: Source, seq: int, t_s: float) -> CameraReading:
        """Return an image exposed now."""
        stamp = round(time.time() * 1e4) % 2**BITS
        bits = [(stamp >> (BITS - 1 - bit)) & 1 for bit in range(BITS)]
        image = self._image.copy()
        image[:SQUARE] = np.repeat(np.array(bits, np.uint8) * 255, SQUARE)[None, :, None]
        return CameraReading(t_s, t_s, seq, source, image, LENS)

    def view(self, seq: int, t_s: float, run: str = RUN) -> RunView:
        """Return the state of a run in which both vehicles fly circles."""
        turn = seq / 60.0
        place = (2.0 * np.sin(turn), 2.0 * np.cos(turn), -1.2 - 0.3 * np.sin(3.0 * turn))
        vehicles = tuple(
            VehicleView(
                name=name,
                armed=True,
                mode="OFFBOARD",
                landed="in_air",
                link_up=True,
                failsafe=False,
                silent_s=0.01,
                position_ned_m=place,
                velocity_ned_m_s=(0.5, 0.0, 0.0),
            )
            for name in ("real", "twin")
        )
        return RunView(
            run=run,
            name="large/wil/1",
            clock="wall",
            subject="real",
            t_s=t_s,
            stage="goal",
            entered_s={"start": 0.0},
            events={},
            verdict_so_far="PASS",
            reason="",
            held=False,
            vehicles=vehicles,
            margins=(),
            mixings=(),
            fences={},
        )


class Console:
    """A console's process. links: for the operator, for viewers."""

    def __init__(self) -> None:
        words = (sys.executable, "-m", "wil_campaign", "console")
        self._process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own program
        lines = [self._process.stdout.readline() for _ in range(2)]  # type: ignore[union-attr]
        self.operator, self.viewer = (line.partition(": ")[2].strip() for line in lines)
        self.state = psutil.Process(self._process.pid)

    def cpu_s(self) -> float:
        used = self.state.cpu_times()
        return used.user + used.system

    def end(self) -> None:
        self._process.terminate()
        self._process.wait()


async def look_on(link: str) -> None:
    """Be a viewer without a screen: read everything, and acknowledge images."""
    base, _, token = link.partition("/#")
    jar = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(cookie_jar=jar, headers={"Origin": base}) as session:
        (
            await session.post(f"{base}/session", json={"token": token, "name": "viewer"})
        ).raise_for_status()
        async with session.ws_connect(f"{base}/live", max_msg_size=0) as socket:
            print("open", flush=True)
            images = 0
            async for message in socket:
                if message.type is aiohttp.WSMsgType.BINARY:
                    images += 1
                    await socket.send_str(json.dumps({"ack": images}))


@contextmanager
def viewers(page: Page, count: int) -> Iterator[None]:
    """Have viewers in processes of their own look on; the last of them is stopped."""
    open_ones: list[subprocess.Popen[str]] = []
    try:
        for _ in range(count):
            page.value(f"{LINK}.textContent = '', document.getElementById('invite-viewer').click()")
            wait_for(page, f"{LINK}.textContent !== ''")
            link = page.value(f"{LINK}.textContent")
            words = (sys.executable, "-m", "bench.console", "--view", link)
            one = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own program
            open_ones.append(one)
            if one.stdout is None or one.stdout.readline() != "open\n":
                raise RuntimeError("a viewer cannot look on")
        open_ones[-1].send_signal(signal.SIGSTOP)
        yield
    finally:
        for one in open_ones:
            one.kill()
            one.wait()


def wait_for(page: Page, script: str) -> None:
    """Wait until an expression of the page is true."""
    give_up_s = time.monotonic() + 60.0
    while not page.value(script):
        if time.monotonic() > give_up_s:
            raise TimeoutError(script)
        time.sleep(0.05)


def join(page: Page, console: Console) -> None:
    """Open the page of a console as its operator."""
    page.resize(1440, 1000)
    page.send("Page.addScriptToEvaluateOnNewDocument", source=COUNT)
    page.open(console.operator)
    page.value(JOIN)
    wait_for(page, IS_OPERATOR)


def show_images(page: Page, console: Console, seconds: float, more: str) -> None:
    """Hand images over, and print how late they are on the screen, and what that costs."""
    scenery, handed_s = Scenery(), []
    with FeedPublisher(run=RUN, time=time.monotonic, facts=lambda: FACTS, note=print) as feed:
        time.sleep(2.0)
        page.value("window.delays = []")
        begun_s, cpu_s = time.monotonic(), console.cpu_s()
        for seq in range(int(seconds * HZ)):
            time.sleep(max(0.0, begun_s + seq / HZ - time.monotonic()))
            now_s = time.monotonic()
            readings = {name: scenery.reading(name, seq, now_s) for name in NAMES}
            view = scenery.view(seq, now_s)
            before_s = time.perf_counter()
            feed.images(PreviewImages(readings["mixed"], "", readings["real"], readings["twin"]))
            feed.tick(lambda view=view: view)
            handed_s.append(time.perf_counter() - before_s)
        time.sleep(0.5)
        share = (console.cpu_s() - cpu_s) / (time.monotonic() - begun_s)
    delays_ms = sorted(page.value("window.delays"))
    p95 = delays_ms[int(0.95 * len(delays_ms))]
    of = (
        f", median {statistics.median(delays_ms):.0f} ms, "
        f"{len(delays_ms)} of {int(seconds * HZ) * len(NAMES)} images"
    )
    tell(f"exposure to pixels{more}, p95", p95, 50.0, "ms", of)
    tell(f"the server{more}", 100.0 * share, 15.0, "% of a core")
    tell(f"hand-over in the flight{more}, median", 1e3 * statistics.median(handed_s), 1.0, "ms")


async def press_abort(page: Page, folder: Path) -> float:
    """Return the time from the Escape key to the guard's first frame on the wire."""
    async with guarded(folder) as (_, wire):
        begun_s = time.monotonic()
        await asyncio.to_thread(page.press, "Escape")
        async with asyncio.timeout(5.0):
            await wire.commanded.wait()
        return wire.at_s - begun_s


@dataclass(frozen=True, slots=True)
class Memory:
    """What is held at a moment, in MB, and how many images and states were sent and shown before.

    heap_mb: of the page's scripts, after what is free was collected; page_mb: of its processes.
    """

    heap_mb: float
    page_mb: float
    server_mb: float
    images: int
    states: int

    @classmethod
    def now(cls, page: Page, console: Console, states: int) -> "Memory":
        page.send("HeapProfiler.collectGarbage")
        return cls(
            heap_mb=float(page.send("Runtime.getHeapUsage")["usedSize"]) / 1e6,
            page_mb=sum(renderer.memory_info().rss for renderer in renderers()) / 1e6,
            server_mb=console.state.memory_info().rss / 1e6,
            images=int(page.value("window.shown")),
            states=states,
        )


def renderers() -> list[psutil.Process]:
    """Return the processes of this process's browser that hold pages, and what they draw."""
    below = psutil.Process().children(recursive=True)
    kinds = {"--type=renderer", "--type=gpu-process"}
    return [one for one in below if kinds & set(one.cmdline())]


def show_memory(page: Page, console: Console, minutes: float) -> None:
    """Show the page all it takes, and print how memory went behind a quarter for warming up."""
    scenery, moments = Scenery(), list[Memory]()
    images = [image_view(RUN, name, scenery.reading(name, 0, 0.0), 0.0) for name in NAMES]
    (path,) = find_console_sockets()
    sender = FeedSender(path)
    begun_s, seq = time.monotonic(), 0
    while len(moments) <= MOMENTS:
        if time.monotonic() - begun_s >= len(moments) * 60.0 * minutes / MOMENTS:
            moments.append(Memory.now(page, console, seq))
        event = EventView(RUN, seq, seq / HZ, "vehicle", "text", "real", f"text {seq}")
        for message in (*images, scenery.view(seq, seq / HZ), *([event] if seq % 15 == 0 else [])):
            sender.send(feed_codec.encode(message))
        seq += 1
        time.sleep(0.02)
    sender.close()
    settled = moments[MOMENTS // 4 :]
    half = len(settled) // 2
    count = settled[-1].images - settled[0].images, settled[-1].states - settled[0].states
    print(
        f"memory: {minutes:g} min with the images of {count[0] / 3 / HZ / 60:.1f} min of flight "
        f"and the states of {count[1] / HZ / 60:.0f} min"
    )
    for what in ("heap_mb", "page_mb", "server_mb"):
        values = [getattr(one, what) for one in settled]
        early, late = statistics.median(values[:half]), statistics.median(values[half:])
        more = f", {early:.1f} to {late:.1f} MB"
        tell(
            f"growth of {what}, second half to first", 100.0 * (late / early - 1.0), 5.0, "%", more
        )


def measure(asked: argparse.Namespace, base: Path) -> None:
    """Measure everything in one browser."""
    print(f"load of this machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores", flush=True)
    console = Console()
    try:
        with browser() as page:
            join(page, console)
            page.value(WATCH)
            show_images(page, console, asked.seconds, ", one viewer")
            with viewers(page, 3):
                show_images(page, console, asked.seconds, ", four viewers, one stopped")
                found = []
                for number in range(asked.trials):
                    folder = base / str(number)
                    folder.mkdir()
                    found.append(asyncio.run(press_abort(page, folder)))
                of = f", median {1e3 * statistics.median(found):.0f} ms, n {len(found)}"
                tell(
                    "press of abort to the wire, four viewers, one stopped, p99",
                    p99_ms(found),
                    60.0,
                    "ms",
                    of,
                )
            show_memory(page, console, asked.minutes)
            print(f"errors of the page: {page.errors}")
    finally:
        console.end()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--minutes", type=float, default=3.0)
    parser.add_argument("--view", metavar="LINK", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.view:
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(look_on(asked.view))
        return
    with tempfile.TemporaryDirectory(prefix="wil-") as base:
        os.environ["XDG_RUNTIME_DIR"] = base
        os.environ["PYTHONPATH"] = str(ROOT)
        measure(asked, Path(base))


if __name__ == "__main__":
    main()
