"""What the console's page says of runs and vehicles whose present state it does not see."""

import pytest

from tests.orchestrator.console.conftest import Console
from tests.orchestrator.console.test_page_truth import FakeFeed, look, text, vehicle, view
from tests.orchestrator.console.test_two_operators import wait_until
from tests.orchestrator.report.browser import chromium

pytestmark = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
REMOTE = {"large/wil/1": {"stage": "goal", "place": "second"}}
UNSEEN = "1 run on node second, state not seen here: stage goal"
DOWN = tuple(vehicle(one, armed=False, landed="on_ground") for one in ("real", "twin"))


async def test_a_run_on_another_node_is_never_nothing_in_the_air(console: Console) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        feed.status(flying=REMOTE)
        wait_until(page, text("state"), UNSEEN)
        wait_until(page, text("air"), UNSEEN)
        local = {"large/wil/2": {"stage": "goal", "place": ""}}
        feed.take(view("large/wil/2"))
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

    await look(console, seen)


async def test_a_vehicle_last_seen_up_is_not_forgotten_when_its_feed_falls_silent(
    console: Console,
) -> None:
    follow = "/results/follow/2026"

    def seen(feed: FakeFeed) -> None:
        page = feed.page
        page.value("{ window.now = Date.now; Date.now = () => window.now() - 6000; }")
        feed.take(view("line/wil/1", run=f"{follow}/line/wil/1", vehicles=(vehicle("tail"),)))
        wait_until(page, text("air"), "tail")
        page.value("Date.now = window.now")
        feed.take(view("large/wil/1"))
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
