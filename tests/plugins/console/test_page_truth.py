"""What the console's page says of a run that is over, of an abort, and where ABORT stands."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from tests.orchestrator.operator.controllers import silent_place
from tests.orchestrator.report.browser import Page, browser, chromium
from tests.orchestrator.report.recorded_campaign import CAMPAIGN, WORLD
from tests.plugins.console.conftest import Console
from tests.plugins.console.test_two_operators import FOLDER, join, status, wait_until
from wil_campaign.orchestrator.operator.campaign_records import (
    OperatorPlace,
    OperatorPlaces,
    operator_places,
)
from wil_campaign.plugins.console.feed.feed_messages import (
    EventView,
    FactsView,
    MarginView,
    RunView,
    VehicleView,
)

pytestmark = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
REFUSED = "real: arming was refused (MAV_CMD_COMPONENT_ARM_DISARM was not answered, sent 6 times)"
FACTS = {"world": json.dumps(WORLD), "campaign": json.dumps(CAMPAIGN), "case": "large"}
MARGIN = MarginView("distance", "real", True, "PASS", 0.8, (None, 0.0), "m", 0.8, "")
PLACE = (
    "(({x, y, width, height}) => [x, y, width, height].map(Math.round).join())"
    "(document.getElementById('abort').getBoundingClientRect())"
)
IS_CANVAS = (
    "(() => {{ const one = document.getElementById('{name}'); const now = one.toDataURL();"
    "const before = window['was_{name}']; window['was_{name}'] = now;"
    "return before !== undefined && before !== now; }})()"
)


def text(name: str) -> str:
    return f"document.getElementById('{name}').textContent"


def style(name: str, key: str) -> str:
    return f"getComputedStyle(document.getElementById('{name}')).{key}"


def vehicle(name: str, *, armed: bool = True, landed: str = "in_air", north: float = 0.0) -> Any:
    return VehicleView(
        name, armed, "GUIDED", landed, True, False, 0.01, position_ned_m=(north, 0.0, -1.0)
    )


def view(name: str, **changes: Any) -> RunView:
    """Return the state of a run of the campaign, flying to its goal."""
    made = RunView(
        run=f"{FOLDER}/{name}",
        name=name,
        clock="wall",
        subject="real",
        t_s=10.0,
        stage="goal",
        entered_s={"start": 0.0},
        events={},
        verdict_so_far="PASS",
        reason="",
        held=False,
        vehicles=(vehicle("real"), vehicle("twin")),
        margins=(MARGIN,),
        mixings=(),
        fences={},
    )
    return structs.replace(made, **changes)


class FakeFeed:
    """What a test sends the page, from the browser's thread."""

    def __init__(self, console: Console, page: Page, loop: asyncio.AbstractEventLoop) -> None:
        self._console, self.page, self._loop = console, page, loop
        self._kept: dict[str, RunView] = {}

    def run(self, made: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(made, self._loop).result(10)

    def take(self, *messages: Any) -> None:
        for message in messages:
            self.run(self._take(message))

    def keep(self, view: RunView) -> None:
        """Send a state, and repeat it as a run in flight does, until the run's next one."""
        self.run(self._take(view, is_kept=True))

    def fall_silent(self) -> None:
        """Repeat no state any longer."""

        async def forget() -> None:
            self._kept.clear()

        self.run(forget())

    async def _take(self, message: Any, *, is_kept: bool = False) -> None:
        if isinstance(message, RunView):
            self._kept.pop(message.run, None)
            if is_kept:
                self._kept[message.run] = message
        await self._console.hub.receive(message)

    async def repeat(self) -> None:
        """Repeat what is kept: the page takes nothing for the present that is 3 s old."""
        while True:
            await asyncio.sleep(0.5)
            for view in tuple(self._kept.values()):
                await self._console.hub.receive(view)

    def status(self, **changes: Any) -> None:
        async def show() -> None:
            self._console.hub.show_status(status(**changes))

        self.run(show())

    def guards(self, *guards: dict[str, Any]) -> None:
        async def show() -> None:
            self._console.hub.show_status(status() | {"guards": guards})

        self.run(show())

    def reload(self) -> None:
        self.page.open(f"{self._console.origin}/")
        wait_until(self.page, text("control"), "anna has control")

    def goodbye(self) -> None:
        async def say() -> None:
            self._console.hub.say_goodbye()
            await asyncio.sleep(0.3)
            await self._console.server.close()

        self.run(say())


async def look(console: Console, seen: Callable[[FakeFeed], None], width_px: int = 1440) -> None:
    """Have an operator's page before a fake feed; seen: what is done, in a thread."""
    link, loop = console.link("operator"), asyncio.get_running_loop()

    def work() -> None:
        with browser() as page:
            join(page, link, "anna")
            page.resize(width_px, 900)
            feed = FakeFeed(console, page, loop)
            repeating = asyncio.run_coroutine_threadsafe(feed.repeat(), loop)
            try:
                wait_until(page, text("control"), "anna has control")
                seen(feed)
            finally:
                repeating.cancel()
            assert page.errors == []

    await asyncio.to_thread(work)


async def test_a_run_that_ended_shows_its_final_verdict_and_no_green(console: Console) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        nothing = structs.replace(MARGIN, actual=None, margin=None)
        grounded = (vehicle("real", armed=False, landed="on_ground"),)
        run = view("small/wil/5", stage="ready", vehicles=grounded, margins=(nothing,))
        feed.take(FactsView(run.run, FACTS), run)
        feed.status(flying={"small/wil/5": {"stage": "ready"}})
        wait_until(page, text("stage"), "ready")
        # Nothing was measured: there is nothing to be green about.
        assert page.value(text("verdict")) == "not measured"
        feed.take(structs.replace(run, stage="end", t_s=27.4))
        feed.status(finished={"small/wil/5": "ERROR"}, reasons={"small/wil/5": REFUSED})
        wait_until(page, text("verdict"), "ERROR")
        assert page.value(text("verdict-label")) == "Verdict, final"
        assert REFUSED in page.value(text("reason"))
        assert "PASS" not in page.value("document.querySelector('header').innerText")

    await look(console, seen)


async def test_a_control_that_passed_is_red_and_one_that_failed_as_it_must_is_not(
    console: Console,
) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        ended = {"blind/sim/1": "PASS", "deaf/sim/1": "FAIL", "large/sim/1": "PASS"}
        feed.take(view("blind/sim/1", stage="end", verdict_so_far="PASS"))
        feed.status(finished=ended, controls={"blind/sim/1": False, "deaf/sim/1": True})
        wait_until(page, text("verdict"), "PASS: control NOT met")
        assert "FAIL" in page.value("document.getElementById('verdict').className")
        found = "[...document.querySelectorAll('#matrix .badge')]"
        badges = f"{found}.map((one) => one.className + one.textContent)"
        assert page.value(badges) == [
            "badge FAIL1 PASS: control NOT met",
            "badge planned1 FAIL, as a control must",
            "badge PASS1 PASS",
        ]
        assert "1 control NOT met, 1 control met, 1 PASS" in page.value(text("matrix"))

    await look(console, seen)


async def test_a_run_that_has_ended_without_a_verdict_yet_is_no_pass(console: Console) -> None:
    def seen(feed: FakeFeed) -> None:
        feed.take(view("large/wil/1"))
        feed.status(flying={"large/wil/1": {"stage": "goal"}})
        wait_until(feed.page, text("verdict"), "no failure so far")
        down = tuple(vehicle(one, armed=False, landed="on_ground") for one in ("real", "twin"))
        feed.take(view("large/wil/1", stage="end", t_s=20.0, vehicles=down))
        feed.status()
        wait_until(feed.page, text("verdict"), "being judged")
        assert "nothing in the air" in feed.page.value(text("state"))

    await look(console, seen)


async def test_the_head_names_what_has_failed_and_nothing_that_is_only_not_reached_yet(
    console: Console,
) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        feed.status(flying={"large/wil/1": {"stage": "goal"}})
        goal = MarginView("goal", "real", True, "FAIL", 3.0, (None, 0.3), "m", -2.7, "")
        feed.take(view("large/wil/1", verdict_so_far="", margins=(goal, MARGIN)))
        wait_until(page, text("nearest"), "distance of real: 0.80 m left")
        assert "not yet: 2.70 m beyond" in page.value(text("margins"))
        low = MarginView("low", "real", True, "FAIL", 0.2, (None, 0.5), "m", -0.3, "", True)
        down = structs.replace(low, name="quiet", actual=None, margin=None, detail="it is armed")
        for failed, said in (
            (low, "low of real: 0.30 m beyond"),
            (down, "quiet of real: it is armed"),
        ):
            changes = {"verdict_so_far": "FAIL", "margins": (goal, MARGIN, failed), "t_s": 11.0}
            feed.take(view("large/wil/1", **changes))
            wait_until(page, text("nearest"), said)
        assert page.value(text("verdict")) == "FAIL"
        page.resize(390, 800)
        # Nothing is said: no line is kept free for it.
        assert page.value("document.querySelector('.says').offsetHeight") < 5

    await look(console, seen)


async def test_margins_are_in_the_first_screen_and_the_dialog_covers_no_abort(
    console: Console,
) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        feed.status()
        feed.take(view("large/wil/1", stage="takeoff", margins=(MARGIN,)))
        wait_until(page, text("stage"), "takeoff")
        bottom = "document.querySelector('#margins tr:last-child').getBoundingClientRect().bottom"
        assert 0 < page.value(bottom) < 900
        # No word is broken: each fits into a line of its own.
        stage = "document.getElementById('stage')"
        assert page.value(f"{stage}.getClientRects()[0].height < 50")
        assert page.value(f"{stage}.scrollWidth <= {stage}.clientWidth")
        layer = "Number(getComputedStyle(document.querySelector('{}')).zIndex)"
        assert page.value(f"{layer.format('#join')} < {layer.format('header')}")

    await look(console, seen)


async def test_the_next_run_is_announced_until_the_last(console: Console) -> None:
    def seen(feed: FakeFeed) -> None:
        planned = ["large/wil/1", "large/wil/2"]
        feed.keep(view("large/wil/1"))
        feed.status(planned=planned, flying={"large/wil/1": {"stage": "goal"}})
        wait_until(feed.page, text("next"), "next: large/wil/2")
        feed.status(planned=planned, finished={"large/wil/1": "PASS"})
        wait_until(feed.page, text("next"), "next: large/wil/2")
        flying = {"large/wil/2": {"stage": "start"}}
        feed.status(planned=planned, finished={"large/wil/1": "PASS"}, flying=flying)
        wait_until(feed.page, text("next"), "the last run")

    await look(console, seen)


@pytest.mark.parametrize("width_px", [1440, 900, 390])
async def test_abort_never_moves(console: Console, width_px: int) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        feed.status()
        feed.take(view("large/wil/1"))
        wait_until(page, text("stage"), "goal")
        place = page.value(PLACE)
        long = "mixing of camera: exposures 63 ms apart, more than 60 ms; " * 8
        far = structs.replace(MARGIN, name="a_margin_of_a_very_long_name_" * 3)
        feed.take(
            view("large/wil/1", verdict_so_far="INVALID", reason=long, margins=(far,), t_s=1e5)
        )
        feed.status(name="a campaign of a very long name " * 6)
        wait_until(page, text("verdict"), "INVALID")
        assert page.value(PLACE) == place
        page.press("Escape")
        wait_until(page, text("reply"), "ABORT")
        feed.status(stopped="command")
        wait_until(page, text("state"), "landing")
        assert page.value(PLACE) == place
        page.value("window.scrollTo(0, 2000)")
        page.settle()
        assert page.value(PLACE) == place
        _, y, _, height = (int(one) for one in place.split(","))
        assert 0 <= y <= 900 - height

    await look(console, seen, width_px)


@pytest.mark.parametrize("width_px", [820, 390])
async def test_the_reason_is_whole_on_a_tablet_and_a_phone(console: Console, width_px: int) -> None:
    def seen(feed: FakeFeed) -> None:
        feed.status()
        held = "held by console:operator after the goal was given: the flight proves nothing"
        feed.take(view("large/wil/1", verdict_so_far="INVALID", reason=held))
        wait_until(feed.page, text("verdict"), "INVALID")
        wait_until(feed.page, text("reason"), "proves nothing")
        reason = "document.getElementById('reason')"
        assert feed.page.value(f"{reason}.scrollHeight <= {reason}.clientHeight")

    await look(console, seen, width_px)


async def test_an_abort_is_followed_until_all_are_down(console: Console) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        feed.status(flying={"large/wil/1": {"stage": "goal"}})
        # The real vehicle is heard last, and named first.
        silent = structs.replace(vehicle("real"), silent_s=None)
        feed.keep(view("large/wil/1", vehicles=(silent, vehicle("twin"))))
        wait_until(page, text("air"), "twin")
        feed.keep(view("large/wil/1"))
        wait_until(page, text("air"), "real and twin")
        page.press("Escape")
        wait_until(page, text("reply"), "ABORT by anna")
        wait_until(page, text("reply"), "in the air: real, twin")
        landed = vehicle("real", armed=False, landed="on_ground")
        feed.keep(view("large/wil/1", vehicles=(landed, vehicle("twin")), t_s=14.0))
        wait_until(page, text("reply"), "in the air: twin")
        down = (landed, vehicle("twin", armed=False, landed="on_ground"))
        feed.keep(view("large/wil/1", vehicles=down, t_s=15.0, stage="landed"))
        wait_until(page, text("reply"), "ALL DOWN at ")
        feed.take(view("large/wil/1", vehicles=down, t_s=16.0, stage="end"))
        verdicts = {"finished": {"large/wil/1": "ABORTED"}, "total": 10}
        feed.status(is_over=True, stopped="command", **verdicts)
        feed.goodbye()
        wait_until(page, text("state"), "ended, aborted")
        wait_until(page, text("abort"), "nothing")
        # Nothing flies and nobody is there: neither alarms nor covers anything.
        assert page.value("document.getElementById('abort').disabled")
        assert page.value(style("abort", "backgroundColor")) != "rgb(179, 38, 30)"
        page.press("Escape")
        page.settle()
        assert "ALL DOWN at " in page.value(text("reply"))
        assert page.value("document.getElementById('lost').hidden")
        for name in ("fence-edit", "invite-operator", "take", "hold"):
            one = f"document.getElementById('{name}')"
            assert page.value(f"{one}.hidden || {one}.disabled"), name
        page.errors.clear()  # The browser's own, of the server that has ended.

    await look(console, seen)


async def test_choosing_a_run_redraws_all_and_shows_its_events(console: Console) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        for number, north in ((1, 0.0), (2, 2.5)):
            name = f"large/wil/{number}"
            run = view(name, vehicles=(vehicle("real", north=north),), stage="end")
            event = EventView(run.run, 1, 3.0, "vehicle", "text", "real", f"hello of {number}")
            feed.take(FactsView(run.run, FACTS), run, event)
        feed.status(finished={"large/wil/1": "FAIL", "large/wil/2": "INVALID"})
        wait_until(page, text("verdict"), "INVALID")
        wait_until(page, text("events"), "hello of 2")
        assert "hello of 1" not in page.value(text("events"))
        options = page.value("[...document.getElementById('runs').options].map((o) => o.text)")
        assert any("large/wil/1" in one and "FAIL" in one for one in options)
        page.settle()
        canvases = ("plan", "side", "space")
        for name in canvases:
            page.value(IS_CANVAS.format(name=name))
        page.value(
            "(() => { const runs = document.getElementById('runs');"
            f"runs.value = '{FOLDER}/large/wil/1'; runs.dispatchEvent(new Event('change')); }})()"
        )
        for name in canvases:
            wait_until(page, IS_CANVAS.format(name=name))
        wait_until(page, text("verdict"), "FAIL")
        wait_until(page, text("events"), "hello of 1")

    await look(console, seen)


async def test_two_campaigns_are_named_and_their_flying_vehicles_are_summed(
    console: Console,
) -> None:
    def seen(feed: FakeFeed) -> None:
        page = feed.page
        other = view("line/wil/1", run="/results/follow/2026/line/wil/1")
        feed.take(view("large/wil/1"), other)

        async def show() -> None:
            both = status()["campaigns"] + status(name="follow")["campaigns"]
            both[1]["folder"] = "/results/follow/2026"
            console.hub.show_status({"campaigns": both, "guards": [], "problem": ""})

        feed.run(show())
        wait_until(page, text("state"), "2 campaigns")
        wait_until(page, text("air"), "large/wil/1")
        assert "line/wil/1" in page.value(text("air"))

    await look(console, seen)


async def test_an_abort_that_one_of_two_campaigns_does_not_confirm_is_red_and_names_it(
    console: Console, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (gate,) = operator_places().campaigns
    with silent_place("hall", short_folder / "hall", short_folder / "hall.sock") as hall:
        flying = OperatorPlaces((gate, hall), ())
        monkeypatch.setattr(
            "wil_campaign.plugins.console.flight_scope.operator_places", lambda: flying
        )

        def seen(feed: FakeFeed) -> None:
            page = feed.page
            feed.keep(view("large/wil/1"))
            feed.status(flying={"large/wil/1": {"stage": "goal"}})
            wait_until(page, text("air"), "real and twin")
            page.press("Escape")
            wait_until(page, text("reply"), "NOT CONFIRMED by hall")
            wait_until(page, text("reply"), "still in the air: real, twin")
            assert page.value("document.getElementById('reply').className") == "reply bad"
            down = tuple(vehicle(one, armed=False, landed="on_ground") for one in ("real", "twin"))
            feed.keep(view("large/wil/1", vehicles=down, t_s=15.0, stage="landed"))
            wait_until(page, text("reply"), "down: real")
            assert "NOT CONFIRMED by hall" in page.value(text("reply"))
            assert "ALL DOWN" not in page.value(text("reply"))

        await look(console, seen)
    assert console.commands() == [("abort", "console:anna")]


async def test_an_abort_is_answered_for_each_campaign(
    console: Console, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (gate,) = operator_places().campaigns
    client = await console.client("operator")
    folder = short_folder / "hall"
    with silent_place("hall", folder, short_folder / "hall.sock") as hall:
        guard = OperatorPlace("hall's run", folder / "large/wil/1", gate.socket)
        for guards, ok in (((), False), ((guard,), True)):
            flying = OperatorPlaces((gate, hall), guards)
            scope = "wil_campaign.plugins.console.flight_scope.operator_places"
            monkeypatch.setattr(scope, lambda: flying)  # noqa: B023
            done = await console.post(client, "/command", {"command": "abort"})
            reply = await done.json()
            assert reply["ok"] is ok
            assert reply["is_obeyed"]
            assert "hall: " in reply["text"]


async def test_a_refused_command_has_its_reason_alone(console: Console) -> None:
    client = await console.client("operator")
    for ok, said in ((True, "held: 1 run"), (False, "gate: hold: all vehicles hold already")):
        done = await console.post(client, "/command", {"command": "hold"})
        reply = await done.json()
        assert (reply["ok"], said in reply["text"]) == (ok, True)
    assert reply["text"] == "gate: hold: all vehicles hold already"
