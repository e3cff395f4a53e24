"""The page's editor of fences: several areas of both kinds, and a first one where there is none."""

import json
from collections.abc import Callable
from typing import Any

import pytest

from tests.orchestrator.report.browser import chromium
from tests.plugins.console.conftest import Console
from tests.plugins.console.test_page_truth import FACTS, FakeFeed, look, text, vehicle, view
from tests.plugins.console.test_two_operators import click, wait_until
from wil_campaign.plugins.console.feed.feed_messages import FactsView

pytestmark = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")

FENCE: dict[str, Any] = {
    "inclusions": [
        {"corners_m": [[-1.0, -2.0], [4.0, -2.0], [4.0, 2.0], [-1.0, 2.0]]},
        {"centre_m": [5.0, 0.0], "radius_m": 2.0},
    ],
    "exclusions": [{"corners_m": [[2.0, 1.0], [3.0, 1.0], [3.0, 1.5]]}],
    "floor_up_m": -0.5,
    "ceiling_up_m": 2.5,
}
AS_WRITTEN: dict[str, Any] = {
    "include": [
        {"polygon": [[-1, -2], [4, -2], [4, 2], [-1, 2]]},
        {"circle": {"north_m": 5, "east_m": 0, "radius_m": 2}},
    ],
    "exclude": [{"polygon": [[2, 1], [3, 1], [3, 1.5]]}],
    "up_m": [-0.5, 2.5],
}
SEND = "document.getElementById('fence-form').requestSubmit()"
SAID = text("reply")
OUTSIDE = (
    "(() => { const one = document.getElementById('fence-side'); one.value = 'exclude';"
    "one.dispatchEvent(new Event('change')); })()"
)
DRAG = (
    "(() => {{ const one = document.getElementById('plan'), box = one.getBoundingClientRect();"
    "const at = (kind, x, y) => one.dispatchEvent(new PointerEvent(kind, {{pointerId: 1,"
    " bubbles: true, clientX: box.x + box.width / 2 + x, clientY: box.y + box.height / 2 + y}}));"
    "one.setPointerCapture = () => {{}};"
    "at('pointerdown', 0, 0); at('pointermove', {x}, {y}); at('pointerup', {x}, {y}); }})()"
)


def in_flight(feed: FakeFeed, fences: dict[str, Any]) -> None:
    run = view("large/wil/1", vehicles=(vehicle("real"), vehicle("twin", north=1.0)), fences=fences)
    feed.take(FactsView(run.run, FACTS))
    feed.keep(run)
    feed.status(flying={"large/wil/1": "goal"})
    wait_until(feed.page, "String(document.getElementById('fence-edit').hidden)", "false")
    feed.page.value(click("fence-edit"))


async def sent(console: Console, edit: Callable[[FakeFeed], None]) -> Any:
    """The fence that the page sends at the end of an edit."""

    def seen(feed: FakeFeed) -> None:
        edit(feed)
        feed.page.value(SEND)
        wait_until(
            feed.page, f"String(document.getElementById('fence-form').hidden) + {SAID}", "true"
        )
        assert feed.page.errors == []

    await look(console, seen)
    ((kind, document),) = [(one.kind, one.document) for one in console.fleet.told]
    assert kind == "geofence"
    return json.loads(document)


async def test_areas_of_both_kinds_are_sent_as_they_are(console: Console) -> None:
    assert await sent(console, lambda feed: in_flight(feed, {"real": FENCE})) == AS_WRITTEN


async def test_an_area_is_added_dragged_and_kept_out_of_and_another_removed(
    console: Console,
) -> None:
    other_way = {**FENCE, "inclusions": FENCE["inclusions"][::-1]}

    def edit(feed: FakeFeed) -> None:
        in_flight(feed, {"real": other_way})
        feed.page.value(click("fence-remove"))  # the first one is marked: the circle
        feed.page.value(click("fence-circle"))
        feed.page.value(OUTSIDE)
        feed.page.value(DRAG.format(x=0, y=-60))

    document = await sent(console, edit)
    assert document["include"] == AS_WRITTEN["include"][:1]
    first, second = document["exclude"]
    assert first == AS_WRITTEN["exclude"][0]
    assert set(second) == {"circle"}
    assert second["circle"]["radius_m"] > 0.0
    # Up on the plan is north.
    assert second["circle"]["north_m"] > 2.6


async def test_a_first_fence_is_drawn_around_the_vehicles(console: Console) -> None:
    document = await sent(console, lambda feed: in_flight(feed, {}))
    assert document == {
        "include": [{"polygon": [[-3, -3], [-3, 3], [4, 3], [4, -3]]}],
        "up_m": [-0.5, 4],
    }


async def test_a_fence_of_exclusions_alone_is_not_sent(console: Console) -> None:
    def edit(feed: FakeFeed) -> None:
        in_flight(feed, {})
        feed.page.value(OUTSIDE)
        feed.page.value(SEND)
        wait_until(feed.page, text("reply"), "needs an area to stay in")
        assert console.fleet.told == []

    await look(console, edit)
