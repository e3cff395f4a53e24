"""The console beside a flight of real processes, in a browser: what it shows, and an abort."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from tests.orchestrator.report.browser import Page, browser, chromium
from tests.orchestrator.wall_runs import STAYING, Program, lines, stages

pytestmark = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
RECORD = "operator.jsonl"
PATIENCE_S = 100.0
IS_DRAWN = """(() => {
  const of = new OffscreenCanvas(160, 120).getContext('2d');
  const one = document.getElementById('image-{name}');
  of.drawImage(one, 0, 0);
  const data = of.getImageData(0, 0, 160, 120).data;
  return one.width === 160 && data.some((value, at) => at % 4 !== 3 && value > 0);
})()"""
CEILING = (
    "document.getElementById('fence-ceiling').value = '2.9';"
    "document.getElementById('fence-form').requestSubmit()"
)
JOIN = (
    "document.getElementById('name').value = 'anna';"
    "document.querySelector('#join-form button').click()"
)


async def until(page: Page, script: str, is_as: Callable[[Any], bool] = bool) -> Any:
    """Return what a script comes to, once it is as it should be."""
    async with asyncio.timeout(PATIENCE_S):
        while not is_as(found := page.value(script)):  # noqa: ASYNC110 - it is another process
            await asyncio.sleep(0.1)
    return found


def text_of(name: str) -> str:
    return f"document.getElementById('{name}').textContent"


@asynccontextmanager
async def viewer_that_never_reads(link: str) -> AsyncIterator[None]:
    """Have a viewer on the console that takes nothing from its socket, as one that is stopped."""
    base, _, token = link.partition("/#")
    jar = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(cookie_jar=jar, headers={"Origin": base}) as session:
        joined = await session.post(f"{base}/session", json={"token": token, "name": "eve"})
        joined.raise_for_status()
        async with session.ws_connect(f"{base}/live", autoping=False):
            yield


async def look_and_abort(program: Program, link: str) -> None:
    """Look at a flight, hold it, change its fence, abort it, and see the console end with it."""
    with browser() as page:
        page.resize(1440, 1000)
        page.open(link)
        page.value(JOIN)
        await program.stage("goal")
        for name in ("real", "twin", "mixed", "overlay"):
            await until(page, IS_DRAWN.replace("{name}", name))
        assert await until(page, text_of("stage"), lambda one: one == "goal")
        assert page.value("location.hash") == ""
        assert "no WebGL" in page.value(text_of("space-note"))
        for name in ("real", "twin"):
            assert name in page.value(text_of("vehicles"))
        assert "forwards setpoints" in await until(page, text_of("guards"))
        assert "collision of real" in page.value(text_of("margins"))
        # Who sees it for the first time reads at the top what flies, and how near it is to failing.
        assert "simulated: embedded" in page.value(text_of("vehicles"))
        assert await until(page, text_of("air"), lambda one: "and" in one) == "real and twin"
        assert " of real: " in page.value(text_of("nearest"))
        assert "s left" in await until(page, text_of("time"), lambda one: "left" in one)
        page.value("document.getElementById('hold').click()")
        await until(page, text_of("state"), lambda one: one.startswith("HELD"))
        page.value("document.getElementById('fence-edit').click()")
        page.value(CEILING)
        await until(page, text_of("reply"), lambda one: "changed the fence" in one)
        page.press("Escape")
        await until(page, text_of("reply"), lambda one: "ABORT by anna" in one)
        # Who holds after the goal was given has flown nothing that could be judged.
        assert await until(page, text_of("verdict"), lambda one: one == "INVALID")
        assert "held by console:anna" in page.value(text_of("reason"))
        assert page.errors == []
        assert [
            request for request in page.requests if not request.startswith(link.partition("#")[0])
        ] == []
        landed = await program.end()
        assert landed.code == 4, landed.why
        await until(page, text_of("abort-word"), lambda one: one == "nothing in flight")
        assert "ALL DOWN at " in page.value(text_of("reply"))
        assert page.value("document.getElementById('lost').hidden")
        assert page.value(text_of("verdict-label")) == "Verdict, final"
        assert page.value(text_of("air")) == "nothing"


@pytest.mark.no_turn("lockstep")
async def test_the_page_shows_the_flight_and_its_key_lands_both(tmp_path: Path) -> None:
    given = ("--mode", "wil", "--console", "auto", "--set", "clock.speed=1", *STAYING)
    async with Program(tmp_path / "out", *given, clock="scaled") as program:
        assert program.process.stdout is not None
        line = (await program.process.stdout.readline()).decode()
        link = line.removeprefix("operator: ").strip()
        line = (await program.process.stdout.readline()).decode()
        never_reads = viewer_that_never_reads(line.removeprefix("viewer: ").strip())
        async with never_reads:
            await look_and_abort(program, link)
        assert list((program.runtime / "wil-campaign").iterdir()) == []
    assert stages(program.run_folder())[-2:] == ["landed", "end"]
    result = json.loads((program.run_folder() / "result.json").read_text())
    assert ("ABORTED", "aborted by console:anna") in [
        (one["verdict"], one["reason"]) for one in result["also"]
    ]
    (changed,) = result["fence_changes"]
    assert (changed["by"], changed["vehicles"]) == ("console:anna", ["real", "twin"])
    asked = [(one["who"], one["command"], one["ok"]) for one in lines(program.folder / RECORD)]
    assert [("console:anna", command, True) for command in ("hold", "geofence", "abort")] == [
        fromkey for fromkey in dict.fromkeys(asked) if fromkey[0] == "console:anna"
    ]
