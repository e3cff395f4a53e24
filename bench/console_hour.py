"""What an hour before the console's page does to the memory of page and server.

    python -m bench.console_hour [--minutes 60] [--run-seconds 180] [--webgl]

Chromium shows a campaign of run after run at the pace of a flight: three images of 640x480 and a
state fifteen times a second, an event each second. Each minute a line says, in MB, what the page's
own scripts hold after their garbage is collected, what the page's process holds, its worker and its
view in space in it, and what the server's does. At the end, and on Ctrl-C or SIGTERM, the verdict:
behind a fifth for warming up, the median of the last third beside that of the first.
"""

import argparse
import os
import signal
import statistics
import tempfile
import time
from pathlib import Path

from bench.console import (
    FACTS,
    HZ,
    NAMES,
    Console,
    Memory,
    Scenery,
    join,
)
from bench.guard import tell
from tests.orchestrator.report.browser import Page, browser
from tests.orchestrator.wall_runs import ROOT
from wil_campaign.orchestrator.state.mixtures import PreviewImages
from wil_campaign.plugins.console.feed.feed_publisher import FeedPublisher

LARGEST_GROWTH_PERCENT = 5.0
MINUTE_S = 60.0
FEWEST = 6


class Minutes:
    """Memory of page and server, once a minute."""

    def __init__(self, page: Page, console: Console) -> None:
        self._page, self._console = page, console
        self._begun_s = time.monotonic()
        self.moments: list[Memory] = []

    def look(self, runs: int, states: int) -> None:
        """Take a minute's figures, once it is over."""
        if time.monotonic() - self._begun_s < len(self.moments) * MINUTE_S:
            return
        one = Memory.now(self._page, self._console, states)
        minute = len(self.moments)
        self.moments.append(one)
        print(
            f"minute {minute:3d}: scripts {one.heap_mb:6.2f}, page {one.page_mb:6.1f}, server "
            f"{one.server_mb:6.1f} MB; {runs} runs, {states} states, {one.images} images shown, "
            f"{len(self._page.errors)} errors, load {os.getloadavg()[0]:.1f}",
            flush=True,
        )

    def judge(self) -> None:
        """Print whether memory was flat behind the first fifth."""
        settled = self.moments[len(self.moments) // 5 :]
        third = len(settled) // 3
        if len(settled) < FEWEST:
            print("too short for a verdict")
            return
        for what in ("heap_mb", "page_mb", "server_mb"):
            values = [getattr(one, what) for one in settled]
            early, late = statistics.median(values[:third]), statistics.median(values[-third:])
            of = f", {early:.1f} to {late:.1f} MB in {len(self.moments) - 1} minutes"
            growth = 100.0 * (late / early - 1.0)
            tell(f"growth of {what}", growth, LARGEST_GROWTH_PERCENT, "%", of)


def fly(number: int, run_s: float, end_s: float, states: int, minutes: Minutes) -> int:
    """Publish one run at the pace of a flight; return how many states there were."""
    scenery, run = Scenery(), f"/bench/large/wil/{number}"
    begun_s = time.monotonic()
    with FeedPublisher(run=run, time=time.monotonic, facts=lambda: FACTS, note=print) as feed:
        feed.event(begun_s, "stage", "goal", "")
        seq = 0
        while (now_s := time.monotonic()) < min(begun_s + run_s, end_s):
            readings = {name: scenery.reading(name, seq, now_s) for name in NAMES}
            view = scenery.view(seq, now_s, run)
            feed.images(PreviewImages(readings["mixed"], "", readings["real"], readings["twin"]))
            feed.tick(lambda view=view: view)
            if seq % int(HZ) == 0:
                feed.event(now_s, "vehicle", "text", f"text {seq}", vehicle="real")
                minutes.look(number, states + seq)
            seq += 1
            time.sleep(max(0.0, begun_s + seq / HZ - time.monotonic()))
    return states + seq


def end_in_order(*_: object) -> None:
    raise KeyboardInterrupt


def measure(asked: argparse.Namespace) -> None:
    console = Console()
    try:
        with browser(webgl=asked.webgl) as page:
            join(page, console)
            minutes = Minutes(page, console)
            end_s = time.monotonic() + asked.minutes * MINUTE_S + 1.0
            number, states = 0, 0
            try:
                while time.monotonic() < end_s:
                    number += 1
                    states = fly(number, asked.run_seconds, end_s, states, minutes)
            except (KeyboardInterrupt, OSError, RuntimeError) as why:
                # What there is of it is judged, also when the browser was ended by somebody.
                print(f"ended early: {why!r}")
            minutes.judge()
            print(f"errors of the page: {page.errors}")
    finally:
        console.end()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--run-seconds", type=float, default=180.0)
    parser.add_argument("--webgl", action="store_true", help="drawn in software")
    asked = parser.parse_args()
    signal.signal(signal.SIGTERM, end_in_order)
    with tempfile.TemporaryDirectory(prefix="wil-") as base:
        os.environ["XDG_RUNTIME_DIR"] = str(Path(base))
        os.environ["PYTHONPATH"] = str(ROOT)
        measure(asked)


if __name__ == "__main__":
    main()
