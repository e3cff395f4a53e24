"""Duration of each stage of an image's way to the console's page, and the browser's share of it.

    python -m bench.console_stages [--seconds 8] [--rounds 3] [--webgl]

In turn: the console's page, and an empty page of the same server with three canvases and nothing
else. Three images of 640x480 at 15 Hz, the time of exposure in their pixels. Median and p95, ms:
exposure to sent by the flight's process (its JPEG made), sent to arrived in the page (the server,
the browser's network process), arrived to drawn (decoded, on the canvas), and exposure to pixels,
read back a frame of the screen later. Beside them the cores that other programs took meanwhile.
"""

import argparse
import json
import os
import statistics
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from unittest import mock

import psutil

from bench.console import (
    FACTS,
    HZ,
    IS_OPERATOR,
    JOIN,
    NAMES,
    RUN,
    WATCH,
    Console,
    Scenery,
    wait_for,
)
from tests.orchestrator.report.browser import Page, browser
from tests.orchestrator.wall_runs import ROOT
from wil_campaign.orchestrator.state.mixtures import PreviewImages
from wil_campaign.plugins.console.feed.feed_messages import FeedMessage, ImageView
from wil_campaign.plugins.console.feed.feed_publisher import FeedPublisher

WARM_UP_S = 3.0
STAGES = ("exposure to sent", "sent to arrived", "arrived to drawn")
NOTE = """(() => {
  window.steps = [];
  const now = () => performance.timeOrigin + performance.now();
  const waiting = new Map();
  const listen = WebSocket.prototype.addEventListener;
  WebSocket.prototype.addEventListener = function (kind, take, ...more) {
    const noted = (event) => {
      if (kind === 'message' && typeof event.data !== 'string') {
        const length = new DataView(event.data).getUint32(0);
        const head = JSON.parse(new TextDecoder().decode(new Uint8Array(event.data, 4, length)));
        waiting.set(`image-${head.name}`, { name: head.name, seq: head.seq, arrived: now() });
      }
      take(event);
    };
    listen.call(this, kind, noted, ...more);
  };
  const draw = CanvasRenderingContext2D.prototype.drawImage;
  CanvasRenderingContext2D.prototype.drawImage = function (...given) {
    draw.apply(this, given);
    const step = waiting.get(this.canvas.id);
    if (!step) return;
    waiting.delete(this.canvas.id);
    window.steps.push({ ...step, drawn: now() });
  };
})()"""
EMPTY = """(async (token) => {
  await fetch('/session', { method: 'POST', headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify({ token, name: 'empty' }) });
  document.body.replaceChildren(...['real', 'twin', 'mixed'].map((name) => {
    const canvas = document.createElement('canvas');
    return Object.assign(canvas, { id: `image-${name}`, width: 640, height: 480 });
  }));
  const socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = 'arraybuffer';
  let count = 0;
  socket.addEventListener('message', async ({ data }) => {
    if (typeof data === 'string') return;
    const ack = (count += 1);
    const length = new DataView(data).getUint32(0);
    const { name } = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const decoder = new ImageDecoder({ data: new Uint8Array(data, 4 + length), type: 'image/jpeg' });
    const { image } = await decoder.decode();
    document.getElementById(`image-${name}`).getContext('2d').drawImage(image, 0, 0);
    image.close();
    decoder.close();
    socket.send(JSON.stringify({ ack }));
  });
})"""  # noqa: E501 - it is a script


class Sent:
    """When each image was exposed and sent, ms since 1970."""

    def __init__(self) -> None:
        self.exposed: dict[tuple[str, int], float] = {}
        self.sent: dict[tuple[str, int], float] = {}

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note what the flight's process sends."""
        send = FeedPublisher._send  # noqa: SLF001 - nothing else says when it is sent

        def noting(publisher: FeedPublisher, message: FeedMessage) -> None:
            send(publisher, message)
            if isinstance(message, ImageView):
                self.sent[message.name, message.seq] = 1e3 * time.time()

        with mock.patch.object(FeedPublisher, "_send", noting):
            yield

    def stages(self, steps: Sequence[dict[str, Any]]) -> list[list[float]]:
        """Return what each stage took, of the images that were drawn."""
        keys = [(step["name"], step["seq"]) for step in steps]
        known = [
            (key, step)
            for key, step in zip(keys, steps, strict=True)
            if key in self.sent and key in self.exposed
        ]
        return [
            [self.sent[key] - self.exposed[key] for key, _ in known],
            [one["arrived"] - self.sent[key] for key, one in known],
            [one["drawn"] - one["arrived"] for _, one in known],
        ]


