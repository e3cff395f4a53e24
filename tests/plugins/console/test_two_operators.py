"""Two operators and a viewer before the same flight, each in a browser of their own."""

import asyncio
from typing import Any

import pytest

from tests.orchestrator.report.browser import Page, browser, chromium
from tests.plugins.console.conftest import Console

PATIENCE_S = 60.0
FOLDER = "/results/gate/20261123T160236Z"
JOIN = (
    "document.getElementById('name').value = '{name}';"
    "document.querySelector('#join-form button').click()"
)
CONTROL = "document.getElementById('control').textContent"
STATE = "document.getElementById('state').textContent"
REPLY = "document.getElementById('reply').textContent"


def status(**changes: Any) -> dict[str, Any]:
    """Return what the page receives of the campaign."""
    campaign = {
        "name": "gate",
        "folder": FOLDER,
        "is_answering": True,
        "problem": "",
        "held": False,
        "stopped": None,
        "total": 10,
        "finished": {},
        "reasons": {},
        "flying": {},
        "answers": [],
        "planned": [],
        "is_over": False,
    }
    return {"campaigns": [campaign | changes], "guards": [], "problem": ""}


def is_enabled(name: str) -> str:
    return f"!document.getElementById('{name}').disabled"


def click(name: str) -> str:
    return f"document.getElementById('{name}').click()"


def join(page: Page, link: str, name: str) -> None:
    page.resize(1440, 1000)
    page.open(link)
    page.value(JOIN.format(name=name))


def wait_until(page: Page, script: str, said: str = "") -> None:
    """Wait until a script comes to true, or to a text that has this in it."""
    for _ in range(int(PATIENCE_S / 0.1)):
        found = page.value(script)
        if said in found if said else found is True:
            return
        page.send(
            "Runtime.evaluate",
            expression="new Promise((f) => setTimeout(f, 100))",
            awaitPromise=True,
        )
    pytest.fail(f"{script} never came to {said or True}; it is {page.value(script)}")


@pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
async def test_control_is_handed_over_in_sight_of_both(console: Console) -> None:
    links = [console.link("operator"), console.link("operator")]
    loop = asyncio.get_running_loop()

    def look() -> None:
        with browser() as first, browser() as second:
            join(first, links[0], "anna")
            wait_until(first, CONTROL, "anna has control")
            join(second, links[1], "ben")
            wait_until(second, CONTROL, "anna has control")
            assert first.value(is_enabled("hold"))
            assert not second.value(is_enabled("hold"))
            second.value(click("take"))
            for page in (first, second):
                wait_until(page, CONTROL, "ben has control")
            wait_until(second, is_enabled("hold"))
            wait_until(first, f"!({is_enabled('hold')})")
            # A command says by the newest status how old what its page shows is.
            loop.call_soon_threadsafe(console.hub.show_status, status())
            wait_until(second, STATE, "between runs")
            second.value(click("hold"))
            wait_until(second, REPLY, "held")
            # Abort is every operator's, also of the one who has handed over.
            first.press("Escape")
            wait_until(first, REPLY, "all vehicles land")
            assert (first.errors, second.errors) == ([], [])

    await asyncio.to_thread(look)
    assert console.commands() == [("hold", "console:ben"), ("abort", "console:anna")]


@pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
async def test_a_viewers_page_commands_nothing(console: Console) -> None:
    link = console.link("viewer")

    def look() -> None:
        with browser() as page:
            join(page, link, "eve")
            wait_until(page, CONTROL, "has control")
            for name in ("abort", "hold", "resume", "take"):
                assert not page.value(is_enabled(name)), name
            assert page.value("document.getElementById('fence-edit').hidden")
            page.press("Escape")
            page.value(click("abort"))
            page.settle()
            assert page.errors == []

    await asyncio.to_thread(look)
    assert console.commands() == []
