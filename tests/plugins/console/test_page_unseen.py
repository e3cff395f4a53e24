"""What the console's page says of runs and vehicles whose present state it does not see."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.orchestrator.report.browser import chromium
from tests.plugins.console.conftest import Console
from tests.plugins.console.test_page_truth import FACTS, FakeFeed, look, text, vehicle, view
from tests.plugins.console.test_two_operators import PATIENCE_S, wait_until
from wil_campaign.plugins.console.feed.feed_messages import EventView, FactsView, ImageView

pytestmark = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
REMOTE = {"large/wil/1": {"stage": "goal", "place": "second"}}
UNSEEN = "1 run on node second, state not seen here: stage goal"
AGE = "document.querySelector('.aged[data-age=run] .age').textContent"
IMAGE = "document.querySelector('.camera[data-age=real]')"
DOWN = tuple(vehicle(one, armed=False, landed="on_ground") for one in ("real", "twin"))


@contextmanager
def earlier(by_s: float) -> Iterator[None]:
    """Have the console's server receive what comes now this much earlier."""
    clocks = SimpleNamespace(
        time=lambda: time.time() - by_s, monotonic=lambda: time.monotonic() - by_s
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wil_campaign.plugins.console.console_hub.time", clocks)
        yield


async def test_a_run_on_another_node_is_never_nothing_in_the_air(console: Console) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        feed.status(flying=REMOTE)
        wait_until(page, text("state"), UNSEEN)
        wait_until(page, text("air"), UNSEEN)
        local = {"large/wil/2": {"stage": "goal", "place": ""}}
        feed.keep(view("large/wil/2"))
        feed.status(flying=REMOTE | local)
        wait_until(page, text("air"), f"real and twin; {UNSEEN}")
        page.press("Escape")
        wait_until(page, text("reply"), "in the air: real, twin")
        feed.status(flying=REMOTE | local, stopped="command")
        wait_until(page, text("state"), f"aborted: landing, no further runs; {UNSEEN}")
        feed.take(view("large/wil/2", vehicles=DOWN, t_s=15.0, stage="end"))
        feed.status(flying=REMOTE, finished={"large/wil/2": "ABORTED"}, stopped="command")
        wait_until(page, text("reply"), "down: real")
        assert UNSEEN in page.value(text("reply"))
        assert "ALL DOWN" not in page.value(text("reply"))
        wait_until(page, text("air"), UNSEEN)
        wait_until(page, text("state"), f"aborted: {UNSEEN}")
        assert "nothing" not in page.value(text("air") + "+" + text("state"))
        feed.status(stopped="command")
        wait_until(page, text("reply"), "ALL DOWN at ")
        wait_until(page, text("state"), "aborted, nothing in the air")
        before = page.value(text("reply"))
        time.sleep(1.2)  # the page shows whole seconds
        feed.reload()
        wait_until(page, text("reply"), "ALL DOWN at ")
        assert page.value(text("reply")) == before

    await look(console, seen)


async def test_a_vehicle_last_seen_up_is_not_forgotten_when_its_feed_falls_silent(
    console: Console,
) -> None:
    follow = "/results/follow/2026"

    def seen(feed: FakeFeed) -> None:
        page = feed.page
        with earlier(6.0):
            feed.take(view("line/wil/1", run=f"{follow}/line/wil/1", vehicles=(vehicle("tail"),)))
        wait_until(page, text("air"), "tail")
        feed.keep(view("large/wil/1"))
        wait_until(page, text("air"), "real and twin")
        page.press("Escape")
        wait_until(page, text("reply"), "in the air: line/wil/1 tail")
        feed.take(view("large/wil/1", vehicles=DOWN, t_s=15.0, stage="landed"))
        wait_until(page, text("reply"), "still in the air: line/wil/1 tail")
        assert "ALL DOWN" not in page.value(text("reply"))
        # Its guard reports it down, though its program has died.
        guard = {"name": "line", "folder": f"{follow}/line/wil/1", "is_answering": True}
        feed.guards({**guard, "vehicles": {"tail": "down"}})
        wait_until(page, text("reply"), "ALL DOWN at ")
        assert "line/wil/1 tail" in page.value(text("reply"))

    await look(console, seen)


async def test_a_page_that_is_opened_later_shows_the_true_age(console: Console) -> None:
    jpeg = bytes(cv2.imencode(".jpg", np.zeros((4, 4, 3), np.uint8))[1])

    def seen(feed: FakeFeed) -> None:
        page = feed.page
        feed.status(flying={"large/wil/1": {"stage": "goal"}})
        run = view("large/wil/1")
        image = ImageView(run.run, "real", 1, 1.0, 0.05, 4, 4, rendered=True, jpeg=jpeg)
        with earlier(20.0):
            feed.take(FactsView(run.run, FACTS), run, image)
        feed.reload()
        wait_until(page, text("stage"), "goal")
        wait_until(page, f"{IMAGE}.querySelector('.age').textContent", "s old")
        for script in (AGE, f"{IMAGE}.querySelector('.age').textContent"):
            assert 20.0 <= float(page.value(script).partition(" ")[0]) < 20.0 + PATIENCE_S
        assert page.value(f"{IMAGE}.classList.contains('stale')")
        assert page.value("document.querySelector('.aged[data-age=run]').matches('.stale')")
        # What is as old as that is not the present state.
        assert "1 run, state not seen here: stage goal" in page.value(text("air"))

    await look(console, seen)


async def test_all_down_has_the_same_time_after_a_reload(console: Console) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        feed.status(flying={"large/wil/1": {"stage": "goal"}})
        feed.keep(view("large/wil/1", vehicles=(vehicle("real"), vehicle("twin"))))
        wait_until(page, text("air"), "real and twin")
        page.press("Escape")
        wait_until(page, text("reply"), "in the air: real, twin")
        feed.fall_silent()
        run = view("large/wil/1").run
        feed.take(EventView(run, 1, 14.0, "vehicle", "disarmed", "real", ""))
        wait_until(page, text("reply"), "in the air: twin")
        time.sleep(1.2)  # the page shows whole seconds
        # The program has died in flight; the guard, which ends as well, saw the twin come down.
        guard = {"name": "large", "folder": run, "is_answering": True}
        feed.guards({**guard, "vehicles": {"twin": "down"}})
        wait_until(page, text("reply"), "ALL DOWN at ")
        before = page.value(text("reply"))
        time.sleep(1.2)  # the page shows whole seconds
        feed.status(is_over=True)
        feed.reload()
        wait_until(page, text("reply"), "ALL DOWN at ")
        assert page.value(text("reply")) == before

    await look(console, seen)