def open_page(page: Page, console: Console, *, is_empty: bool) -> None:
    page.resize(1440, 1000)
    page.send("Page.addScriptToEvaluateOnNewDocument", source=NOTE)
    base, _, token = console.operator.partition("/#")
    if is_empty:
        page.open(f"{base}/page/style.css")
        script = f"{EMPTY}({json.dumps(token)})"
        page.send("Runtime.evaluate", expression=script, awaitPromise=True)
    else:
        page.open(console.operator)
        page.value(JOIN)
        wait_for(page, IS_OPERATOR)
    page.value(WATCH)


def publish(feed: FeedPublisher, sent: Sent, scenery: Scenery, first: int, seconds: float) -> int:
    """Hand images over at the pace of a flight; return the number of the next."""
    begun_s = time.monotonic()
    for number in range(int(seconds * HZ)):
        time.sleep(max(0.0, begun_s + number / HZ - time.monotonic()))
        now_s, seq = time.monotonic(), first + number
        readings = {}
        for name in NAMES:
            readings[name] = scenery.reading(name, seq, now_s)
            sent.exposed[name, seq] = 1e3 * time.time()
        view = scenery.view(seq, now_s)
        feed.images(PreviewImages(readings["mixed"], "", readings["real"], readings["twin"]))
        feed.tick(lambda view=view: view)  # type: ignore[misc] # it is called at once
    return first + int(seconds * HZ)


def used_s() -> tuple[float, float]:
    """Return what this machine has been busy for, and what of it by us, seconds of a core."""
    of = psutil.cpu_times()
    me = psutil.Process()
    times = [one.cpu_times() for one in (me, *me.children(recursive=True))]
    return of.user + of.nice + of.system, sum(one.user + one.system for one in times)


def measure(what: str, *, is_empty: bool, webgl: bool, seconds: float) -> None:
    """Measure one page, and print its stages."""
    console, sent = Console(), Sent()
    of: dict[str, Any] = {"run": RUN, "time": time.monotonic, "facts": lambda: FACTS}
    try:
        with browser(webgl=webgl) as page, sent.noted():
            open_page(page, console, is_empty=is_empty)
            with FeedPublisher(**of, note=print) as feed:
                time.sleep(2.0)
                scenery = Scenery()
                following = publish(feed, sent, scenery, 0, WARM_UP_S)
                wait_for(page, "window.steps.length > 0")
                page.value("window.delays = []; window.steps = []")
                before, begun_s = used_s(), time.monotonic()
                publish(feed, sent, scenery, following, seconds)
                time.sleep(0.3)
                after, took_s = used_s(), time.monotonic() - begun_s
            delays, steps = page.value("window.delays"), page.value("window.steps")
    finally:
        console.end()
    all_of_it, ours = ((late - early) / took_s for early, late in zip(before, after, strict=True))
    named = zip((*STAGES, "exposure to pixels"), (*sent.stages(steps), delays), strict=True)
    print(f"{what}: load {os.getloadavg()[0]:.1f}, others took {all_of_it - ours:.2f} cores")
    for stage, values in named:
        ordered = sorted(values)
        p95 = ordered[int(0.95 * len(ordered))]
        print(f"  {stage}: {statistics.median(ordered):.1f}, {p95:.1f} ms, n {len(ordered)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--webgl", action="store_true", help="drawn in software")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="wil-") as base:
        os.environ["XDG_RUNTIME_DIR"] = base
        os.environ["PYTHONPATH"] = str(ROOT)
        for _ in range(asked.rounds):
            given = {"webgl": asked.webgl, "seconds": asked.seconds}
            measure("the console's page", is_empty=False, **given)
            measure("an empty page", is_empty=True, **given)


if __name__ == "__main__":
    main()
